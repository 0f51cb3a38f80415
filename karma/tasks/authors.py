"""The KARMA authors' own task files, whose names are loose and whose instructions are one string.

Loading splits the instruction into clauses and gives each goal to the clause in which it becomes
due; `resolve` then turns loose names into AI2-THOR types of one scene. `loose_names.toml` holds
what words mean. Notes of a task are of two kinds: "unresolved GOAL: reason" for a goal that was
dropped, "read GOAL as GOAL" for one that could only be taken in another sense.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec

from karma.contracts import Goal, SceneRef, Task
from karma.errors import FileError, KarmaError
from karma.files import read_json
from karma.household.pieces import base_type
from karma.household.states import END_STATES, NEEDS, canonical_state
from karma.household.types import Capability, object_type
from karma.household.uses import BURNER, LAMPS
from karma.tasks.goals import ARITY, is_position, object_names, read_goal
from karma.tasks.splitting import (
    assign,
    exclude,
    key_of,
    meaning,
    split_instruction,
    tiers_of,
    words_of,
)

_KINDS: Mapping[str, Literal["simple", "composite", "complex"]] = {
    "SimpleTasks": "simple", "CompositeTasks": "composite", "ComplexTasks": "complex",
}  # fmt: skip
_NEEDS: Mapping[str, Capability] = {
    **NEEDS,
    **{goal: NEEDS[state] for goal, state in END_STATES.items()},
    "HOLDON": "pickupable",
}  # of states and predicates


class _AuthorsRow(msgspec.Struct, frozen=True, kw_only=True):
    plan: int = msgspec.field(name="FloorPlan")
    number: int = msgspec.field(name="ID")
    goals: str = msgspec.field(name="Goal Condition")
    instruction: str = msgspec.field(name="Instruction")


# ----------------------------------------------------------------- loading


def load_authors_tasks(paths: Iterable[str | Path]) -> tuple[Task, ...]:
    """Read files of the authors' form; goals keep their loose names until `resolve`.

    Raises:
        FileError: a file is not of that form.
    """
    return tuple(task for path in paths for task in _load(path))


def _load(path: str | Path) -> Iterable[Task]:
    for title, rows in read_json(path, dict[str, list[_AuthorsRow]]).items():
        if title not in _KINDS:
            raise FileError(path, f"unknown list {title!r}; known are {', '.join(_KINDS)}")
        for row in rows:
            goals, notes = read_goals(row.goals)
            yield Task(
                id=f"{_KINDS[title]}-{row.number}",
                kind=_KINDS[title],
                scene=SceneRef(name=f"FloorPlan{row.plan}"),
                subtasks=assign(goals, split_instruction(row.instruction)),
                notes=notes,
            )


def read_goals(text: str) -> tuple[tuple[Goal, ...], tuple[str, ...]]:
    """Return the goals of one "Goal Condition", and notes on what in it is none."""
    goals, notes = [], []
    form = r"[A-Za-z]+\s*\((?:[^()]|\([^()]*\))*\)(?:\s*:\s*1\b)?"
    for part in re.findall(form, text):
        goal = read_goal(part)
        arity = ARITY.get(goal.predicate)
        if arity is None:
            notes.append(_unresolved(goal, "unknown predicate"))
        elif arity != len(goal.arguments) or not all(goal.arguments):
            notes.append(_unresolved(goal, f"{goal.predicate} takes {arity} argument(s)"))
        else:
            goals.append(goal)
    rest = re.sub(form, "", text).strip(" ,.;\n")
    notes += [f"unresolved {part.strip()}: not a goal" for part in rest.split(",") if part.strip()]
    return tuple(goals), tuple(notes)


# ----------------------------------------------------------------- resolving


def resolve(task: Task, scene_object_types: Collection[str]) -> Task:
    """Return the task with AI2-THOR types of one scene for its loose names.

    A name that leaves several types open keeps them all ("DiningTable/SideTable"). What cannot be
    resolved, or never be true, leaves the goals and enters the notes, so that every goal is either
    in a sub-task or in a note.

    Args:
        task: of `load_authors_tasks`.
        scene_object_types: the types that the scene holds at reset.
    """
    notes = list(task.notes)
    subtasks = []
    for subtask in task.subtasks:
        goals: list[Goal] = []
        for goal in subtask.goals:
            try:
                read = _resolve_goal(goal, frozenset(scene_object_types))
            except KarmaError as error:
                notes.append(_unresolved(goal, str(error)))
                continue
            if any(exclude(read, other) and read != other for other in goals):
                notes.append(_unresolved(goal, "excluded by another goal of its clause"))
                continue
            if not _plain(goal, read):
                notes.append(f"read {_brief(goal)} as {_brief(read)}")
            goals.append(read)
        subtasks.append(replace(subtask, goals=tuple(dict.fromkeys(goals))))
    return replace(task, subtasks=tuple(subtasks), notes=tuple(notes))


def _resolve_goal(goal: Goal, present: frozenset[str]) -> Goal:
    """Return one goal with types for names; KarmaError says why that cannot be."""
    if goal.predicate in ("ON", "INSIDE"):
        return _resolve_placement(goal, present)
    kinds = _present(object_names(goal)[0], present)
    if goal.predicate == "STATE":
        word = canonical_state(goal.arguments[1])
        if word is not None:
            return _resolve_state(kinds, word)
        if not meaning(goal.arguments[1]):
            raise KarmaError(f"{goal.arguments[1]!r} is neither a state nor an object")
        return _resolve_placement(Goal(predicate="ON", arguments=goal.arguments), present)
    kinds = _able(kinds, _NEEDS[goal.predicate])
    arguments = ("robot", "/".join(kinds)) if goal.predicate == "HOLDON" else ("/".join(kinds),)
    return Goal(predicate=goal.predicate, arguments=arguments)


def _resolve_state(kinds: Sequence[str], word: str) -> Goal:
    """Return a STATE goal; what AI2-THOR cannot cook must be heated instead."""
    try:
        able = _able(kinds, _NEEDS[word]) if word in _NEEDS else kinds
    except KarmaError:
        if word != "cooked":
            raise
        able, word = _able(kinds, "pickupable"), "heated"
    return Goal(predicate="STATE", arguments=("/".join(able), word))


def _resolve_placement(goal: Goal, present: frozenset[str]) -> Goal:
    """Return a placement whose object can be carried to its place.

    What is "on" a thing that holds nothing is beside it; what a lamp is "on" is held in its light.
    """
    moved = _present(goal.arguments[0], present)
    if is_position(goal.arguments[1]):
        place = "(" + ", ".join(_numbers(goal.arguments[1])) + ")"
        return Goal(predicate="ON", arguments=("/".join(_able(moved, "pickupable")), place))
    places = _present(goal.arguments[1], present)
    if all(kind in LAMPS for kind in moved) and object_type(places[0]).can("pickupable"):
        return Goal(predicate="HOLDON", arguments=("robot", "/".join(places)))
    moved = _able(moved, "pickupable")
    beside = not any(object_type(place).can("receptacle") for place in places)
    if beside and all(object_type(place).can("pickupable") for place in places):
        return Goal(predicate="ON", arguments=("/".join(moved), "/".join(places)))
    places = _able(places, "receptacle")
    pairs = [
        (one, place)
        for one in moved
        for place in places
        if object_type(one).fits(object_type(place))
    ]
    if not pairs:
        raise KarmaError(f"AI2-THOR lets no {'/'.join(moved)} into {'/'.join(places)}")
    both = ("/".join(dict.fromkeys(names)) for names in zip(*pairs, strict=True))
    return Goal(predicate=goal.predicate, arguments=tuple(both))


def _present(name: str, present: frozenset[str]) -> tuple[str, ...]:
    """Return the scene's types of the first tier of a name that it has any of."""
    tiers = tiers_of(name)
    if not tiers:
        raise KarmaError(f"no object type is called {name!r}")
    for tier in tiers:
        here = tuple(k for k in tier if k in present or base_type(k) in present)
        if here:
            return here
    raise KarmaError(f"the scene has no {'/'.join(k for tier in tiers for k in tier)}")


def _able(kinds: Sequence[str], capability: Capability) -> tuple[str, ...]:
    """Return the types with a capability, their slices' included."""
    able = tuple(
        kind
        for kind in kinds
        if any(
            object_type(one).can(capability)
            for one in (kind, object_type(kind).slices_into)
            if one is not None
        )
        or (capability == "toggleable" and kind == BURNER)
    )
    if not able:
        raise KarmaError(f"{'/'.join(kinds)} is not {capability}")
    return able


def _numbers(place: str) -> list[str]:
    numbers = re.findall(r"-?\d+(?:\.\d+)?", place)
    if len(numbers) != 3:
        raise KarmaError(f"{place} is no position (x, y, z)")
    return numbers


def _plain(goal: Goal, read: Goal) -> bool:
    """Return whether nothing but spelling was changed: same predicate, first tier, one object."""
    if goal.predicate != read.predicate:
        return False
    if goal.predicate == "STATE" and canonical_state(goal.arguments[1]) != read.arguments[1]:
        return False
    for name, kinds in zip(object_names(goal), object_names(read), strict=True):
        first = tiers_of(name)[0]
        plural = key_of(name) != "".join(words_of(name))
        if plural or not set(kinds.split("/")) <= set(first):
            return False
    return True


def _brief(goal: Goal) -> str:
    return str(goal).removesuffix(": 1")


def _unresolved(goal: Goal, reason: str) -> str:
    return f"unresolved {_brief(goal)}: {reason}"
