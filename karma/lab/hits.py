"""Hit statistics of a policy over a known trace of keys, and the best that any policy could do."""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Protocol, TypeVar

WARM_OCCUPANCY = 0.95  # KARMA §4.4: warmed up when occupancy reaches this

K = TypeVar("K", bound=Hashable)


class _Touchable(Protocol[K]):
    """`contracts.ReplacementPolicy`, over keys of any kind."""

    capacity: int

    def touch(self, key: K) -> K | None: ...
    def __contains__(self, key: object) -> bool: ...
    def __len__(self) -> int: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class HitStatistics:
    """What a replay counted; rates are None where nothing was asked."""

    requests: int
    hits: int
    warm_requests: int  # asked at an occupancy of at least 95 %
    warm_hits: int
    half_requests: int  # of the second half of the trace
    half_hits: int

    @property
    def cold_rate(self) -> float | None:
        """Hits over requests, from the empty memory on."""
        return _rate(self.hits, self.requests)

    @property
    def steady_rate(self) -> float | None:
        """Hits over requests after warm-up; None when the memory never filled."""
        return _rate(self.warm_hits, self.warm_requests)

    @property
    def half_rate(self) -> float | None:
        """Hits over requests in the second half of the trace."""
        return _rate(self.half_hits, self.half_requests)


def replay(policy: _Touchable[K], trace: Iterable[K]) -> HitStatistics:
    """Ask for each key of a trace and touch it at once.

    Args:
        policy: usually empty; it is left as the trace makes it.
        trace: keys in order of use.
    """
    return replay_tasks(policy, ((key,) for key in trace))


def replay_tasks(policy: _Touchable[K], tasks: Iterable[Sequence[K]]) -> HitStatistics:
    """Ask for all units of a task, then touch them in order, task by task.

    One query per required unit and task: duplicates within a task are removed.

    Args:
        policy: usually empty; it is left as the tasks make it.
        tasks: the keys each task needs, in plan order.
    """
    hits: list[bool] = []
    warm_from: int | None = None
    for task in tasks:
        keys = tuple(dict.fromkeys(task))
        if warm_from is None and len(policy) >= WARM_OCCUPANCY * policy.capacity:
            warm_from = len(hits)
        hits += [key in policy for key in keys]
        for key in keys:
            policy.touch(key)
    warm = [] if warm_from is None else hits[warm_from:]
    half = hits[len(hits) // 2 :]
    return HitStatistics(
        requests=len(hits),
        hits=sum(hits),
        warm_requests=len(warm),
        warm_hits=sum(warm),
        half_requests=len(half),
        half_hits=sum(half),
    )


def belady_hits(trace: Sequence[Hashable], capacity: int) -> int:
    """Return the most hits that a memory of `capacity` lines can have on a known trace.

    The key whose next use is farthest away leaves; that may be the newcomer itself, so that
    policies which refuse newcomers are bounded too.

    Raises:
        ValueError: capacity < 0.
    """
    if capacity < 0:
        raise ValueError(f"capacity must not be negative, not {capacity}")
    never = len(trace)
    upcoming = [never] * len(trace)
    later: dict[Hashable, int] = {}
    for index in range(len(trace) - 1, -1, -1):
        upcoming[index] = later.get(trace[index], never)
        later[trace[index]] = index
    resident: dict[Hashable, int] = {}  # key -> its next use
    farthest: list[tuple[int, int, Hashable]] = []  # (-next use, when noted, key); may be stale
    hits = 0
    for index, key in enumerate(trace):
        hits += key in resident
        resident[key] = upcoming[index]
        heappush(farthest, (-upcoming[index], index, key))
        while len(resident) > capacity:
            use, _, other = heappop(farthest)
            if resident.get(other) == -use:
                del resident[other]
    return hits


def unbounded_hits(trace: Sequence[Hashable]) -> int:
    """Return the hits of a memory without limit: every use but the first of each key."""
    return len(trace) - len(set(trace))


def _rate(hits: int, requests: int) -> float | None:
    return hits / requests if requests else None
