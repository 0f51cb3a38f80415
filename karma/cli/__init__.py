"""The `karma` command."""

from typing import Annotated

import typer

from karma.cli import agents, bundle, compare, doctor, models, report, sequences, trace, vlm, worlds
from karma.cli.shared import MACHINES, MATERIAL, PARTS, clear_errors
from karma.offline import go_offline

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="A household agent that remembers, offline.",
    epilog='Begin with: karma run "wash the tomato, then put it in the fridge"',
)
agents.add_to(app)
compare.add_to(app)
report.add_to(app)
app.add_typer(worlds.app, name="world", rich_help_panel=MATERIAL)
sequences.add_to(app)
app.add_typer(models.app, name="models", rich_help_panel=MATERIAL)
trace.add_to(app)
app.add_typer(vlm.app, name="vlm", rich_help_panel=PARTS)
app.add_typer(doctor.app, name="doctor", rich_help_panel=MACHINES)
app.add_typer(bundle.app, name="bundle", rich_help_panel=MACHINES)


@app.callback()
@clear_errors
def karma(
    allow_network: Annotated[
        bool, typer.Option("--allow-network", help="Let a hosted model's host be reached.")
    ] = False,
) -> None:
    """Keep every command off the network."""
    go_offline(allow_network=allow_network)
