"""Tasks in our own form, and requests as people say them: JSON lines, read strictly.

{"id": "c07", "kind": "composite", "scene": "kitchen_2", "subtasks": [
    {"instruction": "Wash the apple.", "goals": ["INSIDE(Apple, Sink)", "STATE(Apple, clean)"]}]}

A sub-task of the kind "sequence" may name another room of the home: "scene": "bedroom_1".
`eval/requests/` holds requests of one thing each, some of which are to be refused.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import msgspec

from karma.errors import FileError, KarmaError
from karma.files import check_keys, lines_of, read_bytes
from karma.goals.goals import alternatives, object_names, parse_goal
from karma.household.containment import fits_whole_or_cut
from karma.household.ids import is_position, root_type
from karma.household.types import RULES, WIDEST, RuleSet, object_type, type_now, types_with
from karma.types.space import SceneRef
from karma.types.tasks import Goal, Kind, SubTask, Task
from karma.world.core import scene


class _SubTask(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    instruction: str
    goals: tuple[str, ...]
    scene: str = ""


class _Task(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    id: str
    kind: Kind
    scene: str
    subtasks: tuple[_SubTask, ...]


def load_tasks(path: str | Path) -> tuple[Task, ...]:
    """Read a task file.

    Rooms that it names by a file lie beside it, or in the current folder.

    Raises:
        FileError: a line is no task: unknown key, kind, scene, predicate, state or object type, no
            goals, or an id that stands twice; names the line and the field.
    """
    tasks: dict[str, Task] = {}
    for number, line in enumerate(lines_of(path), start=1):
        if not line.strip():
            continue
        try:
            task = _task(_placed(msgspec.json.decode(line, type=_Task), Path(path)))
            check_keys(line)
        except (KarmaError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise FileError(path, f"line {number}: {error}") from error
        if task.id in tasks:
            raise FileError(path, f"line {number}: id: {task.id!r} stands twice")
        tasks[task.id] = task
    if not tasks:
        raise FileError(path, "there is no task in it")
    return tuple(tasks.values())


def task_lines(path: str | Path) -> dict[str, int]:
    """Return on which line of a file that `load_tasks` has read each task stands."""
    lines = enumerate(lines_of(path), start=1)
    return {msgspec.json.decode(line, type=_Task).id: at for at, line in lines if line.strip()}


def required_types(subtask: SubTask) -> tuple[str, ...]:
    """Return the types of things that can be carried which the goals mention, in order.

    These are what memory can help with: what is fixed is in the scene graph anyway.
    """
    names = (part for goal in subtask.goals for name in object_names(goal)
             for part in alternatives(name))  # fmt: skip
    types = dict.fromkeys(root_type(name) for name in names)
    return tuple(name for name in types if name in types_with("pickupable"))


def _placed(row: _Task, path: Path) -> _Task:
    """Return a line whose rooms' files are found from any folder: beside the task file first."""

    def place(room: str) -> str:
        if not room.endswith(".json"):
            return room
        if (beside := path.parent / room).is_file():
            return str(beside)
        if not Path(room).is_file():
            raise KarmaError(f"scene: no file {room!r}, neither beside {path} nor here")
        return room

    subtasks = tuple(msgspec.structs.replace(sub, scene=place(sub.scene)) for sub in row.subtasks)
    return msgspec.structs.replace(row, scene=place(row.scene), subtasks=subtasks)


def _task(row: _Task) -> Task:
    if not row.subtasks:
        raise KarmaError("subtasks: there are none")
    _check_scene(row.scene, "scene")
    subtasks = tuple(_subtask(sub, f"subtasks[{i}]") for i, sub in enumerate(row.subtasks))
    _check_rooms(row)
    scene = SceneRef.of(row.scene)
    return with_whole(Task(id=row.id, kind=row.kind, scene=scene, subtasks=subtasks))


def with_whole(task: Task, said: str = "") -> Task:
    """Tell every sub-task the whole text that it is a part of: its own in a sequence.

    `said` is the text that the instructions were cut out of; "" joins them.
    """
    whole = " ".join(said.split()) or " ".join(sub.instruction for sub in task.subtasks)
    alone = task.kind == "sequence"
    told = (replace(sub, whole=sub.instruction if alone else whole) for sub in task.subtasks)
    return replace(task, subtasks=tuple(told))


def in_rooms(task: Task, place: Callable[[SceneRef], SceneRef]) -> Task:
    """Return a task whose rooms lie elsewhere."""
    subtasks = (replace(sub, scene=sub.scene and place(sub.scene)) for sub in task.subtasks)
    return replace(task, scene=place(task.scene), subtasks=tuple(subtasks))


def _check_scene(name: str, where: str) -> None:
    try:
        scene.find(name)
    except FileError as error:
        raise KarmaError(f"{where}: {error.reason}") from error


def _check_rooms(row: _Task) -> None:
    """Raise KarmaError where a sub-task names a room that is not there, or may not name one."""
    rooms = {sub.scene: number for number, sub in enumerate(row.subtasks) if sub.scene}
    for room, number in rooms.items():
        where = f"subtasks[{number}].scene"
        if row.kind != "sequence":
            raise KarmaError(f"{where}: only the kind 'sequence' goes from room to room")
        _check_scene(room, where)
    names = [SceneRef.of(room).name for room in {*rooms, row.scene}]
    if twice := [name for name in names if names.count(name) > 1]:
        raise KarmaError(f"subtasks: two rooms have the name {twice[0]!r}")


def _subtask(row: _SubTask, where: str) -> SubTask:
    if not row.instruction.strip():
        raise KarmaError(f"{where}.instruction: it is empty")
    if not row.goals:
        raise KarmaError(f"{where}.goals: there are none")
    goals = tuple(_goal(text, f"{where}.goals[{i}]") for i, text in enumerate(row.goals))
    room = SceneRef.of(row.scene) if row.scene else None
    return SubTask(instruction=row.instruction, goals=goals, scene=room)


def _goal(text: str, where: str) -> Goal:
    try:
        goal = parse_goal(text)
        check_goal(goal, WIDEST)  # of whichever rooms
    except KarmaError as error:
        raise KarmaError(f"{where}: {error}") from error
    return goal


def check_goal(goal: Goal, rules: RuleSet = RULES) -> None:
    """Raise KarmaError for a type that is not there, or what AI2-THOR lets nobody put together."""
    for name in object_names(goal):
        for kind in _types(name, rules):
            object_type(kind)
    if goal.predicate in ("ON", "INSIDE") and not is_position(goal.arguments[1]):
        check_placement(goal, rules)


def _types(name: str, rules: RuleSet) -> list[str]:
    """Return the types that a name of a goal means; old simulators' names mean today's types."""
    kinds = [root_type(part) for part in alternatives(name)]
    return kinds if rules == RULES else [type_now(kind) or kind for kind in kinds]


def check_placement(goal: Goal, rules: RuleSet = RULES) -> None:
    """Raise KarmaError unless some named type may be put into some named receptacle type."""
    moved, places = (_types(name, rules) for name in goal.arguments)
    if not any(
        object_type(one).can("pickupable") and fits_whole_or_cut(one, place, rules)
        for one in moved
        for place in places
    ):
        raise KarmaError(f"{goal}: AI2-THOR lets no {goal.arguments[0]} into {goal.arguments[1]}")


# ----------------------------------------------------------------- requests


class SaidLine(msgspec.Struct, frozen=True, kw_only=True):
    """One line: what is said, and what names it."""

    id: str
    text: str


class SaidRequest(SaidLine, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One thing said to a robot that knows a room, with nothing or something handled before."""

    kind: str  # how it is said; of one to be refused, why
    scene: str
    goals: tuple[str, ...] = ()  # none: it is to be refused
    handled: tuple[str, ...] = ()  # types of things handled before, the last used last

    def __post_init__(self) -> None:
        """Raise KarmaError where a goal cannot be read."""
        _ = self.wanted

    @property
    def wanted(self) -> tuple[Goal, ...]:
        """What must hold when it is done."""
        return tuple(parse_goal(goal) for goal in self.goals)


_Row = TypeVar("_Row", bound=SaidLine)


def load_said(path: str | Path) -> tuple[SaidRequest, ...]:
    """Read requests of one thing each; FileError names a line that is none."""
    return load_lines(path, SaidRequest)


def load_texts(path: str | Path) -> tuple[str, ...]:
    """Read what is said in a file of requests of either kind; errors as `load_said`."""
    return tuple(one.text for one in load_lines(path, SaidLine))


def load_lines(path: str | Path, row: type[_Row]) -> tuple[_Row, ...]:
    """Read lines of any kind; errors as in `load_said`."""
    found: dict[str, _Row] = {}
    for number, line in enumerate(read_bytes(path).splitlines(), start=1):
        try:
            one = msgspec.json.decode(line, type=row)
        except (KarmaError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise FileError(path, f"line {number}: {error}") from error
        if one.id in found:
            raise FileError(path, f"line {number}: id: {one.id!r} stands twice")
        found[one.id] = one
    return tuple(found.values())
