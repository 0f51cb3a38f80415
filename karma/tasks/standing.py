"""When a placement counts: what of a sub-task has held and still stands.

It counts when it holds at the end of its sub-task, or held at some moment since that began and
nobody undid it on purpose. Taking the thing up again, or what it lies in, is on purpose; that it
fell, or was knocked away, is not. So what was placed before its sub-task counts while it stays, and
what a later sub-task takes away has counted.

Goals on the way (`SubTask.passing`) need only have held: means to a deed, as the sink for what is
to be washed, and what a later goal of the same sub-task ends.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Self

from karma.contracts import Goal, SubTask

Fact = tuple[Goal, tuple[str, ...]]  # a goal and the ids of the things that it holds of


@dataclass(slots=True)
class Standing:
    """Keeps what stands, over the events of one sub-task."""

    goals: tuple[Goal, ...] = ()  # that it has to be told of
    passing: frozenset[Goal] = frozenset()
    _facts: frozenset[Fact] = field(default=frozenset())

    @classmethod
    def of(cls, subtask: SubTask) -> Self:
        """Begin a sub-task, of which nothing has held yet."""
        passing = frozenset(subtask.passing)
        goals = (g for g in subtask.goals if g in passing or g.predicate in ("ON", "INSIDE"))
        return cls(tuple(goals), passing)

    def look(self, now: Collection[Fact], is_carried: Callable[[str], bool]) -> None:
        """Take in one event.

        Args:
            now: what holds after it.
            is_carried: says of an id whether it is in the hand, or in what is there.
        """
        kept = (one for one in self._facts if one[0] in self.passing or not is_carried(one[1][0]))
        self._facts = frozenset((*now, *kept))

    def has(self, goal: Goal, ids: tuple[str, ...]) -> bool:
        """Return whether a goal stands for some things."""
        return (goal, ids) in self._facts
