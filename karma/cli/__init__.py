"""The `karma` command."""

import signal
import sys

import typer

from karma import __version__ as karma_version
from karma.cli.commands import LazyGroup
from karma.cli.parameters import option

app = typer.Typer(
    cls=LazyGroup,
    no_args_is_help=True,
    help="A household agent that remembers, offline.",
    epilog='Begin with: karma run "wash the tomato, then put it in the fridge"',
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"karma-offline {karma_version}")
        raise typer.Exit


@app.callback()
def karma(
    allow_network: bool = option(False, "Let a hosted model's host be reached.", "--allow-network"),
    _: bool = option(False, "Print the version.", "--version", is_eager=True, callback=_version),
) -> None:
    """Keep every command off the network."""
    from karma.cli.shared import clear_errors
    from karma.offline.guard import go_offline

    clear_errors(go_offline)(allow_network=allow_network)


def main() -> None:
    """Run the command line as a program that ends in order when it is terminated."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_DFL:  # nohup has it otherwise
            signal.signal(number, signal.default_int_handler)
    for stream in (sys.stdin, sys.stdout, sys.stderr):
        if stream is not None:  # closed by the shell
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]
    app(prog_name="karma")
