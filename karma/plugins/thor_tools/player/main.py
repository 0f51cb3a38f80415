"""Run `karma-player`, which AI2-THOR's Controller starts as its `local_executable_path`.

Standard error is the log; the client appends it to ~/.ai2thor/log/unity.log.
"""

import argparse
import errno
import fcntl
import logging
import os
import select
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NoReturn

from karma.errors import KarmaError
from karma.offline.guard import go_offline
from karma.plugins.thor_tools.player.fifo import farewell

if TYPE_CHECKING:
    from karma.plugins.thor_tools.player.player import Player

log = logging.getLogger("karma-player")

_PAUSE_S = 0.002
_PATIENCE_S = 60.0  # the client opens its end as soon as it has started us
_PIPE_BYTES = 1 << 20  # room for a message with pictures; Linux allows this much to everybody


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve one client; 0 when it is done, 1 when something was wrong, 2 for wrong usage."""
    parent = os.getppid()  # asked early: it changes when the client dies
    go_offline()
    logging.basicConfig(level=logging.WARNING, format="karma-player: %(levelname)s: %(message)s")
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        server_pipe, client_pipe = _pipes(os.environ, arguments)
        with open_sink(server_pipe, parent) as sink:
            return _talk(arguments, client_pipe, sink)
    except KarmaError as error:
        log.error("%s", error)
        return 2
    except BrokenPipeError:  # the client is gone, and so is its need of us
        return 0
    except OSError as error:
        log.error("%s", error)
        return 1


def serve(*arguments: str) -> int:
    """Be `main` in a child process, see `karma.offline.children`."""
    return main(arguments)


class _Parser(argparse.ArgumentParser):
    """Raises what is wrong, so that the client can be told."""

    def error(self, message: str) -> NoReturn:
        raise KarmaError(f"{message}\n{self.format_usage().rstrip()}")


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = _Parser(
        prog="karma-player",
        description="The embedded world behind AI2-THOR's process protocol. Unity's options are "
        "taken; all but the size are without effect.",
        epilog="Start it by ai2thor.controller.Controller(local_executable_path="
        "karma.plugins.thor_tools.player.command()).",
        allow_abbrev=False,
        add_help=False,  # -h... may be the start of an option of Unity's
    )
    parser.add_argument("--help", action="help", help="say this")
    parser.add_argument(
        "--scenes",
        action="append",
        default=[],
        metavar="DIR",
        help="serve the scene files in this folder too; default $KARMA_SCENES; may be repeated",
    )
    parser.add_argument("-screen-width", type=int, default=300, metavar="PIXELS")
    parser.add_argument("-screen-height", type=int, default=300, metavar="PIXELS")
    options, others = parser.parse_known_args(arguments)
    if ours := [word for word in others if word.startswith("--")]:
        parser.error(f"unknown option {ours[0]}")
    return options


def _pipes(environment: Mapping[str, str], arguments: Sequence[str]) -> tuple[str, str]:
    """Return the paths of the server pipe, which we write, and of the client pipe.

    Raises:
        KarmaError: no client has started this program; says what is wrong with the arguments first.
    """
    kind = environment.get("AI2THOR_SERVER_TYPE", "FIFO")
    if kind != "FIFO":
        raise KarmaError(f"this player speaks FIFO, not {kind}\n  To fix: leave server_class out")
    try:
        return environment["AI2THOR_FIFO_SERVER_PIPE_PATH"], environment[
            "AI2THOR_FIFO_CLIENT_PIPE_PATH"
        ]
    except KeyError as missing:
        _options(arguments)
        raise KarmaError(
            f"the environment has no {missing}: AI2-THOR's Controller starts this program\n"
            "  To fix: Controller(local_executable_path=karma.plugins.thor_tools.player.command())"
        ) from None


def _talk(arguments: Sequence[str], client_pipe: str, sink: BinaryIO) -> int:
    """Serve the client; what ends the player before its time is told to it."""
    try:
        with open_source(client_pipe) as source:
            player = _player(_options(arguments))
            sink.write(player.hello())
            sink.flush()
            await_client(source, sink)
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is meant for the client
            player.serve(source, sink)
    except ClientGoneError:
        return 0
    except BrokenPipeError:
        raise
    except Exception as error:  # without a word from us the client would wait for ever
        log.error("%s", error, exc_info=not isinstance(error, KarmaError))
        sink.write(farewell(f"karma-player: {error}"))
        sink.flush()
        return 1
    return 0


def _player(options: argparse.Namespace) -> "Player":
    """Return the player; imported here, where a failing import can be told to the client."""
    from karma.plugins.thor_tools.player.player import Player, catalogue, folders

    scenes = catalogue(folders(options.scenes, os.environ))
    return Player(
        scenes,
        width=options.screen_width,
        height=options.screen_height,
        images=os.environ.get("AI2THOR_SERVER_SIDE_SCREENSHOT", "True") != "False",
    )


# ----------------------------------------------------------------- the pipes
#
# The client makes both, starts the player, and reads before it writes. A plain `open` would wait
# for ever if the client died in between, and leave the player behind as an orphan.


class ClientGoneError(KarmaError):
    """The client ended before it had opened both pipes."""


def open_sink(path: str | Path, parent: int) -> BinaryIO:
    """Open the pipe that the client reads, as soon as it does; `parent` is the client's process.

    Raises:
        ClientGoneError: the parent ended first, or the client does not come.
        OSError: there is no such pipe.
    """
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        try:
            handle = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
            break
        except OSError as error:
            if error.errno != errno.ENXIO:  # no reader yet
                raise
        if os.getppid() != parent or time.monotonic() > deadline:
            raise ClientGoneError("nobody reads the server pipe: the client is gone")
        time.sleep(_PAUSE_S)
    os.set_blocking(handle, True)
    with suppress(OSError, AttributeError):  # only makes it faster; Linux alone has it
        fcntl.fcntl(handle, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    return os.fdopen(handle, "wb")


def open_source(path: str | Path) -> BinaryIO:
    """Open the pipe that the client writes; `await_client` before the first read.

    Raises:
        OSError: there is no such pipe.
    """
    return os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb")


def await_client(source: BinaryIO, sink: BinaryIO) -> None:
    """Wait until the client has written, or has closed what it opened.

    Raises:
        ClientGoneError: it closed the pipe it reads before it opened the one it writes.
    """
    poll = select.poll()
    poll.register(source.fileno(), select.POLLIN)
    poll.register(sink.fileno(), 0)  # errors only
    ready = dict(poll.poll())
    if source.fileno() not in ready:
        raise ClientGoneError("the client ended before it opened the client pipe")
    os.set_blocking(source.fileno(), True)
