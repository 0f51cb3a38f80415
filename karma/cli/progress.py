"""What says who is at work, and how far a command is."""

from typing import TYPE_CHECKING

from rich.markup import escape

from karma.cli.shared import console

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn


def bar(*, passing: bool = False) -> "Progress":
    """Return a bar with how many are done, of how many, since when, and the time left.

    Args:
        passing: it goes when all is done, and nothing is said where nobody watches.
    """
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        _time_left(),
        console=console,
        transient=passing,
        disable=passing and not console.is_terminal,
    )


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


def tell_cluster(address: str, workers: int) -> None:
    """Say that a Ray cluster is at work, with how many workers; 0 as it has room for."""
    many = workers or "as many workers as it has room for"
    console.print(escape(f"on the Ray cluster at {address}: {many}"), soft_wrap=True)
