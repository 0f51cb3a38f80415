"""Tasks that others published: ALFRED's trials, and the KARMA authors' own task files.

Goals of a trial agree with ALFRED's own conditions. Trials are in lists that others publish, or all
that people said of them. Rooms are those of the trials, as they were at the demonstration's start.
What cannot be asked stays in as a task without goals, whose note says why.

The words follow `karma.plugins.alfred.replay.goal`, which decides on metadata. A target there means
any part of an id: Pen becomes `Pen/Pencil`. For each kind of task:

    pick_and_place_simple             ON(thing, place)
    pick_two_obj_and_place            2*ON(thing, place)
    look_at_obj_in_light              HOLDON(robot, thing), STATE(lamp, shining)
    pick_{clean,heat,cool}_then_place STATE(thing, {cleaned, heated, cooled}), ON(thing, place)
    pick_and_place_with_movable       ON(thing, dish), ON(dish, place)

Of sliced targets the thing is the type of the slices, so that a slice itself has to be treated, and
STATE(whole, sliced) comes first. `GoalTracker.progress` then counts what ALFRED counts. One thing
differs: "heated" is also what a burner made hot, where ALFRED knows only the microwave.

In the authors' files names are loose and instructions are one string; what each asks for was read
once and stands in `authors.toml`. Notes of such a task are of three kinds: "unasked GOAL: ..." for
one that judges nobody as no words ask for it, "unresolved GOAL: reason" for one that nobody could
bring about, "read GOAL as GOAL" for one that could only be taken in another sense.
"""

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import msgspec

from karma.errors import FileError, KarmaError
from karma.files import read_json, read_toml, to_json
from karma.goals.files import with_whole
from karma.goals.goals import parse_goal
from karma.household.pieces import piece_type
from karma.household.types import Capability, names_then, object_types, type_now
from karma.household.uses import covers
from karma.plugins.alfred.replay.facts import RoomFacts, gather, side_files
from karma.plugins.alfred.replay.replay import fitted
from karma.plugins.alfred.replay.trial import Trial, read_trials
from karma.plugins.alfred.sentences import plain, sentences_in
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.types.space import SceneRef
from karma.types.tasks import Goal, SubTask, Task


class _ListedEntry(msgspec.Struct, frozen=True, kw_only=True):
    task: str
    repeat_idx: int = 0
    instruction: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedTask:
    """One entry of a list."""

    list: str
    position: int  # in the list that was read, from 0
    folder: str  # begins with the type of task
    trial: str  # id
    repeat: int  # number of the trial's annotation that is meant, or replaced
    instruction: str = ""  # in place of that annotation

    @property
    def id(self) -> str:
        """Names it in records, e.g. "base/3"."""
        return f"{self.list}/{self.position}"


def read_lists(path: Path, names: Iterable[str] = ()) -> tuple[ListedTask, ...]:
    """Read lists of tasks, in the order in which they are wanted.

    No names are all lists, in the file's order.

    Raises:
        FileError: missing, torn, of another form, or it has no such list.
    """
    fix = "give a file of lists, such as EB-ALFRED's splits.json"
    lists = read_json(path, dict[str, tuple[_ListedEntry, ...]], fix=fix)
    wanted = tuple(names) or tuple(lists)
    if unknown := [one for one in wanted if one not in lists]:
        raise FileError(path, f"no list {unknown[0]!r}; there are {sorted(lists)}")
    return tuple(
        _listed(path, name, position, entry)
        for name in wanted
        for position, entry in enumerate(lists[name])
    )


def _listed(path: Path, name: str, position: int, entry: _ListedEntry) -> ListedTask:
    folder, _, trial = entry.task.partition("/")
    if not trial:
        raise FileError(path, f"{entry.task!r} is not folder/trial - at `$.{name}[{position}]`")
    return ListedTask(
        list=name,
        position=position,
        folder=folder,
        trial=trial,
        repeat=entry.repeat_idx,
        instruction=entry.instruction,
    )


_DEEDS = {
    "pick_clean_then_place_in_recep": "cleaned",
    "pick_heat_then_place_in_recep": "heated",
    "pick_cool_then_place_in_recep": "cooled",
}


def task_of(trial: Trial, instruction: str, *, scene: SceneRef | None = None, id: str = "") -> Task:
    """Return a trial's task, asked for in some words.

    Where no scene or id is given, they are the trial's FloorPlan by name and the trial's id.
    """
    subtask = SubTask(instruction=instruction, whole=instruction, goals=goals_of(trial))
    return Task(
        id=id or trial.id,
        kind="simple",
        scene=scene or SceneRef(name=trial.scene.floor_plan),
        subtasks=(subtask,),
    )


def goals_of(trial: Trial) -> tuple[Goal, ...]:
    """Return what is to hold when a trial's task is done."""
    wanted, kind = trial.pddl_params, trial.task_type
    count = 2 if kind == "pick_two_obj_and_place" else 1
    target = wanted.object_target
    thing = _name(piece_type(target) if wanted.object_sliced else target, "pickupable")
    goals: list[Goal] = []
    if wanted.object_sliced:
        goals.append(_goal("STATE", _name(target, "sliceable"), "sliced", count=count))
    if kind == "look_at_obj_in_light":
        lamp = _name(wanted.toggle_target, "toggleable")
        return (*goals, _goal("HOLDON", "robot", thing), _goal("STATE", lamp, "shining"))
    if kind in _DEEDS:
        goals.append(_goal("STATE", thing, _DEEDS[kind]))
    place = _name(wanted.parent_target, "receptacle")
    if kind == "pick_and_place_with_movable_recep":
        dish = _name(wanted.mrecep_target, "pickupable", "receptacle")
        return (*goals, _goal("ON", thing, dish), _goal("ON", dish, place))
    return (*goals, _goal("ON", thing, place, count=count))


def _name(target: str, *needed: Capability) -> str:
    """Return the types that ALFRED finds by a target, itself first: all with it in their names."""
    found = [target]
    for name in sorted(names_then()):
        now = type_now(name)
        kind = object_types().get(now or "")
        if kind is None or target not in name or not all(map(kind.can, needed)):
            continue
        if not any(covers(one, name) for one in found):
            found.append(name)
    return "/".join(found)


def _goal(predicate: str, *arguments: str, count: int = 1) -> Goal:
    return Goal(predicate=predicate, arguments=arguments, count=count)


class AlfredTasks(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which of ALFRED's tasks are asked."""

    trials: str  # demonstrations
    lists: str = ""  # file of lists of tasks; "" = everything that people said of every trial
    names: tuple[str, ...] = ()  # of those lists; () = all
    by: Literal["type", "list"] = "type"  # of task; what is counted apart
    training: str = ""  # demonstrations whose sentences a planner was trained on

    def __post_init__(self) -> None:
        """Refuse what needs a file of lists without one."""
        if not self.lists and (self.names or self.by == "list"):
            raise ValueError("names and by = 'list' need `lists`")


def read_alfred(options: Mapping[str, Any]) -> tuple[tuple[Task, ...], dict[str, bytes]]:
    """Return the tasks and rooms of an experiment's [source] of kind "alfred"."""
    return alfred_tasks(msgspec.convert(options, AlfredTasks))


def alfred_tasks(source: AlfredTasks) -> tuple[tuple[Task, ...], dict[str, bytes]]:
    """Return the tasks, and the rooms that they play in by name.

    Raises:
        FileError: a file is missing, torn or of another form, or a list is not in it. A training
            file that is missing is none: then it is not known what is in it.
    """
    trials = {trial.id: trial for trial in read_trials(source.trials)}
    listed = (
        read_lists(Path(source.lists), source.names)
        if source.lists
        else tuple(_all_said(trials.values()))
    )
    known = _known(source.training)
    rooms = _Rooms(trials, gather(trials.values(), side_files()))
    tasks = tuple(_grouped(_task(one, rooms), one, source, known) for one in listed)
    return tasks, rooms.scenes


def _all_said(trials: Iterable[Trial]) -> Iterator[ListedTask]:
    for trial in trials:
        for number in range(len(trial.annotations)):
            yield ListedTask(
                list=trial.id,
                position=number,
                folder=trial.task_type,
                trial=trial.id,
                repeat=number,
            )


def _known(training: str) -> frozenset[str] | None:
    return sentences_in(Path(training)) if training and Path(training).exists() else None


def _grouped(
    task: Task, one: ListedTask, source: AlfredTasks, known: frozenset[str] | None
) -> Task:
    said = (plain(sub.instruction) for sub in task.subtasks)
    return replace(
        task,
        group=one.list if source.by == "list" else one.folder.partition("-")[0],
        trained=None if known is None else all(text in known for text in said),
    )


class _Rooms:
    """The rooms of trials, each built once, when it is first asked for."""

    def __init__(self, trials: Mapping[str, Trial], facts: Mapping[str, RoomFacts]) -> None:
        self.trials, self._facts = trials, facts
        self.scenes: dict[str, bytes] = {}

    def of(self, trial: Trial) -> SceneRef:
        """Return the room of a trial.

        Raises:
            KarmaError: the trial contradicts itself, or there is nothing to stand on.
        """
        plan = trial.scene.floor_plan
        ref = SceneRef(name=f"{plan}-{trial.id}")
        if ref.name not in self.scenes:
            if not self._facts[plan].cells:
                raise KarmaError(f"there is nothing to stand on in {plan}")
            scene = fitted(trial, self._facts[plan])
            self.scenes[ref.name] = to_json(msgspec.structs.replace(scene, name=ref.name))
        return ref


def _task(one: ListedTask, rooms: _Rooms) -> Task:
    """Return one task; without goals where it cannot be asked."""
    text = one.instruction
    try:
        trial = rooms.trials.get(one.trial)
        if trial is None:
            raise KarmaError(f"there is no trial {one.trial}")
        if not text and not 0 <= one.repeat < len(trial.annotations):
            raise KarmaError(f"trial {one.trial} has no annotation {one.repeat}")
        text = text or trial.annotations[one.repeat].task_desc
        return task_of(trial, text, scene=rooms.of(trial), id=one.id)
    except KarmaError as error:
        reason = error.reason if isinstance(error, FileError) else str(error)
        return Task(
            id=one.id,
            kind="simple",
            scene=SceneRef(name=one.trial),
            subtasks=(SubTask(instruction=text, whole=text),),
            notes=(f"unresolved {one.id}: {reason}",),
        )


# ----------------------------------------------------------------- the KARMA authors' tasks

READ = Path(__file__).parent / "authors.toml"
_KINDS: Mapping[str, Literal["simple", "composite", "complex"]] = {
    "SimpleTasks": "simple", "CompositeTasks": "composite", "ComplexTasks": "complex",
}  # fmt: skip
_GOAL = re.compile(r"(?:\d+\s*\*\s*)?[A-Za-z]+\s*\((?:[^()]|\([^()]*\))*\)")


class _AuthorsRow(msgspec.Struct, frozen=True, kw_only=True):
    plan: int = msgspec.field(name="FloorPlan")
    number: int = msgspec.field(name="ID")
    goals: str = msgspec.field(name="Goal Condition")
    instruction: str = msgspec.field(name="Instruction")

    @property
    def sha256(self) -> str:
        """What it is known by."""
        said = msgspec.json.encode([self.plan, self.goals, self.instruction])
        return hashlib.sha256(said).hexdigest()


class _ReadTask(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    id: str
    sha256: str
    clauses: tuple[tuple[int, int], ...]  # where each begins and ends in the instruction
    goals: tuple[tuple[str, ...], ...]  # of each clause
    passing: tuple[tuple[str, ...], ...] = ()  # of them, those that need not hold at the end
    notes: tuple[tuple[str, int, str], ...] = ()  # kind, number of the goal, reason or reading


class _ReadTasks(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    tasks: tuple[_ReadTask, ...]


@cache
def _read() -> Mapping[str, _ReadTask]:
    return {one.id: one for one in read_toml(READ, _ReadTasks).tasks}


class AuthorsTasks(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The authors' task files, and the rooms that they play in."""

    files: tuple[str, ...]
    scenes: str  # an AI2-THOR dump of the floor plans
    layouts: str = ""  # reachable cells for them


def read_authors(options: Mapping[str, Any]) -> tuple[tuple[Task, ...], dict[str, bytes]]:
    """Return the tasks and rooms of an experiment's [source] of kind "authors"."""
    source = msgspec.convert(options, AuthorsTasks)
    raw = load_authors_tasks(source.files)
    plans = {task.scene.name for task in raw}
    dump = import_dump(source.scenes, layouts=source.layouts or None)
    scenes = {scene.name: to_json(scene) for scene in dump if scene.name in plans}
    tasks = (
        task
        if (name := task.scene.name) in scenes
        else replace(task, notes=(*task.notes, f"no dump of {name}"))
        for task in raw
    )
    return tuple(tasks), scenes


def load_authors_tasks(paths: Iterable[str | Path]) -> tuple[Task, ...]:
    """Read files of the authors' form.

    Raises:
        FileError: a file is not of that form, or has a task that is none of theirs.
    """
    return tuple(task for path in paths for task in _load(path))


def _load(path: str | Path) -> Iterable[Task]:
    for title, rows in read_json(path, dict[str, list[_AuthorsRow]]).items():
        if title not in _KINDS:
            raise FileError(path, f"unknown list {title!r}; known are {', '.join(_KINDS)}")
        for row in rows:
            name = f"{_KINDS[title]}-{row.number}"
            known = _read().get(name)
            if known is None or known.sha256 != row.sha256:
                raise FileError(
                    path, f"{name}: none of the authors' tasks as they were published",
                    fix="tasks of your own as JSONL: eval/alfred_l/README.md",
                )  # fmt: skip
            yield _authors_task(row, known, _KINDS[title])


def _authors_task(
    row: _AuthorsRow, known: _ReadTask, kind: Literal["simple", "composite", "complex"]
) -> Task:
    passing = known.passing or ((),) * len(known.goals)
    subtasks = tuple(
        SubTask(
            instruction=row.instruction[begin:end],
            goals=tuple(map(parse_goal, goals)),
            passing=tuple(map(parse_goal, passes)),
        )
        for (begin, end), goals, passes in zip(known.clauses, known.goals, passing, strict=True)
    )
    scene = SceneRef(name=f"FloorPlan{row.plan}")
    task = Task(
        id=known.id, kind=kind, scene=scene, subtasks=subtasks, notes=_notes(row, known.notes)
    )
    return with_whole(task, row.instruction)


def _notes(row: _AuthorsRow, notes: Sequence[tuple[str, int, str]]) -> tuple[str, ...]:
    said = _GOAL.findall(row.goals)
    return tuple(
        f"{kind} {said[number]}{' as ' if kind == 'read' else ': '}{what}"
        for kind, number, what in notes
    )
