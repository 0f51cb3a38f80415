"""Tasks: instructions with their goals."""

from dataclasses import dataclass, field
from typing import Literal

from karma.types.space import SceneRef

Kind = Literal["simple", "composite", "complex", "sequence"]  # of tasks


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """One symbolic condition, e.g. INSIDE(Apple, Fridge) (KARMA Table 3), or 2*ON(Pen, Desk)."""

    predicate: str  # ON, INSIDE, STATE, TOGGLEON, TOGGLEOFF, HOLDON
    arguments: tuple[str, ...]
    count: int = 1  # of how many objects it must hold; ON and INSIDE: with one and the same place

    def __str__(self) -> str:
        """Return the paper's notation, a count before it."""
        times = "" if self.count == 1 else f"{self.count}*"
        return f"{times}{self.predicate}({', '.join(self.arguments)}): 1"


@dataclass(frozen=True, slots=True, kw_only=True)
class SubTask:
    """One instruction of a sequence and what must hold when it ends."""

    instruction: str
    goals: tuple[Goal, ...] = ()
    passing: tuple[Goal, ...] = ()  # of the goals; these need only have held since it began
    whole: str = ""  # the user's whole text, of which this is a part
    scene: SceneRef | None = None  # the room it plays in; None: the task's

    @property
    def is_whole(self) -> bool:
        """Whether it is all that the user said: a task by itself, as in ALFRED."""
        return self.whole == self.instruction


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A sequence of instructions in one home; it succeeds when every sub-task does.

    Of a "sequence" every sub-task is a task by itself, in a room of its own choice.
    """

    id: str
    kind: Kind
    scene: SceneRef
    subtasks: tuple[SubTask, ...]
    notes: tuple[str, ...] = field(default=())  # what a loader could not resolve
    group: str = ""  # in a benchmark of others: a list or type that is counted apart
    trained: bool | None = None  # it stands word for word in training data; None: not known

    @property
    def counted_as(self) -> str:
        """The group or kind that figures count it in."""
        return self.group or self.kind

    @property
    def scenes(self) -> tuple[SceneRef, ...]:
        """The rooms it plays in, in the order in which they are first needed."""
        rooms = (sub.scene or self.scene for sub in self.subtasks)
        return tuple(dict.fromkeys(rooms)) or (self.scene,)
