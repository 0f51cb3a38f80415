"""The `karma` command."""

from typing import Annotated

import typer

from karma.cli import agents, bundle, compare, doctor, models, report, sequences, trace, vlm, worlds
from karma.cli.shared import clear_errors
from karma.offline import go_offline

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="A household agent that remembers, offline."
)
agents.add_to(app)
compare.add_to(app)
sequences.add_to(app)
trace.add_to(app)
report.add_to(app)
app.add_typer(worlds.app, name="world")
app.add_typer(models.app, name="models")
app.add_typer(vlm.app, name="vlm")
app.add_typer(bundle.app, name="bundle")
app.add_typer(doctor.app, name="doctor")


@app.callback()
@clear_errors
def karma(
    allow_network: Annotated[
        bool, typer.Option("--allow-network", help="Let a hosted model's host be reached.")
    ] = False,
) -> None:
    """Keep every command off the network."""
    go_offline(allow_network=allow_network)
