"""Replay policies, or Belady's bound, over access traces: the units that each task needs."""

import copy
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from heapq import heappop, heappush
from itertools import chain
from typing import Any

from karma.memory.policies import make_policy

Key = int | str


@dataclass(frozen=True)
class Trace:
    """One sequence of tasks; all units of a task are requested before any of them is touched."""

    tasks: tuple[tuple[Key, ...], ...]  # a unit at most once in a task

    @classmethod
    def of(cls, tasks: Iterable[Iterable[Key]]) -> "Trace":
        """Return the trace of some tasks; a unit that a task names twice counts once."""
        return cls(tuple(tuple(dict.fromkeys(task)) for task in tasks))

    @property
    def keys(self) -> frozenset[Key]:
        """The distinct units."""
        return frozenset(chain.from_iterable(self.tasks))

    @cached_property
    def starts(self) -> tuple[int, ...]:
        """The number of requests before each task, and at the end."""
        starts = [0]
        for task in self.tasks:
            starts.append(starts[-1] + len(task))
        return tuple(starts)

    @property
    def requests(self) -> int:
        """How many units are asked for in all."""
        return self.starts[-1]


BELADY = "belady"  # stands where a policy is named, with a size: belady[10]
FIRST_TASKS = 100  # of the early hit rate
WARM_OCCUPANCY = 0.95  # KARMA §4.4: warmed up when occupancy reaches this


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceReplay:
    """Result of a policy on a trace."""

    answers: bytes  # one byte per request, 1 = hit
    starts: tuple[int, ...]  # requests before each task, and in all
    left: int | None  # units that left a full memory, refused ones too; None for the bound
    warm_task: int | None  # the first task that found the memory 95 % full; None: never

    @property
    def requests(self) -> int:
        """Units asked for."""
        return len(self.answers)

    @property
    def hits(self) -> int:
        """Units asked for and there."""
        return sum(self.answers)

    @property
    def tasks(self) -> int:
        """Tasks done."""
        return len(self.starts) - 1

    def between(self, first: int, last: int) -> tuple[int, int]:
        """Return hits and requests of the tasks `first` to before `last`."""
        part = self.answers[self.starts[first] : self.starts[min(last, self.tasks)]]
        return sum(part), len(part)

    def rate(self, first: int = 0, last: int | None = None) -> float | None:
        """Return the hit rate of some tasks; None where nothing was asked."""
        hits, requests = self.between(first, self.tasks if last is None else last)
        return hits / requests if requests else None


def simulator(policy: str) -> Callable[[Trace], TraceReplay]:
    """Return a function that runs a policy over a trace, from an empty memory.

    A policy is in the notation of `make_policy`, or `belady[size]`. KarmaError if the text
    names no policy.
    """
    if policy.startswith(f"{BELADY}["):
        return partial(best, capacity=make_policy(policy.replace(BELADY, "lru", 1)).capacity)
    fresh = make_policy(policy)
    return lambda trace: simulate_with(copy.deepcopy(fresh), trace)


def simulate(policy: str, trace: Trace) -> TraceReplay:
    """Run a policy over a trace; see `simulator`."""
    return simulator(policy)(trace)


def simulate_with(policy: Any, trace: Trace) -> TraceReplay:
    """Run a fresh policy over a trace: all units of a task are asked for, then all are touched."""
    answers, left, warm = bytearray(), 0, None
    need = WARM_OCCUPANCY * policy.capacity
    touch = policy.touch
    for number, task in enumerate(trace.tasks):
        if warm is None and len(policy) >= need:
            warm = number
        for key in task:
            answers.append(key in policy)
        for key in task:
            left += touch(key) is not None
    return TraceReplay(answers=bytes(answers), starts=trace.starts, left=left, warm_task=warm)


def best(trace: Trace, capacity: int) -> TraceReplay:
    """Return the most hits that any memory of `capacity` lines can have, knowing what comes.

    Between two tasks at most `capacity` of the units used so far can wait for their next use.
    Of those that would wait, the one whose next use is farthest away is let go, which is
    optimal (Belady 1966; Carlisle and Lloyd 1995 for whole tasks). ValueError if capacity < 0.
    """
    if capacity < 0:
        raise ValueError(f"capacity must not be negative, not {capacity}")
    never = len(trace.tasks)
    waits: dict[Key, int] = {}  # resident unit -> the task that it waits for
    order: dict[Key, int] = {}  # by first use, which decides between equally far uses
    farthest: list[tuple[int, int, Key]] = []  # (-task, order, unit); may be stale
    answers = bytearray()
    for number, upcoming in enumerate(_next_uses(trace)):
        for key, use in upcoming.items():
            answers.append(waits.pop(key, never) == number)
            if use < never:
                waits[key] = use
                heappush(farthest, (-use, order.setdefault(key, len(order)), key))
        while len(waits) > capacity:
            use, _, key = heappop(farthest)
            if waits.get(key) == -use:
                del waits[key]
    return TraceReplay(answers=bytes(answers), starts=trace.starts, left=None, warm_task=None)


def _next_uses(trace: Trace) -> list[dict[Key, int]]:
    """Return for each task its units, with the number of the next task that needs each."""
    never = len(trace.tasks)
    later: dict[Key, int] = {}
    upcoming = []
    for number in range(never - 1, -1, -1):
        task = trace.tasks[number]
        upcoming.append({key: later.get(key, never) for key in task})
        later |= dict.fromkeys(task, number)
    return upcoming[::-1]
