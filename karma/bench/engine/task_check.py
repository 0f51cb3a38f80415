"""Find tasks that measure nothing: done before they are asked for, or that nobody could do.

The quick checks look at the rooms as they stand at the start; the thorough ones also let the
`expert` try, which knows everything, and ask the world whether things can be got at.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import msgspec

from karma.agent.seeing.perceive import cells_of
from karma.bench.engine.episode import run_episode
from karma.bench.methods.expert import ExpertMethod
from karma.goals.goals import GoalTracker, Meanings, alternatives, object_names
from karma.household.containment import fits_whole_or_cut
from karma.household.ids import is_id, is_position, root_type
from karma.household.pieces import base_type, is_piece
from karma.household.types import object_types
from karma.household.uses import covers
from karma.types.roles import World
from karma.types.space import SceneRef
from karma.types.tasks import Goal, Task
from karma.world.core import scene as rooms
from karma.world.core.placement import find_place
from karma.world.core.scene import Scene, SceneObject
from karma.world.home import Home
from karma.world.sim import EmbeddedWorld

NOT_THERE = "a thing is not in the room"
TAKES_NONE = "nothing that is named as the place takes such a thing"
OUT_OF_REACH = "a thing or place is within reach from nowhere that one can stand"
TOO_BIG = "a thing is too big for its place, even when that is empty"


class Possible:
    """Answers for one room."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._bare = [_opened(one) for one in scene.objects if not _is_loose(one)]
        self._reached: dict[str, bool] = {}
        self._taken: dict[tuple[str, str], bool] = {}

    def refusal(self, goals: Iterable[Goal]) -> str:
        """Return why one of the goals can be met by nobody, "" where all can."""
        return next(filter(None, map(self._why_not, goals)), "")

    def _why_not(self, goal: Goal) -> str:
        named = [self._objects_named(name) for name in object_names(goal)]
        if not all(named):
            return NOT_THERE
        if not all(any(map(self._is_reached, ones)) for ones in named):
            return OUT_OF_REACH
        if goal.predicate not in ("ON", "INSIDE") or is_position(goal.arguments[1]):
            return ""
        things, places = named
        pairs = [(thing, place) for thing in things for place in places if _takes(place, thing)]
        if not pairs:
            return TAKES_NONE
        return "" if any(self._is_taken(*pair) for pair in pairs) else TOO_BIG

    def _objects_named(self, name: str) -> Sequence[SceneObject]:
        kinds = alternatives(name)
        return [one for one in self._scene.objects if any(covers(k, one.type) for k in kinds)]

    def _is_reached(self, thing: SceneObject) -> bool:
        """Return whether a thing can be seen within reach from somewhere."""
        if thing.id not in self._reached:
            world = EmbeddedWorld(self._with([thing]))
            asked = world.step("GetInteractablePoses", objectId=thing.id)
            self._reached[thing.id] = bool(cells_of(asked))
        return self._reached[thing.id]

    def _is_taken(self, thing: SceneObject, place: SceneObject) -> bool:
        """Return whether a place that can be got at has room for a thing once it is empty.

        Of what is cut a piece may fit where the whole does not.
        """
        if "sliceable" in thing.capabilities:
            return self._is_reached(place)
        if (thing.id, place.id) not in self._taken:
            state = EmbeddedWorld(self._with([place])).state
            there = state.objects[place.id]
            room = thing.id != place.id and find_place(state, thing, there) is not None
            self._taken[thing.id, place.id] = room and self._is_reached(place)
        return self._taken[thing.id, place.id]

    def _with(self, loose: Sequence[SceneObject]) -> Scene:
        """Return the room with its doors open and, of what can be moved, nothing but this."""
        there = {one.id: one for one in (*self._bare, *map(_opened, loose))}
        lying = (
            msgspec.structs.replace(one, parents=tuple(p for p in one.parents if p in there))
            for one in there.values()
        )
        return msgspec.structs.replace(self._scene, objects=tuple(lying))


def _is_loose(thing: SceneObject) -> bool:
    return "pickupable" in thing.capabilities


def _takes(place: SceneObject, thing: SceneObject) -> bool:
    """Return whether a place holds things, and its type takes a thing whole or in pieces."""
    return "receptacle" in place.capabilities and fits_whole_or_cut(thing.type, place.type)


def _opened(thing: SceneObject) -> SceneObject:
    doors = "openable" in thing.capabilities and "receptacle" in thing.capabilities
    return msgspec.structs.replace(thing, openness=1.0) if doors else thing


TRUE = "already true at the start"
IDLE = "solved by doing nothing"
NAMES_NOTHING = "names nothing in the room"
UNREACHABLE = "unreachable"
BEYOND = "beyond the expert"


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskFinding:
    """What is wrong with a task."""

    task: str
    what: str  # one of this module's names
    detail: str
    serious: bool = True  # a goal that holds beside others that do not may be meant so

    def __str__(self) -> str:
        return f"{self.task}: {self.what}: {self.detail}"


def quick_findings(tasks: Sequence[Task], make: Callable[[], World]) -> Iterator[TaskFinding]:
    """Yield what the rooms at the start, which can be loaded, tell of tasks, task by task."""
    world = make()
    try:
        for task in tasks:
            yield from _seen_at_start(task, world)
    finally:
        world.stop()


def findings(task: Task, make: Callable[[], World], folder: Path) -> Iterator[TaskFinding]:
    """Yield all that is wrong with one task; the expert tries it where nothing serious was seen.

    `folder` takes what the expert leaves behind.
    """
    seen = list(quick_findings([task], make))
    yield from seen
    if any(one.serious and one.what != TRUE for one in seen):
        return
    beyond = _beyond_expert(task, make, folder)
    if beyond is None:
        return
    barred = list(_unreachable(task))
    yield from barred or [beyond]


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


def _unreachable(task: Task) -> Iterator[TaskFinding]:
    possible: dict[SceneRef, Possible] = {}
    for number, subtask in enumerate(task.subtasks):
        place = subtask.scene or task.scene
        if place not in possible:
            possible[place] = Possible(rooms.load(place.source))
        for goal in subtask.goals:
            if any(is_id(name) for name in object_names(goal)):
                continue
            reason = possible[place].refusal((goal,))
            if reason in (OUT_OF_REACH, TOO_BIG):
                yield _finding(task, number, UNREACHABLE, f"{goal}: {reason}")


def _beyond_expert(task: Task, make: Callable[[], World], folder: Path) -> TaskFinding | None:
    """Let the expert try; None where it succeeds."""
    with ExitStack() as stack:
        world: World = Home(make) if len(task.scenes) > 1 else make()
        stack.callback(world.stop)
        record = run_episode(ExpertMethod(), world, task, row="expert", seed=0, folder=folder)
    if record.success:
        return None
    for number, done in enumerate(record.subtasks):
        if done.unmet:
            last = done.calls[-1] if done.calls else None
            said = f"{', '.join(done.unmet)} stayed unmet"
            why = f"; last: {last.text}: {last.reason}" if last and last.reason else ""
            return _finding(task, number, BEYOND, said + why)
    return TaskFinding(task=task.id, what=BEYOND, detail=record.error or "it did not end")


def _finding(
    task: Task, number: int, what: str, detail: str, *, serious: bool = True
) -> TaskFinding:
    subtask = task.subtasks[number]
    said = subtask.instruction if len(subtask.instruction) <= 60 else subtask.instruction[:57] + "…"
    where = f"sub-task {number} ({said!r}): {detail}"
    return TaskFinding(task=task.id, what=what, detail=where, serious=serious)
