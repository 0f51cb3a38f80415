"""Compute intervals and paired tests.

Everything here takes numbers grouped by task, because seeds of one task are not independent of each
other: a task is hard for all of them. Definitions are in `docs/metrics.md`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from karma.journal.formats import range_text
from karma.seeds import stream

Groups = Sequence[Sequence[float]]  # observations, task by task
Floats = NDArray[np.float64]
Statistic = Callable[[Floats], Floats]  # sums, shape (n, columns) -> values, shape (n,); nan = none

LEVEL = 0.95  # of every interval
RESAMPLES = 10_000
FEWEST_TASKS = 6  # below it no sign-flip test of tasks reaches 0.05, and resamples pretend
_Z = NormalDist().inv_cdf((1 + LEVEL) / 2)  # half the width of an interval, in deviations


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfidenceInterval:
    """A confidence interval of level `LEVEL`."""

    low: float
    high: float

    def __contains__(self, value: object) -> bool:
        return isinstance(value, int | float) and self.low <= value <= self.high


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A figure and how sure it is; None where nothing was observed."""

    value: float | None
    interval: ConfidenceInterval | None = None
    number: int = 0  # observations behind it


# ----------------------------------------------------------------- rates


def wilson(successes: float, number: float) -> ConfidenceInterval | None:
    """Return Wilson's score interval of a rate; None when nothing was tried.

    Successes are a fraction where `number` is an effective one.

    Raises:
        ValueError: more successes than trials, or fewer than none.
    """
    if not 0 <= successes <= number:
        raise ValueError(f"{successes} successes of {number}")
    if number == 0:
        return None
    rate, z = successes / number, _Z
    middle = rate + z * z / (2 * number)
    spread = z * math.sqrt(rate * (1 - rate) / number + z * z / (4 * number * number))
    scale = 1 + z * z / number
    return ConfidenceInterval(
        low=max(0.0, min(rate, (middle - spread) / scale)),
        high=min(1.0, max(rate, (middle + spread) / scale)),
    )


def rate(groups: Groups) -> Estimate:
    """Return a rate with Wilson's interval over the effective number of observations."""
    number = sum(len(group) for group in groups)
    if not number:
        return Estimate(value=None)
    value = sum(sum(group) for group in groups) / number
    effective = effective_number(groups)
    return Estimate(value=value, interval=wilson(value * effective, effective), number=number)


def effective_number(groups: Groups) -> float:
    """Return how many independent observations are worth as much as these.

    Kish's design effect with the intra-class correlation of a one-way analysis of variance: five
    seeds that always agree count once, five that agree by chance only count five times. Where
    nothing varies nothing is known about the correlation, and each task counts once.
    """
    groups = [group for group in groups if group]
    number = sum(len(group) for group in groups)
    if not number:
        return 0.0
    correlation = _correlation(groups)
    if correlation is None:  # one group, or one observation each
        return float(number)
    size = sum(len(group) ** 2 for group in groups) / number
    return number / (1 + (size - 1) * correlation)


def _correlation(groups: Groups) -> float | None:
    """Return the intra-class correlation in [0, 1]; None where it cannot be known."""
    sizes = np.array([len(group) for group in groups], dtype=float)
    total, tasks = sizes.sum(), len(groups)
    if tasks < 2 or total == tasks:
        return None
    means = np.array([np.mean(group) for group in groups])
    everything = float((sizes * means).sum() / total)
    between = float((sizes * (means - everything) ** 2).sum()) / (tasks - 1)
    pairs = zip(groups, means, strict=True)
    within = sum(float(((np.array(group) - mean) ** 2).sum()) for group, mean in pairs)
    within /= total - tasks
    usual = float(total - (sizes**2).sum() / total) / (tasks - 1)
    scale = between + (usual - 1) * within
    if scale <= 1e-12:
        return 1.0
    return float(min(1.0, max(0.0, (between - within) / scale)))


# ----------------------------------------------------------------- anything else


def mean(groups: Groups) -> Estimate:
    """Return the mean of some amounts, with a bootstrap interval over tasks."""
    groups = [group for group in groups if group]
    number = sum(len(group) for group in groups)
    if not number:
        return Estimate(value=None)
    sums = np.array([[sum(group), len(group)] for group in groups], dtype=float)
    return bootstrap(sums, lambda s: s[:, 0] / s[:, 1], number=number)


def bootstrap(
    sums: Floats, statistic: Statistic, *, number: int, times: Floats | None = None
) -> Estimate:
    """Return a statistic of sums over tasks, with its percentile interval over resampled tasks.

    All seeds and both arms of a task stay together. The resamples come from a random stream of
    their own and are the same in every process; the interval reaches at least to the value itself.
    Fewer tasks than `FEWEST_TASKS` have no interval.

    Args:
        sums: of shape (tasks, columns); the order of tasks matters only with `times`.
        statistic: a value for each line of sums.
        number: observations behind the sums.
        times: resamples of these tasks, see `times_in`; None: `RESAMPLES` of our own.
    """
    if not len(sums):
        return Estimate(value=None)
    with np.errstate(all="ignore"):
        value = float(statistic(sums.sum(axis=0, keepdims=True))[0])
        if not math.isfinite(value):
            return Estimate(value=None)
        unsure = Estimate(value=value, number=number)
        if len(sums) < FEWEST_TASKS:
            return unsure
        if times is None:
            times, sums = _times(len(sums)), sums[np.lexsort(sums.T)]
        drawn = statistic(times @ sums)
    drawn = drawn[np.isfinite(drawn)]
    if len(drawn) < len(times) / 2:
        return unsure
    tail = (1 - LEVEL) / 2
    low, high = (float(edge) for edge in np.quantile(drawn, [tail, 1 - tail]))
    return replace(unsure, interval=ConfidenceInterval(low=min(low, value), high=max(high, value)))


@lru_cache(maxsize=8)
def _times(tasks: int) -> Floats:
    """Return how often each task is in each resample, shape (RESAMPLES, tasks)."""
    times = stream(0, "bootstrap").multinomial(tasks, [1 / tasks] * tasks, size=RESAMPLES)
    return times.astype(np.float64)


def times_in(rng: np.random.Generator, tasks: int, resamples: int) -> Floats:
    """Return how often each task is in each resample, shape (resamples, tasks)."""
    drawn = rng.integers(tasks, size=(resamples, tasks))
    return np.array([np.bincount(one, minlength=tasks) for one in drawn], dtype=np.float64)


# ----------------------------------------------------------------- two arms


def mcnemar(only_first: int, only_second: int) -> float:
    """Return the exact two-sided p of a paired comparison of successes.

    >>> mcnemar(0, 0), mcnemar(6, 0), mcnemar(5, 5)
    (1.0, 0.03125, 1.0)
    """
    from scipy.stats import binomtest

    pairs = only_first + only_second
    return float(binomtest(only_first, pairs).pvalue) if pairs else 1.0


def sign_flip(differences: Sequence[int]) -> float:
    """Return the exact two-sided p of a paired comparison whose pairs come in groups.

    Under no difference each group's arms could as well be exchanged. With one pair a group this is
    McNemar's exact test.

    Each difference is a group's successes of the first arm less those of the second.

    >>> sign_flip([]), sign_flip([1] * 6), sign_flip([5] * 6), sign_flip([1, -1])
    (1.0, 0.03125, 0.03125, 1.0)
    """
    counts = {0: 1}  # sum -> in how many exchanges
    for difference in filter(None, differences):
        after: dict[int, int] = {}
        for so_far, ways in counts.items():
            for total in (so_far - difference, so_far + difference):
                after[total] = after.get(total, 0) + ways
        counts = after
    seen = abs(sum(differences))
    p: float = sum(n for total, n in counts.items() if abs(total) >= seen) / sum(counts.values())
    return p


def interval_text(measured: Estimate, digits: int = 2, *, sign: bool = False) -> str:
    """Return a figure with its interval."""
    ends = measured.interval
    low, high = (ends.low, ends.high) if ends else (None, None)
    return range_text(measured.value, low, high, digits, sign=sign)
