"""The `karma` command."""

import typer

from karma.cli import agents, doctor, models, worlds

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="A household agent that remembers, offline."
)
agents.add_to(app)
app.add_typer(worlds.app, name="world")
app.add_typer(models.app, name="models")
app.add_typer(doctor.app, name="doctor")
