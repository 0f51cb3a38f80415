"""Bootstrap intervals: over sequences where there are several, over blocks of tasks within one."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from karma.seeds import stream

RESAMPLES = 2000
LEVEL = 0.95
FEWEST = 6  # sequences, or blocks, that an interval takes; of fewer resamples pretend

Vector = npt.NDArray[np.float64]


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
    """The same resamples of some sequences for every figure, so that differences are paired.

    Args:
        count: sequences.
        seed: of the resamples.
    """

    def __init__(self, count: int, seed: int) -> None:
        self.count = count
        drawn = stream(seed, "lab", "bootstrap").integers(count, size=(RESAMPLES, count))
        self._drawn = drawn
        weights = np.zeros((RESAMPLES, count))
        np.add.at(weights, (np.arange(RESAMPLES)[:, None], drawn), 1)
        self._weights = weights

    def mean(self, values: Sequence[float]) -> Bootstrapped:
        """Return the mean of a figure over sequences."""
        return self.ratio(values, [1.0] * len(values))

    def ratio(self, over: Sequence[float], under: Sequence[float]) -> Bootstrapped:
        """Return the sum of one figure over the sum of another (of means: the same)."""
        a, b = np.asarray(over, float), np.asarray(under, float)
        # einsum adds in one order on every machine; BLAS does not
        tops = np.einsum("rs,s->r", self._weights, a, optimize=False)
        bottoms = np.einsum("rs,s->r", self._weights, b, optimize=False)
        keep = bottoms > 0
        value = float(a.sum() / b.sum()) if b.sum() else float("nan")
        return self._interval(value, tops[keep] / bottoms[keep])

    def correlation(self, x: Sequence[float], y: Sequence[float]) -> Bootstrapped | None:
        """Return Pearson's r, None where one of the two never changes."""
        a, b = np.asarray(x, float), np.asarray(y, float)
        if len(a) < 3 or not a.std() or not b.std():
            return None
        value = float(_correlations(a[None, :], b[None, :])[0])
        drawn = _correlations(a[self._drawn], b[self._drawn])
        return self._interval(value, drawn[np.isfinite(drawn)])

    def _interval(self, value: float, drawn: Vector) -> Bootstrapped:
        if self.count < FEWEST or not len(drawn):
            return Bootstrapped(value=_short(value))
        low, high = np.quantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
        return Bootstrapped(value=_short(value), low=_short(float(low)), high=_short(float(high)))


def block_interval(hits: Sequence[int], requests: Sequence[int], seed: int) -> Bootstrapped | None:
    """Return the hit rate of one sequence with an interval over blocks of its tasks.

    Neighbouring tasks need the same things, so whole blocks of about the square root of their
    number are drawn again. None where nothing was asked.

    Args:
        hits: per task.
        requests: per task.
        seed: of the resamples.
    """
    if not sum(requests):
        return None
    size = max(1, round(len(hits) ** 0.5))
    starts = range(0, len(hits), size)
    parts = [(sum(hits[at : at + size]), sum(requests[at : at + size])) for at in starts]
    parts = [part for part in parts if part[1]]
    return Resampler(len(parts), seed).ratio([a for a, _ in parts], [b for _, b in parts])


def _correlations(a: Vector, b: Vector) -> Vector:
    a = a - a.mean(axis=1, keepdims=True)
    b = b - b.mean(axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = (a * b).sum(axis=1) / np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    return np.asarray(found, float)


def _short(value: float) -> float:
    """Round so that results do not hang on the last bits of a sum."""
    return round(value, 5)
