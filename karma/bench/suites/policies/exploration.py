"""What hits save: the part of all searching that a memory makes unnecessary (KARMA section 4.2).

A unit that is in memory is found without a search; for any other one the receptacles of its room
are visited in the order of how likely they hold it (`tasks.Finds`). The reduced exploration of a
sequence is the share of all those stops that hits save: a hit rate in which dear units weigh more.
That it rises with the hit rate is therefore nearly certain by construction.
"""

from collections.abc import Sequence

import msgspec
import numpy as np

from karma.bench.suites.policies.intervals import Bootstrapped, Resampler
from karma.bench.suites.policies.simulate import simulator
from karma.bench.suites.policies.trace import Trace


class Exploration(msgspec.Struct, frozen=True, kw_only=True):
    """One policy's hit rate and reduced exploration, a pair for each sequence, and their line."""

    policy: str
    rates: list[float]
    reduced: list[float]
    slope: float | None
    intercept: float | None
    r: Bootstrapped | None  # Pearson's, over sequences; None where one of both never changes


def explore(
    policy: str, traces: Sequence[Trace], costs: Sequence[Sequence[float]], seed: int
) -> Exploration:
    """Run a policy and weigh its hits by the searches that they save.

    Args:
        policy: as `karma.bench.suites.policies.sweep.sized` gives it.
        traces: sequences that ask for something.
        costs: for each request of each sequence, the stops of its search.
        seed: of the bootstrap.
    """
    run = simulator(policy)
    rates, reduced = [], []
    for trace, prices in zip(traces, costs, strict=True):
        outcome = run(trace)
        saved = sum(p for hit, p in zip(outcome.answers, prices, strict=True) if hit)
        rates.append(round(outcome.hits / outcome.requests, 6))
        reduced.append(round(saved / sum(prices), 6))
    r = Resampler(len(traces), seed).correlation(rates, reduced)
    slope = intercept = None
    if r is not None:
        x, y = np.asarray(rates), np.asarray(reduced)
        dx, dy = x - x.mean(), y - y.mean()
        slope = round(float((dx * dy).sum() / (dx * dx).sum()), 6)
        intercept = round(float(y.mean() - slope * x.mean()), 6)
    return Exploration(
        policy=policy, rates=rates, reduced=reduced, slope=slope, intercept=intercept, r=r
    )
