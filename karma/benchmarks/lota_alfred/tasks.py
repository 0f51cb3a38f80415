"""Draw LoTa-Bench's tasks out of ALFRED's lists; its two-object tasks are left out, as there."""

import random
from pathlib import Path

from karma.tasks.alfred_lists import ListedTask, read_lists

_LEFT_OUT = "pick_two_obj_and_place"


def draw_tasks(
    path: Path, lists: tuple[str, ...] = (), *, percent: int = 100, seed: int = 1
) -> tuple[ListedTask, ...]:
    """Return a draw of tasks, in the order in which they were drawn.

    The same list, percentage and seed give the source's draw.

    Args:
        path: of the lists.
        lists: those that are wanted; () = all.
        percent: of them, 1 to 100; rounded down to whole tasks.
        seed: of the draw.

    Raises:
        FileError: see `read_lists`.
    """
    tasks = tuple(one for one in read_lists(path, lists) if _LEFT_OUT not in one.folder)
    if percent == 100:
        return tasks
    drawn = random.Random(seed).sample(tasks, len(tasks) * percent // 100)
    return tuple(drawn)


def type_of_task(task: ListedTask) -> str:
    """Return the type of a task, which its folder begins with."""
    return task.folder.partition("-")[0]
