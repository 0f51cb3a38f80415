"""Access traces: which units each task of a sequence needs, and the files that say so.

Four kinds of file, told apart by their names:

- `*.json`: ours. `{"trace": [key, ...]}` has one key a request, `{"tasks": [[key, ...], ...]}` the
  keys of each task, `{"sequences": [[[key, ...], ...], ...]}` several sequences of tasks. Keys are
  texts or integers; what else stands there is left alone.
- `*.jsonl`: a task file, a trace a line; a sub-task's units are the types that can be carried and
  that its goals speak of, each in its room, which is what hits of an episode are counted over.
- `*.trace`, `*.trace.gz`: the LIRS authors' form, one block number a line, `*` between phases.
- anything else: one key a line, as text; `*.gz` is unpacked.
"""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import msgspec

from karma.contracts import Task
from karma.errors import FileError
from karma.files import decode_json, read_bytes, to_json, unpack
from karma.tasks.files import load_tasks, required_types

Key = int | str

_FORMS = 'give {"trace": [...]}, {"tasks": [[...]]} or {"sequences": [[[...]]]}'


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


class _File(msgspec.Struct, frozen=True):
    trace: tuple[Key, ...] | None = None
    tasks: tuple[tuple[Key, ...], ...] | None = None
    sequences: tuple[tuple[tuple[Key, ...], ...], ...] | None = None


def read_traces(path: Path, column: str = "") -> tuple[Trace, ...]:
    """Return the sequences of a file, mostly one.

    Args:
        path: the file.
        column: of a text with columns, between commas, tabs or blanks: where the keys are, by the
            name in its first line or by number, from 1; "": a line is a key.

    Raises:
        FileError: missing, torn, of no such form, or without a request.
    """
    name = path.name.removesuffix(".gz")
    data = _unpacked(path) if path.name.endswith(".gz") else read_bytes(path)
    if path.name.endswith(".jsonl"):
        found = tuple(trace_of_task(task) for task in load_tasks(path))
    elif name.endswith(".json"):
        found = _from_json(data, path)
    elif name.endswith(".trace"):
        found = (Trace.of((block,) for block in _blocks(data, path)),)
    else:
        keys = _column(_lines(data, path), column, path) if column else _lines(data, path)
        found = (Trace.of((key,) for key in keys if key),)
    if not all(trace.requests for trace in found) or not found:
        raise FileError(path, "no requests in it")
    return found


def trace_of_task(task: Task) -> Trace:
    """Return what the sub-tasks of a task ask for, a unit being a type in its room."""
    return Trace.of(
        [f"{(sub.scene or task.scene).name}/{name}" for name in required_types(sub)]
        for sub in task.subtasks
    )


def traces_json(traces: Iterable[Trace]) -> bytes:
    """Return sequences in our form."""
    return to_json({"sequences": [trace.named() for trace in traces]})


def _unpacked(path: Path) -> bytes:
    return unpack(read_bytes(path), path=path)


def _from_json(data: bytes, path: Path) -> tuple[Trace, ...]:
    file = decode_json(data, _File, path=path)
    given = [one for one in (file.trace, file.tasks, file.sequences) if one is not None]
    if len(given) != 1:
        raise FileError(path, f"{len(given)} traces in it; {_FORMS}")
    if file.trace is not None:
        return (Trace.of((key,) for key in file.trace),)
    if file.tasks is not None:
        return (Trace.of(file.tasks),)
    return tuple(Trace.of(tasks) for tasks in file.sequences or ())


def _lines(data: bytes, path: Path) -> list[str]:
    try:
        return [line.strip() for line in data.decode().splitlines()]
    except UnicodeDecodeError as error:
        raise FileError(path, f"not a text of one key a line: {error}") from error


def _column(lines: Sequence[str], column: str, path: Path) -> Iterator[str]:
    """Yield a column's cells; where it has a name, those below the name."""
    first = lines[0] if lines else ""
    mark = next((one for one in ",\t;" if one in first), None)
    rows = csv.reader(lines, delimiter=mark) if mark else (line.split() for line in lines)
    head = [one.strip() for one in next(iter(rows), [])]
    by_number = column.isdecimal() and column not in head
    if not by_number and column not in head:
        fix = "--column with one of these names, or a number from 1"
        raise FileError(
            path, f"no column {column!r}; its first line has {', '.join(head)}", fix=fix
        )
    at = int(column) - 1 if by_number else head.index(column)
    for number, cells in enumerate([head, *rows] if by_number else rows, 1 + (not by_number)):
        if cells and not 0 <= at < len(cells):
            raise FileError(path, f"line {number}: it has {len(cells)} columns", fix="--column")
        if cells:
            yield cells[at].strip()


def comes_again(traces: Iterable[Trace]) -> bool:
    """Return whether any key is asked for twice: else no memory of any size has a hit."""
    return any(trace.requests > len(trace.keys) for trace in traces)


def _blocks(data: bytes, path: Path) -> list[int]:
    blocks = []
    for number, line in enumerate(_lines(data, path), start=1):
        if line in ("", "*"):
            continue
        try:
            blocks.append(int(line))
        except ValueError:
            raise FileError(path, f"line {number}: {line[:40]!r} is no block number") from None
    return blocks
