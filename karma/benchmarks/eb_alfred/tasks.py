"""Read EB-ALFRED's lists of tasks."""

from dataclasses import dataclass
from pathlib import Path

import msgspec

from karma.errors import FileError
from karma.files import read_json

SUBSETS = (
    "base", "common_sense", "complex_instruction", "visual_appearance", "spatial", "long_horizon",
)  # fmt: skip


class _Entry(msgspec.Struct, frozen=True, kw_only=True):
    """One line of a list, as the benchmark writes it."""

    task: str  # "folder/trial"
    repeat_idx: int = 0
    instruction: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EbTask:
    """One task: an instruction in the room of a trial."""

    subset: str
    position: int  # in the list that was read, from 0
    folder: str
    trial: str  # id
    repeat: int  # of ALFRED's annotations, which one it replaces
    instruction: str

    @property
    def id(self) -> str:
        """Names it in records, e.g. "base/3"."""
        return f"{self.subset}/{self.position}"


def read_tasks(path: Path, subsets: tuple[str, ...] = ()) -> tuple[EbTask, ...]:
    """Read the tasks of a list of lists, in the order of `SUBSETS`.

    Args:
        path: JSON, subset -> entries.
        subsets: those that are wanted; () = all.

    Raises:
        FileError: missing, torn, of another form, or a subset is not in it.
    """
    lists = read_json(path, dict[str, tuple[_Entry, ...]], fix="give EB-ALFRED's splits.json")
    wanted = subsets or tuple(one for one in SUBSETS if one in lists) or tuple(lists)
    if unknown := [one for one in wanted if one not in lists]:
        raise FileError(path, f"no subset {unknown[0]!r}; there are {sorted(lists)}")
    return tuple(
        _task(path, subset, number, entry)
        for subset in wanted
        for number, entry in enumerate(lists[subset])
    )


def _task(path: Path, subset: str, number: int, entry: _Entry) -> EbTask:
    folder, _, trial = entry.task.partition("/")
    if not trial:
        raise FileError(path, f"{entry.task!r} is not folder/trial - at `$.{subset}[{number}]`")
    return EbTask(
        subset=subset,
        position=number,
        folder=folder,
        trial=trial,
        repeat=entry.repeat_idx,
        instruction=entry.instruction,
    )
