"""Compute intervals, paired tests and detectable effects.

Everything here takes numbers grouped by task, because seeds of one task are not independent of each
other: a task is hard for all of them. Definitions are in `docs/metrics.md`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.journal.formats import range_text
from karma.seeds import stream

Groups = Sequence[Sequence[float]]  # observations, task by task
Floats = NDArray[np.float64]
Statistic = Callable[[Floats], Floats]  # sums, shape (n, columns) -> values, shape (n,); nan = none

LEVEL = 0.95  # of every interval
POWER = 0.8  # of the minimum detectable effect
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
    return bootstrap(sums, lambda s: s[:, 0] / s[:, 1], number=number).estimate


class Resampled(NamedTuple):
    """A statistic over resampled tasks."""

    estimate: Estimate
    deviation: float | None = None  # standard error; None where nothing varies or one task is all


def bootstrap(
    sums: Floats,
    statistic: Statistic,
    *,
    number: int,
    times: Floats | None = None,
) -> Resampled:
    """Return a statistic of sums over tasks, with its percentile interval over resampled tasks.

    All seeds and both arms of a task stay together. The interval is drawn from a stream of its own,
    so it is the same in every process; it reaches at least to the value itself.

    The sums are of shape (tasks, columns); the order of tasks does not matter without `times`,
    which are resamples of these tasks as `times_in` draws them; None: ours. `number` counts
    observations. Of fewer tasks than `FEWEST_TASKS` there is no interval.
    """
    if not len(sums):
        return Resampled(Estimate(value=None))
    with np.errstate(all="ignore"):
        value = float(statistic(sums.sum(axis=0, keepdims=True))[0])
        if not math.isfinite(value):
            return Resampled(Estimate(value=None))
        unsure = Resampled(Estimate(value=value, number=number))
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
    interval = ConfidenceInterval(low=min(low, value), high=max(high, value))
    deviation = float(drawn.std())
    estimate = Estimate(value=value, interval=interval, number=number)
    return Resampled(estimate, deviation if deviation > 1e-12 else None)


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


def detectable_rate(pairs: float, discordant: float) -> float | None:
    """Return the smallest difference of two success rates that McNemar's exact test would find.

    Found means p <= 0.05 in 80 % of experiments of this size.

    Of the effective number of pairs the whole part counts. `discordant` is the share of pairs in
    which the arms differ, as observed: a difference cannot be larger than it; where even such a one
    would escape, the share grows with the difference.

    Returns:
        None when even a difference of 1 would escape: fewer than six pairs.
    """
    number = math.floor(pairs)
    if number < 1 or _power(number, 1.0, 1.0) < POWER:
        return None
    share = min(max(discordant, 0.0), 1.0)
    if share > 0 and _power(number, share, share) >= POWER:
        return _smallest(lambda effect: _power(number, share, effect), share)
    return _smallest(lambda effect: _power(number, effect, effect), 1.0)


def detectable_mean(deviation: float | None) -> float | None:
    """Return the smallest difference found in 80 % of experiments, from its standard error."""
    if deviation is None:
        return None
    return (_Z + NormalDist().inv_cdf(POWER)) * deviation


def _power(number: int, discordant: float, effect: float) -> float:
    """Return the chance that McNemar's exact test finds a difference of rates.

    `discordant` is the share of pairs in which the arms differ.
    """
    from scipy.stats import binom

    first = (discordant + effect) / (2 * discordant) if discordant else 0.5
    counts = np.arange(number + 1)
    differing = binom.pmf(counts, number, min(discordant, 1.0))
    splits = binom.pmf(counts[None, :], counts[:, None], min(first, 1.0))
    return float((differing * (splits * _rejected(number)).sum(axis=1)).sum())


@lru_cache(maxsize=8)
def _rejected(number: int) -> NDArray[np.bool_]:
    """Return whether the test rejects, by discordant pairs and how many of them the first solved.

    Shape (number + 1, number + 1).
    """
    from scipy.stats import binom

    pairs, first = np.arange(number + 1)[:, None], np.arange(number + 1)[None, :]
    p = 2 * binom.cdf(np.minimum(first, pairs - first), pairs, 0.5)
    return np.asarray((p <= 1 - LEVEL) & (first <= pairs))


def _smallest(power: Callable[[float], float], most: float) -> float:
    low, high = 0.0, most
    while high - low > 1e-4:
        middle = (low + high) / 2
        low, high = (low, middle) if power(middle) >= POWER else (middle, high)
    return high


def interval_text(measured: Estimate, digits: int = 2, *, sign: bool = False) -> str:
    """Return a figure with its interval."""
    ends = measured.interval
    low, high = (ends.low, ends.high) if ends else (None, None)
    return range_text(measured.value, low, high, digits, sign=sign)
