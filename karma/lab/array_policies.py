"""Replacement policies as tight loops over numbered keys, for long and many traces.

Each does what the class of the same name in `karma.memory` does, use by use, which tests hold it
to; a policy of another class runs as the object it is. A kernel takes the fresh policy for its
sizes, the tasks, and the keys that their numbers stand for. It returns a byte per request (1 = hit)
and the keys that left.
"""

from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from karma.lab.hits import WARM_OCCUPANCY
from karma.memory.policies import Fifo, FifoMerge, FifoMergeWhenFull, Lfu, Lru, Unbounded
from karma.memory.sketch import CAP, CountMin4, ExactCounts
from karma.memory.wtinylfu import CaffeineWTinyLfu, KarmaWTinyLfu

Tasks = Sequence[Sequence[int]]
Keys = Sequence[Any]

_NEVER = 1 << 62  # no trace is as long
_HALF = bytes(count >> 1 for count in range(256))
_ODD = bytes(count & 1 for count in range(256))


class Replayed(NamedTuple):
    """What a kernel counted."""

    hits: bytearray  # 1 for each request that was answered
    left: int  # keys that left a full memory, refused newcomers among them
    warm_task: int | None  # the first task that found the memory 95 % full


Kernel = Callable[[Any, Tasks, Keys], Replayed]


def kernel_of(policy: Any) -> Kernel | None:
    """Return the tight loop for a policy, None where there is none."""
    counts = getattr(policy, "counts", None)
    if counts is not None and type(counts) not in (ExactCounts, CountMin4):
        return None
    return _KERNELS.get(type(policy))


def run_object(policy: Any, tasks: Sequence[Sequence[Any]]) -> Replayed:
    """Replay through the policy's own methods: the reference for every kernel."""
    hits, left, warm = bytearray(), 0, None
    need = WARM_OCCUPANCY * policy.capacity
    touch = policy.touch
    for number, task in enumerate(tasks):
        if warm is None and len(policy) >= need:
            warm = number
        for key in task:
            hits.append(key in policy)
        for key in task:
            left += touch(key) is not None
    return Replayed(hits, left, warm)


def run_fifo(policy: Fifo[int], tasks: Tasks, keys: Keys) -> Replayed:
    """One line per use."""
    return _queue(policy.capacity, tasks, keys, merge_when_full=False)


def run_fifo_merge_when_full(policy: Fifo[int], tasks: Tasks, keys: Keys) -> Replayed:
    """One line per use until full, then none for a key that has one."""
    return _queue(policy.capacity, tasks, keys, merge_when_full=True)


def _queue(capacity: int, tasks: Tasks, keys: Keys, *, merge_when_full: bool) -> Replayed:
    hits, left, warm, lines = bytearray(), 0, None, 0
    copies = [0] * len(keys)
    queue: deque[int] = deque()
    need = WARM_OCCUPANCY * capacity
    for number, task in enumerate(tasks):
        if warm is None and lines >= need:
            warm = number
        for key in task:
            hits.append(copies[key] > 0)
        for key in task:
            if lines < capacity:
                lines += 1
            elif merge_when_full and copies[key]:
                continue
            else:
                copies[key] += 1
                first = queue.popleft()
                copies[first] -= 1
                left += not copies[first]
                queue.append(key)
                continue
            copies[key] += 1
            queue.append(key)
    return Replayed(hits, left, warm)


def run_fifo_merge(policy: FifoMerge[int], tasks: Tasks, keys: Keys) -> Replayed:
    """A ring of residents; a hit changes nothing."""
    capacity = policy.capacity
    hits, left, warm, size, oldest = bytearray(), 0, None, 0, 0
    resident = [0] * len(keys)
    ring = [0] * capacity
    need = WARM_OCCUPANCY * capacity
    for number, task in enumerate(tasks):
        if warm is None and size >= need:
            warm = number
        for key in task:
            hits.append(resident[key])
        for key in task:
            if resident[key]:
                continue
            if size < capacity:
                ring[size] = key
                size += 1
            else:
                resident[ring[oldest]] = 0
                left += 1
                ring[oldest] = key
                oldest += 1
                if oldest == capacity:
                    oldest = 0
            resident[key] = 1
    return Replayed(hits, left, warm)


def run_lru(policy: Lru[int], tasks: Tasks, keys: Keys) -> Replayed:
    """Residents by last use."""
    capacity = policy.capacity
    hits, left, warm = bytearray(), 0, None
    order: OrderedDict[int, None] = OrderedDict()
    to_end, pop = order.move_to_end, order.popitem
    need = WARM_OCCUPANCY * capacity
    for number, task in enumerate(tasks):
        if warm is None and len(order) >= need:
            warm = number
        for key in task:
            hits.append(key in order)
        for key in task:
            if key in order:
                to_end(key)
            else:
                order[key] = None
                if len(order) > capacity:
                    pop(last=False)
                    left += 1
    return Replayed(hits, left, warm)


def run_lfu(policy: Lfu[int], tasks: Tasks, keys: Keys) -> Replayed:
    """Residents by count, each class of equals by last use."""
    capacity = policy.capacity
    hits, left, warm, size, least = bytearray(), 0, None, 0, 0
    count = [0] * len(keys)  # 0 = not resident
    classes: list[OrderedDict[int, None]] = [OrderedDict(), OrderedDict()]
    need = WARM_OCCUPANCY * capacity
    for number, task in enumerate(tasks):
        if warm is None and size >= need:
            warm = number
        for key in task:
            hits.append(count[key] > 0)
        for key in task:
            uses = count[key]
            if uses:
                del classes[uses][key]
                uses += 1
                if uses == len(classes):
                    classes.append(OrderedDict())
                classes[uses][key] = None
                count[key] = uses
                continue
            if size < capacity:
                size += 1
            else:
                while not classes[least]:
                    least += 1
                gone, _ = classes[least].popitem(last=False)
                count[gone] = 0
                left += 1
            classes[1][key] = None
            count[key] = least = 1
    return Replayed(hits, left, warm)


def run_unbounded(policy: Unbounded[int], tasks: Tasks, keys: Keys) -> Replayed:
    """Everything but a first use hits; the memory is never full."""
    hits = bytearray()
    seen = bytearray(len(keys))
    for task in tasks:
        for key in task:
            hits.append(seen[key])
        for key in task:
            seen[key] = 1
    return Replayed(hits, 0, None)


def run_karma(policy: KarmaWTinyLfu[int], tasks: Tasks, keys: Keys) -> Replayed:  # noqa: C901
    """All residents by last use; the rarest of those not protected leaves."""
    counts: Any = policy.counts
    capacity, window_size = policy.capacity, policy.window_size
    protected_size = policy.protected_size
    sketch = _sketch(counts, keys) if isinstance(counts, CountMin4) else None
    cap = (CAP if sketch else counts.cap) or _NEVER
    saturated, period = counts.count_saturated, counts.period
    hits, left, warm, uses = bytearray(), 0, None, 0
    count = [0] * len(keys)
    of = sketch.estimate if sketch else count.__getitem__
    add = sketch.add if sketch else None
    order: dict[int, None] = {}
    window: dict[int, None] = {}
    protected: dict[int, None] = {}
    need = WARM_OCCUPANCY * capacity
    for number, task in enumerate(tasks):
        if warm is None and len(order) >= need:
            warm = number
        for key in task:
            hits.append(key in order)
        for key in task:
            if add:
                add(key)
            elif count[key] < cap:
                count[key] += 1
                uses += 1
            elif saturated:
                uses += 1
            if uses == period:
                count[:] = [one >> 1 for one in count]
                uses >>= 1
            if key in order:
                del order[key]
                order[key] = None
                if key in window:
                    del window[key]
                    window[key] = None
                elif protected_size:
                    protected.pop(key, None)
                    protected[key] = None
                    if len(protected) > protected_size:
                        del protected[next(iter(protected))]
                continue
            order[key] = window[key] = None
            if len(order) > capacity:
                left += 1
                if protected:
                    rest = [one for one in order if one not in protected]
                    gone = min(rest, key=of)
                else:
                    gone = min(order, key=of)
                del order[gone]
                window.pop(gone, None)
            if len(window) > window_size:
                del window[next(iter(window))]
    return Replayed(hits, left, warm)


def run_caffeine(  # noqa: C901
    policy: CaffeineWTinyLfu[int], tasks: Tasks, keys: Keys
) -> Replayed:
    """Three LRU lists; what the window passes on must beat the oldest of the elimination list."""
    counts: Any = policy.counts
    capacity, window_size = policy.capacity, policy.window_size
    protected_size = policy.protected_size
    sketch = _sketch(counts, keys) if isinstance(counts, CountMin4) else None
    cap = (CAP if sketch else counts.cap) or _NEVER
    saturated, period = counts.count_saturated, counts.period
    hits, left, warm, uses, size = bytearray(), 0, None, 0, 0
    count = [0] * len(keys)
    of = sketch.estimate if sketch else count.__getitem__
    add = sketch.add if sketch else None
    where = bytearray(len(keys))  # 0 = nowhere, 1 = window, 2 = elimination, 3 = protected
    window: OrderedDict[int, None] = OrderedDict()
    elimination: OrderedDict[int, None] = OrderedDict()
    protected: OrderedDict[int, None] = OrderedDict()
    need = WARM_OCCUPANCY * capacity
    for number, task in enumerate(tasks):
        if warm is None and size >= need:
            warm = number
        for key in task:
            hits.append(where[key] > 0)
        for key in task:
            if add:
                add(key)
            elif count[key] < cap:
                count[key] += 1
                uses += 1
            elif saturated:
                uses += 1
            if uses == period:
                count[:] = [one >> 1 for one in count]
                uses >>= 1
            segment = where[key]
            if segment == 1:
                window.move_to_end(key)
            elif segment == 3:
                protected.move_to_end(key)
            elif segment == 2:
                del elimination[key]
                protected[key] = None
                where[key] = 3
                if len(protected) > protected_size:
                    demoted, _ = protected.popitem(last=False)
                    elimination[demoted] = None
                    where[demoted] = 2
            else:
                window[key] = None
                where[key] = 1
                size += 1
                if len(window) <= window_size:
                    continue
                challenger, _ = window.popitem(last=False)
                if size <= capacity:
                    elimination[challenger] = None
                    where[challenger] = 2
                    continue
                size -= 1
                left += 1
                victim = next(iter(elimination)) if elimination else challenger
                if of(challenger) > of(victim):
                    del elimination[victim]
                    where[victim] = 0
                    elimination[challenger] = None
                    where[challenger] = 2
                else:
                    where[challenger] = 0
    return Replayed(hits, left, warm)


class _Sketch(NamedTuple):
    """What a `CountMin4` does, over numbered keys."""

    add: Callable[[int], None]  # counts one use; at the period, halves every counter
    estimate: Callable[[int], int]  # the smallest counter of a key


def _sketch(counts: CountMin4[Any], keys: Keys) -> _Sketch:
    """Return a fresh sketch like `counts`, which looks the counters of its keys up once."""
    places = [counts.places(key) for key in keys]
    period, saturated = counts.period, counts.count_saturated
    table = bytearray(16 * counts.words)
    uses = 0

    def add(key: int) -> None:
        nonlocal uses
        added = saturated
        for slot in places[key]:
            if table[slot] < CAP:
                table[slot] += 1
                added = True
        if added:
            uses += 1
            if uses == period:
                odd = sum(table.translate(_ODD))
                table[:] = table.translate(_HALF)
                uses = (uses - (odd >> 2)) >> 1

    def estimate(key: int) -> int:
        first, second, third, fourth = places[key]
        least, other = table[first], table[second]
        if other < least:
            least = other
        other = table[third]
        if other < least:
            least = other
        other = table[fourth]
        return other if other < least else least

    return _Sketch(add, estimate)


_KERNELS: dict[type, Kernel] = {
    Fifo: run_fifo,
    FifoMerge: run_fifo_merge,
    FifoMergeWhenFull: run_fifo_merge_when_full,
    Lru: run_lru,
    Lfu: run_lfu,
    Unbounded: run_unbounded,
    CaffeineWTinyLfu: run_caffeine,
    KarmaWTinyLfu: run_karma,
}
