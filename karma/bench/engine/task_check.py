"""Find tasks that measure nothing: done before they are asked for, or about absent objects."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from karma.goals.goals import GoalTracker, Meanings, alternatives, object_names
from karma.household.ids import is_id, root_type
from karma.household.pieces import base_type, is_piece
from karma.household.types import object_types
from karma.types.roles import World
from karma.types.tasks import Goal, Task

TRUE = "already true at the start"
IDLE = "solved by doing nothing"
NAMES_NOTHING = "names nothing in the room"


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskFinding:
    """What is wrong with a task."""

    task: str
    what: str  # one of this module's names
    detail: str
    serious: bool = True  # a goal that holds beside others that do not may be meant so

    def __str__(self) -> str:
        return f"{self.task}: {self.what}: {self.detail}"


def findings(tasks: Sequence[Task], make: Callable[[], World]) -> Iterator[TaskFinding]:
    """Yield what is wrong with tasks in their rooms at the start, task by task."""
    world = make()
    try:
        for task in tasks:
            yield from _seen_at_start(task, world)
    finally:
        world.stop()


def _seen_at_start(task: Task, world: World) -> Iterator[TaskFinding]:
    met_all = []
    for number, subtask in enumerate(task.subtasks):
        place = subtask.scene or task.scene
        event = world.reset(place.source)
        tracker = GoalTracker()
        tracker.start(event)
        meanings = tracker.meanings(event)
        for goal in subtask.goals:
            for reason in _nothing_named(goal, meanings):
                yield _finding(task, number, NAMES_NOTHING, f"{goal}: {reason} in {place.name}")
        unmet = tracker.unmet(subtask.goals, event)
        met = [goal for goal in subtask.goals if goal not in unmet]
        met_all.append(bool(subtask.goals) and not unmet)
        if met:
            said = ", ".join(map(str, met))
            undone = task.kind != "sequence" and not all(met_all)  # maybe, by what comes before
            serious = met_all[-1] and not undone
            yield _finding(task, number, TRUE, said, serious=serious)
    if met_all and all(met_all):
        yield TaskFinding(
            task=task.id, what=IDLE, detail="all goals of all sub-tasks are true already"
        )


def _nothing_named(goal: Goal, meanings: Meanings) -> Iterator[str]:
    """Yield why names of a goal mean too little; what is cut later is looked for as a whole."""
    for place, name in enumerate(object_names(goal)):
        kinds = alternatives(name)
        wholes = (kind if is_id(kind) else base_type(kind) for kind in kinds)
        found = {one.object_id for kind in (*kinds, *wholes) for one in meanings.named(kind)}
        cut = any(is_piece(kind) for kind in kinds)
        wanted = goal.count if place == 0 and not cut else 1
        types = (object_types().get(root_type(kind)) for kind in kinds)
        cuttable = any(kind is not None and kind.slices_into for kind in types)
        if not found:
            yield f"there is no {name}"
        elif len(found) < wanted and not cuttable:
            yield f"there are {len(found)} {name}, not {wanted},"


def _finding(
    task: Task, number: int, what: str, detail: str, *, serious: bool = True
) -> TaskFinding:
    subtask = task.subtasks[number]
    said = subtask.instruction if len(subtask.instruction) <= 60 else subtask.instruction[:57] + "…"
    where = f"sub-task {number} ({said!r}): {detail}"
    return TaskFinding(task=task.id, what=what, detail=where, serious=serious)
