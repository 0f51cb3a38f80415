"""The `karma` command."""

import io
import os
import signal
import sys
from typing import Any

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


def version() -> None:
    """Print the version."""
    typer.echo(f"karma-offline {karma_version}")


def _version(asked: bool) -> None:
    if asked:
        version()
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
