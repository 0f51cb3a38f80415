"""What says who is at work, and how far a command is."""

from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Any

from karma.cli.shared import console, tell

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

    from karma.bench.run import Run

_LINE_S = 10.0  # between lines of a log


def bar(*, passing: bool = False) -> "Progress":
    """Return a bar with how many are done, of how many, since when, and the time left.

    Args:
        passing: it goes when all is done, and nothing is said where nobody watches.

    Where nobody watches it is a line now and then, for a log.
    """
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    shown = Progress if passing or console.is_terminal else _lines()
    return shown(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        _time_left(),
        console=console,
        transient=passing,
        disable=passing and not console.is_terminal,
    )


def _lines() -> "type[Progress]":
    """Return what says how far it is in lines, the last one when all is done."""
    from rich.progress import Progress, TaskID

    class Lines(Progress):
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

    return Lines


def _time_left() -> "ProgressColumn":
    """Return the column that says how long it will still take, while that is known and not over."""
    from rich.progress import ProgressColumn, Task, TimeRemainingColumn
    from rich.text import Text

    class Left(ProgressColumn):
        max_refresh = 0.5
        _clock = TimeRemainingColumn()

        def render(self, task: Task) -> Text:
            if task.finished or not task.time_remaining:
                return Text("")
            return Text("left ").append_text(self._clock.render(task))

    return Left()


def workers_for(run: "Run", workers: int, ray: str) -> int:
    """Say who does what is left of a run, and return how many workers to use.

    Args:
        run: it is silent about one that is done.
        workers: that were asked for; 0: as many as the machine, or the cluster, has room for.
        ray: address of a Ray cluster; "" = this machine.
    """
    if run.left and ray:
        many = workers or "as many workers as it has room for"
        tell(f"on the Ray cluster at {ray}: {many}")
    elif run.left and not workers:
        suggested = run.suggest()
        workers = suggested.number
        tell(f"workers: {workers} ({suggested.reason})")
    return workers
