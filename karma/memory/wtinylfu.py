"""W-TinyLFU in two readings: Caffeine's, and the letter of KARMA §3.6.

Both have a window (LRU) and a main segment, divided into a protected segment of floor(0.8 main)
lines and an elimination segment (Caffeine: probation). A newcomer enters the window; a window over
its size passes its least recently used key on to the elimination segment. They differ in who
leaves a full memory:

- `CaffeineWTinyLfu`: the key that the window passes on against the least recently used one of the
  elimination segment; the challenger stays only if it was used strictly more often.
- `KarmaWTinyLfu`: "a comparison occurs among all units in the window segment and the elimination
  segment", the newcomer included; the least often used one goes, of equals the least recently
  used.

With [9,1] nothing is protected, so KARMA's reading compares all units: an LFU that ages.

Uses are counted exactly, or in a 4-bit counting sketch; both age by halving (KARMA §3.6, "reset
method"): every use adds one to a global counter; when that reaches the period W, all counts are
halved, and the global counter with them (Einziger and Friedman 2014).
"""

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Hashable, Iterator
from hashlib import blake2b
from typing import Generic, Literal, TypeVar

from karma.memory.policies import checked_capacity

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


PROTECTED_SHARE = 0.8  # of the main segment


class _WTinyLfu(ABC, Generic[K]):
    """What both readings are made with.

    Args:
        capacity: lines in all.
        window: lines of the window; default: the reading's own share.
        period: W, uses between two halvings; None = never, and then counts have no cap.
        sketch: count in a `CountMin4` instead of exactly.
    """

    _count_saturated: bool  # whether a use of a key at the cap counts towards the period

    def __init__(
        self,
        capacity: int,
        *,
        window: int | None = None,
        period: Period = "default",
        sketch: bool = False,
    ) -> None:
        self.capacity = checked_capacity(capacity)
        self.window_size = self._window_of(capacity) if window is None else window
        if not 0 <= self.window_size <= capacity:
            raise ValueError(f"window must be between 0 and the capacity {capacity}, not {window}")
        self.protected_size = int(PROTECTED_SHARE * (capacity - self.window_size))
        self.counts = self._counts(period, sketch=sketch)
        self._window: OrderedDict[K, None] = OrderedDict()
        self._protected: OrderedDict[K, None] = OrderedDict()
        self._rest: OrderedDict[K, None] = OrderedDict()  # what that is, each reading says

    @staticmethod
    @abstractmethod
    def _window_of(capacity: int) -> int:
        """Return how many lines the window has unless it is said."""

    def _counts(self, period: Period, *, sketch: bool) -> CountMin4[K] | ExactCounts[K]:
        saturated = self._count_saturated
        if sketch:
            return CountMin4(self.capacity, period=period, count_saturated=saturated)
        period = 10 * self.capacity if period == "default" else period
        cap = None if period is None else CAP
        return ExactCounts(period, cap=cap, count_saturated=saturated)

    def discard(self, key: K) -> None:
        """Free the line of `key`; its count stays."""
        for keys in (self._window, self._protected, self._rest):
            keys.pop(key, None)


class CaffeineWTinyLfu(_WTinyLfu[K]):
    """W-TinyLFU as Caffeine's simulator has it (`WindowTinyLfuPolicy`).

    The window is what floor(0.99 capacity) leaves over, the period 10 x capacity (exact counts) or
    10 x table words (sketch). The elimination segment is `_rest`.
    """

    _count_saturated = False

    @staticmethod
    def _window_of(capacity: int) -> int:
        return capacity - capacity * 99 // 100

    def touch(self, key: K) -> K | None:
        """Count one use of `key`, insert or move it; return the key that left."""
        self.counts.add(key)
        if key in self._window:
            self._window.move_to_end(key)
        elif key in self._protected:
            self._protected.move_to_end(key)
        elif key in self._rest:
            self._promote(key)
        else:
            self._window[key] = None
            if len(self._window) > self.window_size:
                return self._pass_on()
        return None

    def _promote(self, key: K) -> None:
        del self._rest[key]
        self._protected[key] = None
        if len(self._protected) > self.protected_size:
            demoted, _ = self._protected.popitem(last=False)
            self._rest[demoted] = None

    def _pass_on(self) -> K | None:
        """Move the window's oldest key on; in a full memory it must win its place."""
        challenger, _ = self._window.popitem(last=False)
        self._rest[challenger] = None
        if len(self) <= self.capacity:
            return None
        victim = next(iter(self._rest))
        estimate = self.counts.estimate
        left = victim if estimate(challenger) > estimate(victim) else challenger
        del self._rest[left]
        return left

    def __contains__(self, key: object) -> bool:
        return key in self._window or key in self._protected or key in self._rest

    def __len__(self) -> int:
        return len(self._window) + len(self._rest) + len(self._protected)

    def __iter__(self) -> Iterator[K]:
        """Yield the window, then the elimination segment, then the protected one."""
        yield from self._window
        yield from self._rest
        yield from self._protected


class KarmaWTinyLfu(_WTinyLfu[K]):
    """W-TinyLFU by the letter of KARMA §3.6; what the text leaves open is in the module's head.

    Finding who leaves looks at every line, which suits a memory of tens. The window is nine tenths,
    the paper's best split ([9,1], §4.4), the period 10 x capacity: the paper gives none. All
    residents by their last use are `_rest`.
    """

    _count_saturated = True

    @staticmethod
    def _window_of(capacity: int) -> int:
        return capacity - capacity // 10

    def _counts(self, period: Period, *, sketch: bool) -> CountMin4[K] | ExactCounts[K]:
        period = 10 * self.capacity if period == "default" else period
        return super()._counts(period, sketch=sketch)

    def touch(self, key: K) -> K | None:
        """Count one use of `key`, insert or move it; return the key that left."""
        self.counts.add(key)
        if key not in self._rest:
            return self._enter(key)
        self._rest.move_to_end(key)
        if key in self._window:
            self._window.move_to_end(key)
        elif self.protected_size:
            self._protected[key] = None
            self._protected.move_to_end(key)
            if len(self._protected) > self.protected_size:
                self._protected.popitem(last=False)  # demoted to the elimination segment
        return None

    def _enter(self, key: K) -> K | None:
        self._rest[key] = self._window[key] = None
        left = None
        if len(self._rest) > self.capacity:
            if self._protected:
                candidates = [other for other in self._rest if other not in self._protected]
            else:
                candidates = list(self._rest)
            left = min(candidates, key=self.counts.estimate)  # the first of equals: oldest use
            self.discard(left)
        if len(self._window) > self.window_size:
            self._window.popitem(last=False)  # passed on to the elimination segment
        return left

    def __contains__(self, key: object) -> bool:
        return key in self._rest

    def __len__(self) -> int:
        return len(self._rest)

    def __iter__(self) -> Iterator[K]:
        """Yield keys, least recently used first."""
        return iter(self._rest)
