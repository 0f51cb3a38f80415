"""The line that says how far a command is."""

from typing import TYPE_CHECKING

from karma.cli.shared import console

if TYPE_CHECKING:
    from rich.progress import Progress


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
        TimeRemainingColumn,
    )

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        transient=passing,
        disable=passing and not console.is_terminal,
    )
