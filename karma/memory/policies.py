"""Which line leaves a full short-term memory (KARMA §3.6): queues, LRU, LFU, ARC, and no limit.

Every policy sees keys only. `touch` is one use; asking `key in policy` is no use.
"""

import re
import sys
from collections import Counter, OrderedDict, deque
from collections.abc import Hashable, Iterator
from inspect import signature
from typing import Any, Generic, TypeVar

from karma import registry
from karma.errors import KarmaError
from karma.types.roles import ReplacementPolicy

K = TypeVar("K", bound=Hashable)

_TEXT = re.compile(r"([\w-]+)\[(\d+)(?:,(\d+))?\]((?: +\S+)*)")
_FORM = "write name[size] or name[window,main], e.g. 'fifo-merge[10]', 'wtinylfu-karma[9,1] W=200'"


def make_policy(text: str) -> ReplacementPolicy:
    """Return the policy that a text in the paper's notation names.

    `fifo-merge[10]`: ten lines. `wtinylfu-karma[9,1]`: window 9, main 1. W-TinyLFU takes options
    after that: `W=200` or `W=inf` (uses between two halvings), `cm4` (4-bit sketch instead of
    exact counts). A policy takes those that its constructor has an argument for: `window`,
    `period`, `sketch`.

    Raises:
        KarmaError: not of that form, or sizes that make no memory.
        UnknownNameError: no such policy is registered.
    """
    match = _TEXT.fullmatch(text.strip())
    if match is None:
        raise KarmaError(f"policy {text!r} is not understood: {_FORM}")
    name, first, second, words = match.groups()
    kind = registry.load("policies", name)
    options = _options(text, words.split())
    capacity = int(first)
    if second is not None:
        options["window"] = capacity
        capacity += int(second)
    if not options.keys() <= signature(kind).parameters.keys():
        raise KarmaError(f"policy {text!r}: only W-TinyLFU takes [window,main] sizes and options")
    try:
        policy = kind(capacity, **options)
    except ValueError as error:
        raise KarmaError(f"policy {text!r}: {error}") from error
    made: ReplacementPolicy = policy
    return made


def _options(text: str, words: list[str]) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for word in words:
        if word == "cm4":
            options["sketch"] = True
        elif word == "W=inf":
            options["period"] = None
        elif re.fullmatch(r"W=\d+", word):
            options["period"] = int(word[2:])
        else:
            raise KarmaError(f"policy {text!r}: unknown option {word!r}; {_FORM}")
    return options


class Fifo(Generic[K]):
    """The paper's plain queue: every use takes a new line, so one key may fill several."""

    def __init__(self, capacity: int) -> None:
        self.capacity = checked_capacity(capacity)
        self._queue: deque[K] = deque()
        self._copies: Counter[K] = Counter()

    def touch(self, key: K) -> K | None:
        """Enqueue `key`; return the key whose last line left."""
        self._queue.append(key)
        self._copies[key] += 1
        if len(self._queue) <= self.capacity:
            return None
        left = self._queue.popleft()
        self._copies[left] -= 1
        if self._copies[left]:
            return None
        del self._copies[left]
        return left

    def discard(self, key: K) -> None:
        """Free every line of `key`."""
        if key in self._copies:
            del self._copies[key]
            self._queue = deque(other for other in self._queue if other != key)

    def __contains__(self, key: object) -> bool:
        return key in self._copies

    def __len__(self) -> int:
        return len(self._queue)

    def __iter__(self) -> Iterator[K]:
        """Yield each key once, oldest line first."""
        return iter(dict.fromkeys(self._queue))


class FifoMerge(Generic[K]):
    """A queue with one line per key, merged whether full or not: a cache's FIFO."""

    def __init__(self, capacity: int) -> None:
        self.capacity = checked_capacity(capacity)
        self._lines: OrderedDict[K, None] = OrderedDict()

    def touch(self, key: K) -> K | None:
        """Enqueue `key` unless it has a line; return the key that left."""
        if key in self._lines:
            return None
        self._lines[key] = None
        if len(self._lines) > self.capacity:
            return self._lines.popitem(last=False)[0]
        return None

    def discard(self, key: K) -> None:
        """Free the line of `key`."""
        self._lines.pop(key, None)

    def __contains__(self, key: object) -> bool:
        return key in self._lines

    def __len__(self) -> int:
        return len(self._lines)

    def __iter__(self) -> Iterator[K]:
        """Yield keys, the one that would leave first."""
        return iter(self._lines)


class FifoMergeWhenFull(Fifo[K]):
    """The paper's letter: only a full queue is searched for a line of the same key.

    "When a new memory unit needs to join the queue and the queue is full, we first check the
    object's ID"; the oldest line of that key is replaced in place. Until the queue is full,
    every use takes a new line.
    """

    def touch(self, key: K) -> K | None:
        """Enqueue `key`, or replace its oldest line when full; return the key that left."""
        if len(self._queue) >= self.capacity and key in self._copies:
            return None
        return super().touch(key)


class Lru(FifoMerge[K]):
    """The least recently used key leaves."""

    def touch(self, key: K) -> K | None:
        """Make `key` the most recent; return the key that left."""
        if key in self._lines:
            self._lines.move_to_end(key)
            return None
        return super().touch(key)


class Lfu(Lru[K]):
    """The least often used key leaves; counts last while a key is resident.

    Room is made before the newcomer enters, so that it is never refused. Of equally rare keys
    the least recently used one leaves. Finding it looks at every line.
    """

    def __init__(self, capacity: int) -> None:
        super().__init__(capacity)
        self._count: Counter[K] = Counter()

    def touch(self, key: K) -> K | None:
        """Count one use of `key`; return the key that left."""
        left = None
        if key not in self._lines and len(self._lines) >= self.capacity:
            left = min(self._lines, key=self._count.__getitem__)
            self.discard(left)
        super().touch(key)
        self._count[key] += 1
        return left

    def discard(self, key: K) -> None:
        """Free the line of `key` and forget its count."""
        super().discard(key)
        del self._count[key]

    def __iter__(self) -> Iterator[K]:
        """Yield keys in the order in which they would leave."""
        return iter(sorted(self._lines, key=self._count.__getitem__))


class Arc(Generic[K]):
    """Adaptive replacement (Megiddo and Modha 2003): recency against frequency, in turns.

    Keys used once and keys used again lie in two LRU lists; the keys that lately left either are
    remembered without a line, and a use of one of those makes room for its kind.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = checked_capacity(capacity)
        self._target = 0.0  # lines for keys used once, at most
        self._once: OrderedDict[K, None] = OrderedDict()
        self._again: OrderedDict[K, None] = OrderedDict()
        self._once_gone: OrderedDict[K, None] = OrderedDict()
        self._again_gone: OrderedDict[K, None] = OrderedDict()

    def touch(self, key: K) -> K | None:
        """Count one use of `key`; return the key that left."""
        for resident in (self._once, self._again):
            if key in resident:
                del resident[key]
                self._again[key] = None
                return None
        if key in self._once_gone or key in self._again_gone:
            return self._return(key)
        return self._enter(key)

    def discard(self, key: K) -> None:
        """Free the line of `key`; what left before stays remembered."""
        self._once.pop(key, None)
        self._again.pop(key, None)

    def _return(self, key: K) -> K | None:
        """Take in a key that left lately."""
        once, again = len(self._once_gone), len(self._again_gone)
        left_once = key in self._once_gone
        if left_once:
            self._target = min(self.capacity, self._target + max(again / once, 1))
        else:
            self._target = max(0, self._target - max(once / again, 1))
        left = self._make_room(for_again=not left_once)
        del (self._once_gone if left_once else self._again_gone)[key]
        self._again[key] = None
        return left

    def _enter(self, key: K) -> K | None:
        """Take in a key that nothing is known of."""
        left = None
        if len(self._once) + len(self._once_gone) >= self.capacity:
            if len(self._once) < self.capacity:
                self._once_gone.popitem(last=False)
                left = self._make_room(for_again=False)
            else:
                left = self._once.popitem(last=False)[0]
        else:
            left = self._make_room(for_again=False)
            if len(self) + len(self._once_gone) + len(self._again_gone) >= 2 * self.capacity:
                self._again_gone.popitem(last=False)
        self._once[key] = None
        return left

    def _make_room(self, *, for_again: bool) -> K | None:
        """Let the least recent key of the list that is too long leave a full memory."""
        if len(self) < self.capacity:
            return None
        used_once = len(self._once)
        if self._once and (used_once > self._target or (for_again and used_once == self._target)):
            lines, gone = self._once, self._once_gone
        else:
            lines, gone = self._again, self._again_gone
        left, _ = lines.popitem(last=False)
        gone[left] = None
        return left

    def __contains__(self, key: object) -> bool:
        return key in self._once or key in self._again

    def __len__(self) -> int:
        return len(self._once) + len(self._again)

    def __iter__(self) -> Iterator[K]:
        """Yield keys used once, then those used again, each least recently used first."""
        yield from self._once
        yield from self._again


class Unbounded(FifoMerge[K]):
    """Nothing ever leaves: the upper bound of any memory; its capacity says nothing."""

    def __init__(self, capacity: int = 1) -> None:
        super().__init__(capacity)
        self.capacity = sys.maxsize


def checked_capacity(capacity: int) -> int:
    """Return `capacity`; raises ValueError when it is below 1."""
    if capacity < 1:
        raise ValueError(f"capacity must be at least 1, not {capacity}")
    return capacity
