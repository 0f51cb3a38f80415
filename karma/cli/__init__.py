"""The `karma` command."""

import io
import os
import signal
import sys
from typing import Annotated, Any

import typer

from karma import __version__ as karma_version
from karma.cli import (
    agents,
    bundle,
    compare,
    doctor,
    models,
    report,
    sweeps,
    talking,
    tasks,
    vlm,
    worlds,
)
from karma.cli.shared import clear_errors
from karma.offline.guard import go_offline

app = typer.Typer(
    no_args_is_help=True,
    help="A household agent that remembers, offline.",
    epilog='Begin with: karma run "wash the tomato, then put it in the fridge"',
    context_settings={"help_option_names": ["-h", "--help"]},
)
ACTING = "The agent at work"  # panels of `karma --help`
SHOWN = "What runs show"
MATERIAL = "What runs are made of"
PARTS = "Parts by themselves"
MACHINES = "This machine, and one without a network"

TOP = {  # of `karma` itself, by panel; NAME_command is `karma NAME`
    ACTING: (talking.read_command, agents.eval_command),
    SHOWN: (
        compare.table_command, compare.compare_command, report.report_command,
        sweeps.export_command,
    ),
}  # fmt: skip
GROUPS = (  # panel, what it is for, commands: GROUP_NAME is `karma GROUP NAME`
    (ACTING, "Homes that last between sessions.",
     (talking.home_list, talking.home_new, talking.home_show, talking.home_forget)),
    (MATERIAL, "Rooms: list, draw, import from AI2-THOR or ALFRED; replay recordings.",
     (worlds.world_list, worlds.world_show, worlds.world_import, worlds.world_floors,
      worlds.world_replay)),
    (MATERIAL, "Task files: look for tasks that measure nothing.", (tasks.tasks_check,)),
    (MATERIAL, "Models: list, show, verify, bring, add your own, remove.",
     (models.models_list, models.models_show, models.models_verify, models.models_add,
      models.models_bring, models.models_tune, models.models_remove)),
    (PARTS, "Score models that read states (open, dirty ...) out of pictures.", (vlm.vlm_eval,)),
    (MACHINES, "", (doctor.doctor_offline, doctor.doctor_models, doctor.doctor_thor)),
    (MACHINES, "All in one archive, for a machine without a network.",
     (bundle.bundle_build, bundle.bundle_verify, bundle.bundle_install)),
)  # fmt: skip


def _add_all() -> None:
    """Give `karma` its commands."""
    run = clear_errors(talking.run_command)
    app.command("run", rich_help_panel=ACTING)(run)
    app.command("chat", rich_help_panel=ACTING, cls=talking.Chat, help=talking.CHAT)(run)
    for panel, commands in TOP.items():
        for one in commands:
            name = one.__name__.removesuffix("_command")
            app.command(name, rich_help_panel=panel)(clear_errors(one))
    for panel, words, commands in GROUPS:
        name = commands[0].__name__.partition("_")[0]
        if words:
            group = typer.Typer(help=words, no_args_is_help=True)
        else:
            group = typer.Typer(callback=clear_errors(doctor.doctor), invoke_without_command=True)
        for one in commands:
            group.command(one.__name__.partition("_")[2])(clear_errors(one))
        app.add_typer(group, name=name, rich_help_panel=panel)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"karma-offline {karma_version}")
        raise typer.Exit


@app.callback()
@clear_errors
def karma(
    allow_network: Annotated[
        bool, typer.Option("--allow-network", help="Let a hosted model's host be reached.")
    ] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Say which this is.", is_eager=True, callback=_version)
    ] = False,
) -> None:
    """Keep every command off the network."""
    go_offline(allow_network=allow_network)


@app.command("version", hidden=True)
def version() -> None:
    """Say which this is."""
    _version(asked=True)


_add_all()


def main() -> None:
    """Run the command line as a program: as one that can be stopped, and whose reader may go."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_DFL:  # nohup has it otherwise
            signal.signal(number, _stop)
    if os.environ.get("COLUMNS") == "0":  # not known; libraries take it at its word
        del os.environ["COLUMNS"]
    _open_standard_files()
    sys.stdout, sys.stderr = _Unheard.of(sys.stdout), _Unheard.of(sys.stderr)
    sys.argv[1:] = map(_text_of, sys.argv[1:])
    app(prog_name="karma")


def _open_standard_files() -> None:
    """Have something to read and to write where a shell has closed it, as `<&-` does."""
    for name, how in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), how, encoding="utf-8"))


def _text_of(word: str) -> str:
    """Return a word of the command line, in UTF-8 whatever the locale."""
    try:
        return word.encode("utf-8", "surrogateescape").decode()
    except UnicodeDecodeError:
        print(f"error: {word!a} is no text in UTF-8", file=sys.stderr)
        sys.exit(2)


def _stop(*_: object) -> None:
    raise KeyboardInterrupt


class _Unheard(io.TextIOWrapper):
    """A stream that goes on where nobody reads it any more, as after `| head -1`."""

    @classmethod
    def of(cls, stream: Any) -> Any:
        how = {"encoding": stream.encoding, "errors": stream.errors}
        return cls(stream.detach(), line_buffering=stream.line_buffering, **how)

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except BrokenPipeError:
            self._forget()
            return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except BrokenPipeError:
            self._forget()

    def _forget(self) -> None:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())
        os.close(nowhere)
