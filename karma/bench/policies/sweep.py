"""Run policies of several sizes over the same sequences, and weigh the searches saved by hits."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import msgspec
import numpy as np

from karma.bench.figures.statistics import FEWEST_TASKS, Floats, Statistic, bootstrap, times_in
from karma.bench.policies.simulate import BELADY, FIRST_TASKS, Trace, TraceReplay, simulator
from karma.errors import KarmaError
from karma.memory.policies import make_policy
from karma.seeds import stream

RESAMPLES = 2000
_TEXT = re.compile(r"([\w-]+)(\[\d+(?:[,/]\d+)?\])?((?: +\S+)*)")


# ----------------------------------------------------------------- intervals, by bootstrap


@dataclass(frozen=True, slots=True, kw_only=True)
class Bootstrapped:
    """A figure and its 95 % percentile interval; `low` and `high` are None for a few sequences."""

    value: float
    low: float | None = None
    high: float | None = None

    def holds(self, wanted: float) -> bool:
        """Return whether the interval covers a value."""
        return self.low is not None and self.high is not None and self.low <= wanted <= self.high

    def above(self, floor: float) -> bool:
        """Return whether all of the interval lies above a value."""
        return self.low is not None and self.low > floor


class Resampler:
    """The same resamples of some sequences for every figure, so that differences are paired."""

    def __init__(self, count: int, seed: int) -> None:
        self._times = times_in(stream(seed, "lab", "bootstrap"), count, RESAMPLES)

    def mean(self, values: Sequence[float]) -> Bootstrapped:
        """Return the mean of a figure over sequences."""
        return self.ratio(values, [1.0] * len(values))

    def ratio(self, over: Sequence[float], under: Sequence[float]) -> Bootstrapped:
        """Return the sum of one figure over the sum of another (of means: the same)."""
        return self._of([over, under], lambda sums: sums[:, 0] / sums[:, 1])

    def correlation(self, x: Sequence[float], y: Sequence[float]) -> Bootstrapped | None:
        """Return Pearson's r, None where one of the two never changes."""
        a, b = np.asarray(x, float), np.asarray(y, float)
        if len(a) < 3 or not a.std() or not b.std():
            return None
        a, b = (a - a.mean()) / a.std(), (b - b.mean()) / b.std()
        return self._of([np.ones(len(a)), a, b, a * a, b * b, a * b], _correlation)

    def _of(self, columns: Sequence[Sequence[float] | Floats], of: Statistic) -> Bootstrapped:
        sums = np.column_stack(columns).astype(np.float64)
        found = bootstrap(sums, of, number=len(sums), times=self._times)
        value = float("nan") if found.value is None else _short(found.value)
        if found.interval is None:
            return Bootstrapped(value=value)
        low, high = _short(found.interval.low), _short(found.interval.high)
        return Bootstrapped(value=value, low=low, high=high)


def _correlation(sums: Floats) -> Floats:
    """Return Pearson's r from sums of 1, a, b, their squares and their product."""
    number, a, b, aa, bb, ab = sums.T
    spread = (number * aa - a * a) * (number * bb - b * b)
    return np.where(spread > 1e-9, (number * ab - a * b) / np.sqrt(spread), np.nan)


def _short(value: float) -> float:
    """Round so that results do not hang on the last bits of a sum."""
    return round(value, 5)


# ----------------------------------------------------------------- policies by name


class PolicyName(NamedTuple):
    """A policy text in parts: `wtinylfu-karma[9,1] W=inf`.

    >>> name = PolicyName.of("wtinylfu-karma[23,2] W=inf")
    >>> name.size, name.division, name.family, name.line
    (25, '[23,2]', 'wtinylfu-karma W=inf', 'wtinylfu-karma 9/1 W=inf')
    """

    policy: str
    division: str  # the size as the text has it; "" without any
    options: str

    @classmethod
    def of(cls, text: str) -> Self:
        """Return the parts of a policy text; KarmaError if it has another form."""
        found = _TEXT.fullmatch(text.strip())
        if found is None:
            raise KarmaError(f"{text!r} is no policy, as fifo-merge[10] is")
        return cls(found[1], found[2] or "", found[3])

    @property
    def lines(self) -> list[int]:
        """The lines of each segment."""
        return [int(number) for number in re.findall(r"\d+", self.division)]

    @property
    def size(self) -> int:
        """The lines in all."""
        return sum(self.lines)

    @property
    def family(self) -> str:
        """The text without its size."""
        return self.policy + self.options

    @property
    def line(self) -> str:
        """The name that the sizes of a policy share, with their division."""
        if len(self.lines) < 2:
            return self.family
        window, main = self.lines
        share = f"{window},{main}"
        if main == max(1, (window + main) // 10):
            share = "9/1"
        elif window == 1:
            share = "1/9"
        return f"{self.policy} {share}{self.options}"

    def at_size(self, size: int) -> str:
        """Return the text at a size, which a share as `[9/1]` divides."""
        if self.division:
            window, main = self.lines
            lines = max(1, size * main // max(window + main, 1))
            return f"{self.policy}[{size - lines},{lines}]{self.options}"
        return f"{self.policy}[{size}]{self.options}"


def sized(policies: Iterable[str], sizes: Sequence[int]) -> tuple[str, ...]:
    """Return policies in the notation of `make_policy`, each without a size at all sizes.

    `lru` takes all sizes, as does `wtinylfu-karma W=inf`; `wtinylfu-caffeine[9/1]` divides each
    size nine to one, the main segment at least one line; `lru[10]` stays what it is.

    Raises:
        KarmaError: a text is no policy, or a policy without a size has none given.
        UnknownNameError: no such policy is registered.
    """
    found: dict[str, None] = {}
    for text in policies:
        name = PolicyName.of(text)
        if name.division and "/" not in name.division:
            found[text.strip()] = None
        elif not sizes:
            fix = f"give sizes = [10], or write {name.policy}[10]"
            raise KarmaError(f"policy {text!r} has no size: {fix}")
        else:
            found |= dict.fromkeys(map(name.at_size, sizes))
    for text in found:
        make_policy(text.replace(BELADY, "lru", 1) if text.startswith(f"{BELADY}[") else text)
    return tuple(found)


# ----------------------------------------------------------------- sweeps


class Point(msgspec.Struct, frozen=True, kw_only=True):
    """The hit rate from the empty memory up to a number of tasks."""

    tasks: int
    rate: Bootstrapped


class PolicyRow(msgspec.Struct, frozen=True, kw_only=True):
    """Results of a policy; the lists have an entry per sequence."""

    policy: str
    size: int
    cold: Bootstrapped | None  # all tasks, from the empty memory on; None: nothing was asked
    first: Bootstrapped | None  # the first 100 tasks
    steady: Bootstrapped | None  # the second half of the tasks
    warm: Bootstrapped | None  # from the task on that found the memory 95 % full; None: not in each
    hits: list[int]
    steady_hits: list[int]
    left: float | None  # units that left, per sequence; None for the bound
    warm_task: float | None  # tasks until the memory was 95 % full, mean; None: not in each
    curve: list[Point]

    @property
    def name(self) -> PolicyName:
        """The policy in parts."""
        return PolicyName.of(self.policy)


class Sweep(msgspec.Struct, frozen=True, kw_only=True):
    """All rows over the same sequences."""

    requests: list[int]  # of each sequence
    steady_requests: list[int]
    units: float  # distinct ones a sequence, mean
    interval: str  # what the intervals are over
    rows: list[PolicyRow]


def run_rows(
    traces: Sequence[Trace],
    policies: Iterable[str],
    *,
    checkpoints: Sequence[int] = (),
    seed: int = 0,
) -> Iterator[PolicyRow]:
    """Run every policy over every sequence, and yield each policy's row.

    `checkpoints`: numbers of tasks for `PolicyRow.curve`.
    """
    resampler = Resampler(len(traces), seed)
    for policy in policies:
        run = simulator(policy)
        outcomes = [run(trace) for trace in traces]
        yield _row(policy, outcomes, resampler, checkpoints)


def sweep_of(traces: Sequence[Trace], rows: Iterable[PolicyRow]) -> Sweep:
    """Return rows together with the sequences that they are of."""
    halves = [trace.starts[len(trace.tasks) // 2] for trace in traces]
    return Sweep(
        requests=[trace.requests for trace in traces],
        steady_requests=[t.requests - half for t, half in zip(traces, halves, strict=True)],
        units=round(sum(len(trace.keys) for trace in traces) / len(traces), 3),
        interval=(
            f"none: {len(traces)} sequences say little of others, it takes {FEWEST_TASKS}"
            if len(traces) < FEWEST_TASKS
            else "bootstrap over sequences"
        ),
        rows=list(rows),
    )


def _rate_over(
    outcomes: Sequence[TraceReplay], spans: Sequence[tuple[int, int]], resampler: Resampler
) -> Bootstrapped | None:
    """Return the mean rate over some tasks of each outcome; None where one asked nothing."""
    rates = [one.rate(*span) for one, span in zip(outcomes, spans, strict=True)]
    known = [rate for rate in rates if rate is not None]
    return resampler.mean(known) if len(known) == len(rates) else None


def _row(
    policy: str, outcomes: list[TraceReplay], resampler: Resampler, checkpoints: Sequence[int]
) -> PolicyRow:
    every = [(0, outcome.tasks) for outcome in outcomes]
    halves = [(one.tasks // 2, one.tasks) for one in outcomes]
    warm = [one.warm_task for one in outcomes if one.warm_task is not None]
    left = [one.left for one in outcomes if one.left is not None]
    filled = len(warm) == len(outcomes)
    after = [(one.warm_task or 0, one.tasks) for one in outcomes]
    curve = [
        Point(tasks=tasks, rate=rate)
        for tasks in checkpoints
        if tasks <= max(one.tasks for one in outcomes)
        if (rate := _rate_over(outcomes, [(0, tasks)] * len(outcomes), resampler)) is not None
    ]
    return PolicyRow(
        policy=policy,
        size=PolicyName.of(policy).size,
        cold=_rate_over(outcomes, every, resampler),
        first=_rate_over(outcomes, [(0, FIRST_TASKS)] * len(outcomes), resampler),
        steady=_rate_over(outcomes, halves, resampler),
        warm=_rate_over(outcomes, after, resampler) if filled else None,
        hits=[one.hits for one in outcomes],
        steady_hits=[one.between(*span)[0] for one, span in zip(outcomes, halves, strict=True)],
        left=round(sum(left) / len(left), 3) if left else None,
        warm_task=round(sum(warm) / len(warm), 3) if filled else None,
        curve=curve,
    )


class Exploration(msgspec.Struct, frozen=True, kw_only=True):
    """Hit rate and reduced exploration of a policy, a pair per sequence, with a fitted line.

    A unit that is in memory is found without a search; for any other one the receptacles of its
    room are visited in the order of how likely they hold it (`tasks.Finds`). Reduced exploration
    (KARMA section 4.2) is the share of all those stops that hits save: a hit rate in which dear
    units weigh more. That it rises with the hit rate is nearly certain by construction.
    """

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

    `costs`: for each request of each sequence, the stops of its search.
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
