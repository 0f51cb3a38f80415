"""Options and arguments of commands: the default of a field, with its help."""

from typing import Any

import typer


def option(usual: Any, text: str, *names: str, panel: str | None = None, **how: Any) -> Any:
    """Return the default of a field that is an option; `usual` ...: it must be given.

    `names` stand in place of the field's own, `how` is more of `typer.Option`.
    """
    return typer.Option(usual, *names, help=text, rich_help_panel=panel, **how)


def argument(usual: Any, text: str, **how: Any) -> Any:
    """Return the default of what stands without a name; as in `option`."""
    return typer.Argument(usual, help=text, **how)
