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
from karma.memory.sketch import CAP, CountMin4, ExactCounts, Frequencies, Period

K = TypeVar("K", bound=Hashable)

PROTECTED_SHARE = 0.8  # of the main segment


class CaffeineWTinyLfu(Generic[K]):
    """W-TinyLFU as Caffeine's simulator has it (`WindowTinyLfuPolicy`).

    Args:
        capacity: lines in all.
        window: lines of the window; default: what floor(0.99 capacity) leaves over.
        period: W, counted uses between two halvings; "default" = 10 x capacity (exact counts)
            or 10 x table words (sketch), None = never, and then counts have no cap.
        sketch: count in a `CountMin4` instead of exactly.
    """

    def __init__(
        self,
        capacity: int,
        *,
        window: int | None = None,
        period: Period = "default",
        sketch: bool = False,
    ) -> None:
        self.capacity = checked_capacity(capacity)
        self.window_size = _checked_window(capacity - capacity * 99 // 100, window, capacity)
        self.protected_size = _protected(capacity - self.window_size)
        self.counts: Frequencies[K] = _counts(capacity, period, sketch, count_saturated=False)
        self._window: OrderedDict[K, None] = OrderedDict()
        self._elimination: OrderedDict[K, None] = OrderedDict()
        self._protected: OrderedDict[K, None] = OrderedDict()

    def touch(self, key: K) -> K | None:
        """Count one use of `key`, insert or move it; return the key that left."""
        self.counts.add(key)
        if key in self._window:
            self._window.move_to_end(key)
        elif key in self._protected:
            self._protected.move_to_end(key)
        elif key in self._elimination:
            self._promote(key)
        else:
            self._window[key] = None
            if len(self._window) > self.window_size:
                return self._pass_on()
        return None

    def discard(self, key: K) -> None:
        """Free the line of `key`; its count stays."""
        for segment in (self._window, self._elimination, self._protected):
            segment.pop(key, None)

    def _promote(self, key: K) -> None:
        del self._elimination[key]
        self._protected[key] = None
        if len(self._protected) > self.protected_size:
            demoted, _ = self._protected.popitem(last=False)
            self._elimination[demoted] = None

    def _pass_on(self) -> K | None:
        """Move the window's oldest key on; in a full memory it must win its place."""
        challenger, _ = self._window.popitem(last=False)
        self._elimination[challenger] = None
        if len(self) <= self.capacity:
            return None
        victim = next(iter(self._elimination))
        estimate = self.counts.estimate
        left = victim if estimate(challenger) > estimate(victim) else challenger
        del self._elimination[left]
        return left

    def __contains__(self, key: object) -> bool:
        return key in self._window or key in self._protected or key in self._elimination

    def __len__(self) -> int:
        return len(self._window) + len(self._elimination) + len(self._protected)

    def __iter__(self) -> Iterator[K]:
        """Yield the window, then the elimination segment, then the protected one."""
        yield from self._window
        yield from self._elimination
        yield from self._protected


class KarmaWTinyLfu(Generic[K]):
    """W-TinyLFU by the letter of KARMA §3.6; what the text leaves open is in the module's head.

    Finding who leaves looks at every line, which suits a memory of tens.

    Args:
        capacity: lines in all.
        window: lines of the window; default: nine tenths, the paper's best split ([9,1], §4.4).
        period: W, uses between two halvings; "default" = 10 x capacity (the paper gives none),
            None = never, and then counts have no cap.
        sketch: count in a `CountMin4` instead of exactly.
    """

    def __init__(
        self,
        capacity: int,
        *,
        window: int | None = None,
        period: Period = "default",
        sketch: bool = False,
    ) -> None:
        self.capacity = checked_capacity(capacity)
        self.window_size = _checked_window(capacity - capacity // 10, window, capacity)
        self.protected_size = _protected(capacity - self.window_size)
        period = 10 * capacity if period == "default" else period
        self.counts: Frequencies[K] = _counts(capacity, period, sketch, count_saturated=True)
        self._order: OrderedDict[K, None] = OrderedDict()  # all residents, by last use
        self._window: OrderedDict[K, None] = OrderedDict()
        self._protected: OrderedDict[K, None] = OrderedDict()

    def touch(self, key: K) -> K | None:
        """Count one use of `key`, insert or move it; return the key that left."""
        self.counts.add(key)
        if key not in self._order:
            return self._enter(key)
        self._order.move_to_end(key)
        if key in self._window:
            self._window.move_to_end(key)
        elif self.protected_size:
            self._protected[key] = None
            self._protected.move_to_end(key)
            if len(self._protected) > self.protected_size:
                self._protected.popitem(last=False)  # demoted to the elimination segment
        return None

    def discard(self, key: K) -> None:
        """Free the line of `key`; its count stays."""
        for keys in (self._order, self._window, self._protected):
            keys.pop(key, None)

    def _enter(self, key: K) -> K | None:
        self._order[key] = self._window[key] = None
        left = None
        if len(self._order) > self.capacity:
            if self._protected:
                candidates = [other for other in self._order if other not in self._protected]
            else:
                candidates = list(self._order)
            left = min(candidates, key=self.counts.estimate)  # the first of equals: oldest use
            self.discard(left)
        if len(self._window) > self.window_size:
            self._window.popitem(last=False)  # passed on to the elimination segment
        return left

    def __contains__(self, key: object) -> bool:
        return key in self._order

    def __len__(self) -> int:
        return len(self._order)

    def __iter__(self) -> Iterator[K]:
        """Yield keys, least recently used first."""
        return iter(self._order)


def _checked_window(default: int, window: int | None, capacity: int) -> int:
    if window is None:
        return default
    if not 0 <= window <= capacity:
        raise ValueError(f"window must be between 0 and the capacity {capacity}, not {window}")
    return window


def _protected(main: int) -> int:
    return int(PROTECTED_SHARE * main)


def _counts(
    capacity: int, period: Period, sketch: bool, *, count_saturated: bool
) -> CountMin4[K] | ExactCounts[K]:
    if sketch:
        return CountMin4(capacity, period=period, count_saturated=count_saturated)
    period = 10 * capacity if period == "default" else period
    return ExactCounts(period, cap=None if period is None else CAP, count_saturated=count_saturated)
