"""A run of LoTa-Bench's ALFRED is a TOML file: a draw of tasks, rows, and the model that plans."""

import random
from pathlib import Path
from typing import Literal

import msgspec

from karma.bench.experiment import check_listed
from karma.bench.experiment_tasks import select
from karma.benchmarks.lota_alfred.prompt import LotaPromptOptions
from karma.contracts import Scoring
from karma.errors import FileError
from karma.loading.models import Models
from karma.tasks.alfred_lists import ListedTask, read_lists

_LEFT_OUT = "pick_two_obj_and_place"


class LotaRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One row of the table."""

    name: str
    player: Literal["scored", "generated", "expert", "chance"] = "scored"
    scoring: Scoring = "sum"
    strict: bool = False  # follow the source where it is odd
    prompt: LotaPromptOptions = LotaPromptOptions()


class LotaExperiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Every row on every task of a draw with every seed."""

    name: str
    benchmark: Literal["lota_alfred"]
    tasks: str  # ALFRED's lists, such as its oct21.json
    types: str  # EB-ALFRED's lists of types, which are LoTa-Bench's
    trials: str  # ALFRED's demonstrations of the lists
    rows: tuple[LotaRow, ...]
    lists: tuple[str, ...] = ()  # () = all
    percent: int = 100  # of them, drawn
    draw_seed: int = 1  # the source's
    only: tuple[str, ...] = ()  # ids of tasks that were drawn; () = all
    models: Models = Models()
    seeds: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        """Refuse what there is nothing to do for, or what would be done twice."""
        check_listed([row.name for row in self.rows], self.seeds, self.only)
        if not 1 <= self.percent <= 100:
            raise ValueError(f"percent = {self.percent}: 1 to 100")

    @property
    def plans(self) -> bool:
        """Whether a model is needed."""
        return any(row.player in ("scored", "generated") for row in self.rows)


def draw_tasks(
    path: Path, lists: tuple[str, ...] = (), *, percent: int = 100, seed: int = 1
) -> tuple[ListedTask, ...]:
    """Return a draw of tasks, in the order in which they were drawn, but for those of two objects.

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


def tasks_of(experiment: LotaExperiment, path: Path) -> tuple[ListedTask, ...]:
    """Return the tasks that an experiment draws.

    Raises:
        FileError: the lists are damaged, none is drawn, or a task of `only` is not drawn.
    """
    lists = Path(experiment.tasks)
    seed, percent = experiment.draw_seed, experiment.percent
    tasks = draw_tasks(lists, experiment.lists, percent=percent, seed=seed)
    if not tasks:
        raise FileError(path, f"percent = {percent}: no task is drawn from {lists.name}")
    return select(tasks, experiment.only, path)
