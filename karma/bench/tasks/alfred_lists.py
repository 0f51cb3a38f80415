"""Lists of ALFRED's tasks as others publish them: which trial, and in whose words.

A file of JSON has several lists by their names, each of entries such as
`{"task": "folder/trial", "repeat_idx": 2, "instruction": "..."}`. Without an instruction the
sentence is the trial's own of that number.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import msgspec

from karma.errors import FileError
from karma.files import read_json


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
