"""The `karma` command."""

import io
import os
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import typer

from karma import __version__ as karma_version
from karma.cli import (
    agents,
    compare,
    doctor,
    models,
    report,
    talking,
    worlds,
)
from karma.cli.shared import Command, as_function, clear_errors, option
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

Commands = Mapping[str, Callable[..., None] | type[Command]]  # by their names
TOP: Mapping[str, Commands] = {  # of `karma` itself, by panel
    ACTING: {"run": talking.RunCommand, "chat": talking.ChatCommand, "read": talking.read,
             "eval": agents.EvalCommand},
    SHOWN: {"table": compare.table, "compare": compare.compare, "report": report.ReportCommand,
            "export": agents.export},
}  # fmt: skip
GROUPS: Sequence[tuple[str, str, str, Commands]] = (  # panel, name, what it is for
    (ACTING, "home", "Homes that last between sessions.",
     {"list": talking.home_list, "new": talking.home_new, "show": talking.home_show,
      "forget": talking.home_forget}),
    (MATERIAL, "world", "Rooms: list, draw, import from AI2-THOR or ALFRED; replay recordings.",
     {"list": worlds.world_list, "show": worlds.world_show, "import": worlds.world_import,
      "floors": worlds.world_floors, "replay": worlds.world_replay}),
    (MATERIAL, "tasks", "Task files: look for tasks that measure nothing.",
     {"check": worlds.tasks_check}),
    (MATERIAL, "models", "Models: list, show, verify, bring, add your own, remove.",
     {"list": models.models_list, "show": models.models_show, "verify": models.models_verify,
      "add": models.models_add, "bring": models.models_bring, "tune": models.models_tune,
      "remove": models.models_remove}),
    (PARTS, "vlm", "Score models that read states (open, dirty ...) out of pictures.",
     {"eval": models.vlm_eval}),
    (MACHINES, "doctor", "", {"offline": doctor.doctor_offline, "models": doctor.ModelsCommand,
                              "thor": doctor.doctor_thor}),
    (MACHINES, "bundle", "All in one archive, for a machine without a network.",
     {"build": doctor.BuildCommand, "verify": doctor.bundle_verify,
      "install": doctor.bundle_install}),
)  # fmt: skip


def _add_all() -> None:
    """Give `karma` its commands."""
    for panel, commands in TOP.items():
        _add(app, commands, rich_help_panel=panel)
    alone = typer.Typer(callback=clear_errors(doctor.doctor), invoke_without_command=True)
    for panel, name, words, commands in GROUPS:
        group = typer.Typer(help=words, no_args_is_help=True) if words else alone
        _add(group, commands)
        app.add_typer(group, name=name, rich_help_panel=panel)


def _add(to: typer.Typer, commands: Commands, **how: Any) -> None:
    for name, one in commands.items():
        function = as_function(one) if isinstance(one, type) else one
        to.command(name, **how)(clear_errors(function))


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"karma-offline {karma_version}")
        raise typer.Exit


@app.callback()
@clear_errors
def karma(
    allow_network: bool = option(False, "Let a hosted model's host be reached.", "--allow-network"),
    version: bool = option(
        False, "Say which this is.", "--version", is_eager=True, callback=_version
    ),
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
