"""Read EB-ALFRED's lists of tasks."""

from pathlib import Path

from karma.errors import FileError
from karma.tasks.alfred_lists import ListedTask, read_lists

SUBSETS = (
    "base", "common_sense", "complex_instruction", "visual_appearance", "spatial", "long_horizon",
)  # fmt: skip


def read_tasks(path: Path, subsets: tuple[str, ...] = ()) -> tuple[ListedTask, ...]:
    """Read the tasks of a list of lists, in the order of `SUBSETS`.

    Args:
        path: JSON, subset -> entries.
        subsets: those that are wanted; () = all.

    Raises:
        FileError: see `read_lists`; or a task has no instruction.
    """
    tasks = read_lists(path, subsets)
    if silent := [task.id for task in tasks if not task.instruction]:
        raise FileError(path, f"task {silent[0]} has no instruction")
    order = subsets or SUBSETS
    rank = {name: number for number, name in enumerate(order)}
    return tuple(sorted(tasks, key=lambda task: rank.get(task.list, len(rank))))
