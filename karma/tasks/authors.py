"""The KARMA authors' own task files, whose names are loose and whose instructions are one string.

Loading splits the instruction into clauses and gives each goal to the clause in which it becomes
due; `resolve` then turns loose names into AI2-THOR types of one scene. `loose_names.toml` holds
what words mean. Notes of a task are of three kinds: "unasked GOAL: ..." for one that judges nobody
as no words ask for it, "unresolved GOAL: reason" for one that nobody could bring about, "read GOAL
as GOAL" for one that could only be taken in another sense.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec

from karma.contracts import Goal, SceneRef, Task
from karma.errors import FileError, KarmaError
from karma.files import read_json
from karma.household.states import canonical_state
from karma.tasks.clauses import clauses_of
from karma.tasks.files import with_whole
from karma.tasks.goals import ARITY, object_names, read_goal
from karma.tasks.loose_goals import GoalReader
from karma.tasks.loose_names import is_plural, names, state_of, tiers_of
from karma.tasks.splitting import assign, unasked

_KINDS: Mapping[str, Literal["simple", "composite", "complex"]] = {
    "SimpleTasks": "simple", "CompositeTasks": "composite", "ComplexTasks": "complex",
}  # fmt: skip


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
            clauses = clauses_of(row.instruction)
            apart = unasked(goals, clauses)
            notes += tuple(f"unasked {_brief(goal)}: no words ask for it" for goal in apart)
            task = Task(
                id=f"{_KINDS[title]}-{row.number}",
                kind=_KINDS[title],
                scene=SceneRef(name=f"FloorPlan{row.plan}"),
                subtasks=assign([goal for goal in goals if goal not in apart], clauses),
                notes=notes,
            )
            yield with_whole(task, row.instruction)


def read_goals(text: str) -> tuple[tuple[Goal, ...], tuple[str, ...]]:
    """Return the goals of one "Goal Condition", and notes on what in it is none."""
    goals, notes = [], []
    form = r"(?:\d+\s*\*\s*)?[A-Za-z]+\s*\((?:[^()]|\([^()]*\))*\)(?:\s*:\s*1\b)?"
    for part in re.findall(form, text):
        goal = _usual(read_goal(part))
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


def _usual(goal: Goal) -> Goal:
    """Return a goal with the paper's predicate for a loose one: HOLD(cup), SLICED(apple)."""
    word = names().predicates.get(goal.predicate, goal.predicate)
    if len(goal.arguments) != 1:
        return replace(goal, predicate=word)
    if word == "HOLDON":
        return replace(goal, predicate=word, arguments=("robot", *goal.arguments))
    state = state_of(word)
    if word not in ARITY and state is not None:
        return replace(goal, predicate="STATE", arguments=(*goal.arguments, state))
    return replace(goal, predicate=word)


# ----------------------------------------------------------------- resolving


def resolve(task: Task, scene_object_types: Iterable[str]) -> Task:
    """Return the task with AI2-THOR types of one scene for its loose names.

    A name that leaves several types open keeps them all ("DiningTable/SideTable"). What cannot be
    resolved, or never be true, leaves the goals and enters the notes, so that every goal is either
    in a sub-task or in a note.

    Args:
        task: of `load_authors_tasks`.
        scene_object_types: the type of each object that the scene holds at reset.
    """
    notes = list(task.notes)
    reader = GoalReader(Counter(scene_object_types))
    subtasks = []
    for subtask in task.subtasks:
        read: dict[Goal, Goal] = {}
        for goal in subtask.goals:
            try:
                read[goal] = reader.read(goal, (subtask.instruction, subtask.whole))
            except KarmaError as error:
                notes.append(_unresolved(goal, str(error)))
                continue
            if not _plain(goal, read[goal]):
                notes.append(f"read {_brief(goal)} as {_brief(read[goal])}")
        passing = {read[goal] for goal in subtask.passing if goal in read}
        goals = tuple(dict.fromkeys(read.values()))
        subtasks.append(
            replace(subtask, goals=goals, passing=tuple(g for g in goals if g in passing))
        )
    return replace(task, subtasks=tuple(subtasks), notes=tuple(notes))


def _plain(goal: Goal, read: Goal) -> bool:
    """Return whether nothing but spelling was changed: same predicate, first tier, one object."""
    if goal.predicate != read.predicate or goal.count != read.count:
        return False
    if goal.predicate == "STATE" and canonical_state(goal.arguments[1]) != read.arguments[1]:
        return False
    for name, kinds in zip(object_names(goal), object_names(read), strict=True):
        first = (*tiers_of(name), ())[0]
        if is_plural(name) or not set(kinds.split("/")) <= set(first):
            return False
    return True


def _brief(goal: Goal) -> str:
    return str(goal).removesuffix(": 1")


def _unresolved(goal: Goal, reason: str) -> str:
    return f"unresolved {_brief(goal)}: {reason}"
