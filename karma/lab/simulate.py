"""One policy, or the best there could be, over one trace."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from heapq import heappop, heappush
from typing import Any

from karma.lab.array_policies import Replayed, kernel_of, run_object
from karma.lab.trace import Trace
from karma.memory.policies import make_policy

BELADY = "belady"  # stands where a policy is named, with a size: belady[10]
FIRST_TASKS = 100  # of the early hit rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of a policy on a trace.

    Args:
        answers: one byte per request, 1 = hit.
        starts: requests before each task, and in all.
        left: units that left a full memory, refused newcomers among them; None for the bound.
        warm_task: the first task that found the memory 95 % full; None: never.
    """

    answers: bytes
    starts: tuple[int, ...]
    left: int | None
    warm_task: int | None

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

    @property
    def cold_rate(self) -> float | None:
        """From the empty memory on, all tasks."""
        return self.rate()

    @property
    def first_rate(self) -> float | None:
        """From the empty memory on, the first 100 tasks."""
        return self.rate(0, FIRST_TASKS)

    @property
    def steady_rate(self) -> float | None:
        """The second half of the tasks."""
        return self.rate(self.tasks // 2)


def simulator(policy: str) -> Callable[[Trace], Outcome]:
    """Return what runs a policy over one trace after another, each from an empty memory.

    Args:
        policy: in the notation of `make_policy`, or `belady[size]`.

    Raises:
        KarmaError: the text names no policy.
    """
    if policy.startswith(f"{BELADY}["):
        return partial(best, capacity=make_policy(policy.replace(BELADY, "lru", 1)).capacity)
    fresh = make_policy(policy)
    return lambda trace: simulate_with(copy.deepcopy(fresh), trace)


def simulate(policy: str, trace: Trace) -> Outcome:
    """Run a policy over one trace; see `simulator`."""
    return simulator(policy)(trace)


def simulate_with(policy: Any, trace: Trace) -> Outcome:
    """Run a fresh policy over a trace; the fast way where there is one, with the same answers."""
    kernel = kernel_of(policy)
    if kernel is not None:
        return _outcome(kernel(policy, trace.tasks, trace.keys), trace)
    return _outcome(run_object(policy, trace.named()), trace)


def best(trace: Trace, capacity: int) -> Outcome:
    """Return the most hits that any memory of `capacity` lines can have, knowing what comes.

    Between two tasks at most `capacity` of the units used so far can wait for their next use. Of
    those that would wait, the one whose next use is farthest away is let go, which is optimal
    (Belady 1966; Carlisle and Lloyd 1995 for whole tasks).

    Raises:
        ValueError: capacity < 0.
    """
    if capacity < 0:
        raise ValueError(f"capacity must not be negative, not {capacity}")
    never = len(trace.tasks)
    upcoming = _next_uses(trace, never)
    waits = [never] * len(trace.keys)  # resident key -> the task that it waits for
    farthest: list[tuple[int, int]] = []  # (-task, key); may be stale
    answers = bytearray()
    size = 0
    for number, task in enumerate(trace.tasks):
        for place, key in enumerate(task):
            hit = waits[key] == number
            answers.append(hit)
            size -= hit
            use = waits[key] = upcoming[number][place]
            if use < never:
                heappush(farthest, (-use, key))
                size += 1
        while size > capacity:
            use, key = heappop(farthest)
            if waits[key] == -use:
                waits[key] = never
                size -= 1
    return Outcome(answers=bytes(answers), starts=trace.starts, left=None, warm_task=None)


def _next_uses(trace: Trace, never: int) -> list[tuple[int, ...]]:
    """Return for each unit of each task the number of the next task that needs it."""
    later = [never] * len(trace.keys)
    upcoming: list[tuple[int, ...]] = [()] * len(trace.tasks)
    for number in range(len(trace.tasks) - 1, -1, -1):
        task = trace.tasks[number]
        upcoming[number] = tuple([later[key] for key in task])
        for key in task:
            later[key] = number
    return upcoming


def _outcome(replayed: Replayed, trace: Trace) -> Outcome:
    return Outcome(
        answers=bytes(replayed.hits),
        starts=trace.starts,
        left=replayed.left,
        warm_task=replayed.warm_task,
    )
