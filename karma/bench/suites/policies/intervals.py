"""Bootstrap intervals: over sequences where there are several, over blocks of tasks within one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from karma.bench.figures.statistics import Floats, Statistic, bootstrap, times_in
from karma.seeds import stream

RESAMPLES = 2000


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
        found = bootstrap(sums, of, number=len(sums), times=self._times).estimate
        value = float("nan") if found.value is None else _short(found.value)
        if found.interval is None:
            return Bootstrapped(value=value)
        low, high = _short(found.interval.low), _short(found.interval.high)
        return Bootstrapped(value=value, low=low, high=high)


def block_interval(hits: Sequence[int], requests: Sequence[int], seed: int) -> Bootstrapped | None:
    """Return the hit rate of one sequence with an interval over blocks of its tasks.

    Neighbouring tasks need the same things, so whole blocks of about the square root of their
    number are drawn again. None where nothing was asked.
    """
    if not sum(requests):
        return None
    size = max(1, round(len(hits) ** 0.5))
    starts = range(0, len(hits), size)
    parts = [(sum(hits[at : at + size]), sum(requests[at : at + size])) for at in starts]
    parts = [part for part in parts if part[1]]
    return Resampler(len(parts), seed).ratio([a for a, _ in parts], [b for _, b in parts])


def _correlation(sums: Floats) -> Floats:
    """Return Pearson's r from sums of 1, a, b, their squares and their product."""
    number, a, b, aa, bb, ab = sums.T
    spread = (number * aa - a * a) * (number * bb - b * b)
    return np.where(spread > 1e-9, (number * ab - a * b) / np.sqrt(spread), np.nan)


def _short(value: float) -> float:
    """Round so that results do not hang on the last bits of a sum."""
    return round(value, 5)
