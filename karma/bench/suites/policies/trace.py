"""Access traces: which units each task of a sequence needs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

Key = int | str


@dataclass(frozen=True, kw_only=True)
class Trace:
    """One sequence of tasks; all units of a task are asked for before any of them is touched.

    Args:
        keys: the distinct keys, in order of first use.
        tasks: the units each task needs, as numbers into `keys`; none twice in one task.
    """

    keys: tuple[Key, ...]
    tasks: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, tasks: Iterable[Sequence[Key]]) -> "Trace":
        """Return the trace of some tasks; a unit that a task names twice counts once."""
        numbers: dict[Key, int] = {}
        found = tuple(
            tuple(dict.fromkeys(numbers.setdefault(key, len(numbers)) for key in task))
            for task in tasks
        )
        return cls(keys=tuple(numbers), tasks=found)

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

    def named(self) -> list[list[Key]]:
        """Return the tasks by their keys."""
        return [[self.keys[number] for number in task] for task in self.tasks]
