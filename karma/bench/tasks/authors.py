"""The KARMA authors' own task files: their words, read as `authors.toml` has it.

Names there are loose and instructions are one string; what each asks for was read once. Notes of a
task are of three kinds: "unasked GOAL: ..." for one that judges nobody as no words ask for it,
"unresolved GOAL: reason" for one that nobody could bring about, "read GOAL as GOAL" for one that
could only be taken in another sense.
"""

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec

from karma.agent.goals.files import with_whole
from karma.agent.goals.goals import parse_goal
from karma.contracts import SceneRef, SubTask, Task
from karma.errors import FileError
from karma.files import read_json, read_toml

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
            yield _task(row, known, _KINDS[title])


def _task(
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
