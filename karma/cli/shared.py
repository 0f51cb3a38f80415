"""What all commands share: the console, options, and how errors are shown."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from karma.errors import KarmaError
from karma.offline import settle

console = Console()

ACTING = "The agent at work"  # panels of `karma --help`
SHOWN = "What runs show"
MATERIAL = "What runs are made of"
PARTS = "Parts by themselves"
MACHINES = "This machine, and one without a network"

Json = Annotated[Path | None, typer.Option("--json", help="Also write the figures here.")]


def clear_errors(command: Callable[..., None]) -> Callable[..., None]:
    """Turn the package's errors into a message and exit code 1; anything else is a bug.

    A refused attempt to reach the network is such an error also where a library has swallowed it.
    """

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        try:
            try:
                command(*args, **kwargs)
            finally:
                settle()
        except KarmaError as error:
            text = f"[red]error:[/] {escape(str(error))}"
            Console(stderr=True).print(text, highlight=False, soft_wrap=True)
            raise typer.Exit(1) from error

    return wrapped
