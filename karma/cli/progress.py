"""What says who is at work and how far a command is; loaded when a command has a bar to show."""

from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Any

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from karma.cli.shared import console, tell

if TYPE_CHECKING:
    from karma.bench.engine.run import Run

_LINE_S = 10.0  # between lines of a log


class _Lines(Progress):
    """Says how far it is in lines, the last one when all is done."""

    _told_s, _said = -inf, ""

    def start(self) -> None:
        pass

    def stop(self) -> None:
        for task in self.tasks:
            self._tell(task.id)

    def update(self, task_id: TaskID, **fields: Any) -> None:
        super().update(task_id, **fields)
        if monotonic() - self._told_s >= _LINE_S:
            self._tell(task_id)

    def _tell(self, task_id: TaskID) -> None:
        task = self._tasks[task_id]
        total = "" if task.total is None else f" of {task.total:g}"
        said = f"{task.completed:g}{total}: {task.description}"
        if said != self._said:
            self._said, self._told_s = said, monotonic()
            console.print(said, highlight=False, soft_wrap=True)


class _TimeLeft(ProgressColumn):
    """Says how long it will still take, while that is known and not over."""

    max_refresh = 0.5
    _clock = TimeRemainingColumn()

    def render(self, task: Task) -> Text:
        if task.finished or not task.time_remaining:
            return Text("")
        return Text("left ").append_text(self._clock.render(task))


def bar(*columns: ProgressColumn, passing: bool = False) -> Progress:
    """Return a bar with how many are done, of how many, since when, and the time left.

    Where nobody watches it is a line now and then, for a log. A passing one goes when all is done,
    and where nobody watches it says nothing. `columns` stand in place of the usual ones.
    """
    shown = Progress if passing or console.is_terminal else _Lines
    return shown(
        TextColumn("{task.description}"),
        BarColumn(),
        *(columns or (MofNCompleteColumn(), TimeElapsedColumn(), _TimeLeft())),
        console=console,
        transient=passing,
        disable=passing and not console.is_terminal,
    )


def workers_for(run: "Run", workers: int, ray: str) -> int:
    """Say who does what is left of a run, and return how many workers to use.

    0 workers are as many as there is room for on the machine, or on the Ray cluster.
    """
    if run.left and ray:
        many = workers or "as many workers as it has room for"
        tell(f"on the Ray cluster at {ray}: {many}")
    elif run.left and not workers:
        suggested = run.suggest()
        workers = suggested.number
        tell(f"workers: {workers} ({suggested.reason})")
    return workers
