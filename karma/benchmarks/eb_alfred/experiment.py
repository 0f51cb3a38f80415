"""A run of EB-ALFRED is a TOML file: lists of tasks, rows, and the model that plans."""

from pathlib import Path
from typing import Literal

import msgspec

from karma.bench.experiment import check_listed
from karma.bench.experiment_tasks import select
from karma.benchmarks.eb_alfred.prompt import PromptOptions
from karma.errors import FileError
from karma.loading.models import Models
from karma.tasks.alfred_lists import ListedTask, read_lists

SUBSETS = (
    "base", "common_sense", "complex_instruction", "visual_appearance", "spatial", "long_horizon",
)  # fmt: skip


class EbRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One row of the table."""

    name: str
    player: Literal["planner", "expert", "chance"] = "planner"
    strict: bool = False  # follow the source where it is odd
    prompt: PromptOptions = PromptOptions()


class EbExperiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Every row on every task with every seed."""

    name: str
    benchmark: Literal["eb_alfred"]
    tasks: str  # EB-ALFRED's lists
    types: str  # its lists of types, in the order of the actions' numbers
    trials: str  # ALFRED's demonstrations of valid_seen
    rows: tuple[EbRow, ...]
    published: str = ""  # scores to print beside ours
    subsets: tuple[str, ...] = ()  # () = all
    only: tuple[str, ...] = ()  # ids of tasks; () = all
    models: Models = Models()
    seeds: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        """Refuse what there is nothing to do for, or what would be done twice."""
        check_listed([row.name for row in self.rows], self.seeds, self.only)

    @property
    def plans(self) -> bool:
        """Whether a model is needed."""
        return any(row.player == "planner" for row in self.rows)


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


def tasks_of(experiment: EbExperiment, path: Path) -> tuple[ListedTask, ...]:
    """Return the tasks that an experiment selects.

    Raises:
        FileError: the lists are damaged, or a task of `only` is not in them.
    """
    tasks = read_tasks(Path(experiment.tasks), experiment.subsets)
    return select(tasks, experiment.only, path)


def remarks_on(experiment: EbExperiment) -> list[str]:
    """Return what a reader of the table has to know about how its planners were asked."""
    found, models = [], experiment.models
    planners = [row for row in experiment.rows if row.player == "planner"]
    if planners and models.beyond_training:
        found.append(
            f"The planner's context of {models.n_ctx} tokens may be longer than what it was trained"
            " for."
        )
    held = [row for row in planners if row.prompt.constrained]
    for row in held:
        found.append(
            f"{row.name}: answers are held to the JSON that is asked for, with the room's actions, "
            f"{row.prompt.most_text} characters a text and {row.prompt.most_actions} actions at "
            "most."
        )
    return found
