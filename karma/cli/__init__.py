"""The `karma` command."""

import typer

from karma.cli import agents, models, worlds

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="A household agent that remembers, offline."
)
agents.add_to(app)
app.add_typer(worlds.app, name="world")
app.add_typer(models.app, name="models")
