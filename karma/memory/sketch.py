"""How often a key was used lately: exact counts, and a 4-bit counting sketch; both age by halving.

Aging (KARMA §3.6, "reset method"): every use adds one to a global counter; when that reaches the
period W, all counts are halved, and the global counter with them (Einziger and Friedman 2014).
"""

from collections.abc import Hashable
from hashlib import blake2b
from typing import Generic, Literal, TypeVar

K = TypeVar("K", bound=Hashable)

Period = int | Literal["default"] | None  # W; None = never

CAP = 15  # the largest 4-bit count
ROWS = 4  # counters per key

_SEEDS = (0xC3A5C85C97CB3127, 0xB492B66FBE98F273, 0x9AE16A3B2F90404F, 0xCBF29CE484222325)
_M32, _M64 = (1 << 32) - 1, (1 << 64) - 1


class ExactCounts(Generic[K]):
    """One exact count per key: the reference for a sketch.

    Args:
        period: W, uses between two halvings; None = never.
        cap: largest count, as a 4-bit counter would have; None = unbounded.
        count_saturated: whether a use of a key at the cap still counts towards the period
            (KARMA: every use; Caffeine: only uses that changed a counter).
    """

    def __init__(
        self, period: int | None, *, cap: int | None = CAP, count_saturated: bool = False
    ) -> None:
        self.period = _checked_period(period)
        self.cap = cap
        self.count_saturated = count_saturated
        self.uses = 0  # since the last halving, plus half of the ones before
        self._counts: dict[K, int] = {}

    def add(self, key: K) -> None:
        """Count one use of `key`; at the period, halve every count."""
        count = self._counts.get(key, 0)
        if self.cap is None or count < self.cap:
            self._counts[key] = count + 1
        elif not self.count_saturated:
            return
        self.uses += 1
        if self.uses == self.period:
            self._halve()

    def estimate(self, key: K) -> int:
        """Return the count of `key`."""
        return self._counts.get(key, 0)

    def _halve(self) -> None:
        self._counts = {key: count // 2 for key, count in self._counts.items() if count > 1}
        self.uses //= 2


class CountMin4(Generic[K]):
    """Four 4-bit counters per key in a shared table; the smallest of them is the estimate.

    Never below the true count while no counter is at the cap. The period is shortened by the
    rounding loss of halving, as in Caffeine's simulator (`PeriodicResetCountMin4`), whose hit
    counts this reproduces for integer keys.

    Args:
        capacity: lines of the memory; the table has the next power of two words of 16 counters.
        period: W; "default" = 10 x table words, None = never.
        count_saturated: as for `ExactCounts`.
    """

    def __init__(
        self,
        capacity: int,
        *,
        period: Period = "default",
        count_saturated: bool = False,
    ) -> None:
        if capacity < 1:
            raise ValueError(f"capacity must be at least 1, not {capacity}")
        self.words = 1 << (capacity - 1).bit_length()
        self.period = _checked_period(10 * self.words if period == "default" else period)
        self.count_saturated = count_saturated
        self.uses = 0
        self._counters = bytearray(16 * self.words)
        self._slots: dict[K, tuple[int, ...]] = {}

    def add(self, key: K) -> None:
        """Count one use of `key`; at the period, halve every counter."""
        counters, added = self._counters, False
        for slot in self.places(key):
            if counters[slot] < CAP:
                counters[slot] += 1
                added = True
        if not (added or self.count_saturated):
            return
        self.uses += 1
        if self.uses == self.period:
            self._halve()

    def estimate(self, key: K) -> int:
        """Return the smallest of the counters of `key`."""
        first, second, third, fourth = self.places(key)
        counters = self._counters
        return min(counters[first], counters[second], counters[third], counters[fourth])

    def _halve(self) -> None:
        odd = sum(count & 1 for count in self._counters)
        self._counters = bytearray(count >> 1 for count in self._counters)
        self.uses = (self.uses - (odd >> 2)) >> 1

    def places(self, key: K) -> tuple[int, ...]:
        """Return the four counters of `key`."""
        places = self._slots.get(key)
        if places is None:
            if len(self._slots) > 64 * self.words:  # keep the memo small
                self._slots.clear()
            places = self._slots[key] = _places(key, self.words)
        return places


def _places(key: Hashable, words: int) -> tuple[int, ...]:
    """Return the four counters of a key, one in each quarter of its group of 16."""
    spread = _fold(key)
    for _ in range(2):
        spread = (((spread >> 16) ^ spread) * 0x45D9F3B) & _M32
    spread = (spread >> 16) ^ spread
    signed = spread - (1 << 32) if spread >> 31 else spread
    start = (spread & 3) << 2
    found = []
    for row, seed in enumerate(_SEEDS):
        word = ((signed + seed) * seed) & _M64
        word = (word + (word >> 32)) & (words - 1)
        found.append(16 * word + start + row)
    return tuple(found)


def _fold(key: Hashable) -> int:
    """Return 32 bits of a key, equal in every process (unlike `hash`)."""
    if isinstance(key, int):
        wide = key & _M64
    else:
        text = key if isinstance(key, str) else repr(key)
        wide = int.from_bytes(blake2b(text.encode(), digest_size=8).digest(), "big")
    return (wide ^ (wide >> 32)) & _M32


def _checked_period(period: int | None) -> int | None:
    if period is not None and period < 1:
        raise ValueError(f"period must be at least 1 or None, not {period}")
    return period
