"""What says who is at work, and how far a command is."""

from typing import TYPE_CHECKING

from rich.markup import escape

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


def tell_cluster(address: str, workers: int) -> None:
    """Say that a Ray cluster is at work, with how many workers; 0 as it has room for."""
    many = workers or "as many workers as it has room for"
    console.print(escape(f"on the Ray cluster at {address}: {many}"), soft_wrap=True)
