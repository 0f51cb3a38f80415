"""A run of EB-ALFRED or LoTa-Bench's ALFRED is a TOML file: tasks, rows, the model that plans."""

import random
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from karma.bench.engine.experiment import check_listed, select
from karma.errors import FileError
from karma.loading.models import Models
from karma.plugins.alfred.published_tasks import ListedTask, read_lists
from karma.plugins.alfred.suites.eb_planner import PromptOptions, kind_of
from karma.plugins.alfred.suites.lota_planner import LotaPromptOptions
from karma.types.completion import Scoring

SUBSETS = (
    "base", "common_sense", "complex_instruction", "visual_appearance", "spatial", "long_horizon",
)  # fmt: skip
_LEFT_OUT = "pick_two_obj_and_place"
_SCRIPTED = ("expert", "chance")  # players without a model


class AlfredRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One row of the table."""

    name: str
    player: str
    strict: bool = False  # follow the source where it is odd


class EbRow(AlfredRow, frozen=True, kw_only=True):
    """One row of EB-ALFRED's table."""

    player: Literal["planner", "expert", "chance"] = "planner"
    prompt: PromptOptions = PromptOptions()

    def shares(self, task: ListedTask) -> str:
        """Return what names the beginning of a prompt: room with its things, kind of examples."""
        return f"{task.trial}/{kind_of(task.list)}" if self.player == "planner" else ""


class LotaRow(AlfredRow, frozen=True, kw_only=True):
    """One row of LoTa-Bench's table."""

    player: Literal["scored", "generated", "expert", "chance"] = "scored"
    scoring: Scoring = "sum"
    prompt: LotaPromptOptions = LotaPromptOptions()


class AlfredExperiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Every row on every task with every seed."""

    name: str
    benchmark: str
    tasks: str  # lists of tasks
    types: str  # EB-ALFRED's lists of types, in the order of its actions' numbers
    trials: str  # ALFRED's demonstrations of the lists
    rows: tuple[AlfredRow, ...]
    only: tuple[str, ...] = ()  # ids of tasks; () = all
    models: Models = Models()
    seeds: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        """Refuse what there is nothing to do for, or what would be done twice."""
        check_listed([row.name for row in self.rows], self.seeds, self.only)

    @property
    def plans(self) -> bool:
        """Whether a model is needed."""
        return any(row.player not in _SCRIPTED for row in self.rows)


class EbExperiment(AlfredExperiment, frozen=True, kw_only=True):
    """EB-ALFRED on its lists, `tasks`."""

    benchmark: Literal["eb_alfred"]
    rows: tuple[EbRow, ...]
    published: str = ""  # scores to print beside ours
    subsets: tuple[str, ...] = ()  # () = all

    def chosen(self, path: Path) -> tuple[ListedTask, ...]:
        """Return the tasks that are selected; `path` is of the experiment, for messages.

        FileError if the lists are damaged, or a task of `only` is not in them.
        """
        return select(read_tasks(Path(self.tasks), self.subsets), self.only, path)

    def remarks(self) -> list[str]:
        """Return what a reader of the table has to know about how its planners were asked."""
        planners = [row for row in self.rows if row.player == "planner"]
        found = [
            f"{row.name}: answers are held to the JSON that is asked for, with the room's actions, "
            f"{row.prompt.most_text} characters a text and {row.prompt.most_actions} actions at "
            "most."
            for row in planners
            if row.prompt.constrained
        ]
        if planners and self.models.n_ctx is not None:
            long = f"The planner's context of {self.models.n_ctx} tokens may be longer than what"
            found.insert(0, f"{long} it was trained for.")
        return found


class LotaExperiment(AlfredExperiment, frozen=True, kw_only=True):
    """LoTa-Bench on a draw of ALFRED's lists, `tasks`, such as its oct21.json."""

    benchmark: Literal["lota_alfred"]
    rows: tuple[LotaRow, ...]
    lists: tuple[str, ...] = ()  # () = all
    percent: Annotated[int, Meta(ge=1, le=100)] = 100  # of them, drawn
    draw_seed: int = 1  # the source's

    def chosen(self, path: Path) -> tuple[ListedTask, ...]:
        """Return the tasks that are drawn and selected; `path` is for messages.

        FileError if the lists are damaged, none is drawn, or a task of `only` is not drawn.
        """
        lists = Path(self.tasks)
        tasks = draw_tasks(lists, self.lists, percent=self.percent, seed=self.draw_seed)
        if not tasks:
            raise FileError(path, f"percent = {self.percent}: no task is drawn from {lists.name}")
        return select(tasks, self.only, path)


def read_tasks(path: Path, subsets: tuple[str, ...] = ()) -> tuple[ListedTask, ...]:
    """Read the tasks of a list of lists, in the order of `SUBSETS`.

    `path` is JSON, subset -> entries; no subsets: all. FileError as `read_lists`, or if a task
    has no instruction.
    """
    tasks = read_lists(path, subsets)
    if silent := [task.id for task in tasks if not task.instruction]:
        raise FileError(path, f"task {silent[0]} has no instruction")
    order = subsets or SUBSETS
    rank = {name: number for number, name in enumerate(order)}
    return tuple(sorted(tasks, key=lambda task: rank.get(task.list, len(rank))))


def draw_tasks(
    path: Path, lists: tuple[str, ...] = (), *, percent: int = 100, seed: int = 1
) -> tuple[ListedTask, ...]:
    """Return a draw of tasks, in the order in which they were drawn, but for those of two objects.

    The same list, percentage and seed give the source's draw.

    Of the lists (none: all) `percent`, rounded down to whole tasks. FileError as `read_lists`.
    """
    tasks = tuple(one for one in read_lists(path, lists) if _LEFT_OUT not in one.folder)
    if percent == 100:
        return tasks
    return tuple(random.Random(seed).sample(tasks, len(tasks) * percent // 100))
