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
"""

from collections import OrderedDict
from collections.abc import Hashable, Iterator
from typing import Generic, TypeVar

from karma.memory.policies import checked_capacity
from karma.memory.sketch import CAP, CountMin4, ExactCounts, Period

K = TypeVar("K", bound=Hashable)

PROTECTED_SHARE = 0.8  # of the main segment


class _WTinyLfu(Generic[K]):
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
    def _window_of(capacity: int) -> int:
        """Return how many lines the window has unless it is said."""
        raise NotImplementedError

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
