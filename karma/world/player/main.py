"""Run `karma-player`, which AI2-THOR's Controller starts as its `local_executable_path`.

Standard error is the log; the client appends it to ~/.ai2thor/log/unity.log.
"""

import argparse
import logging
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, BinaryIO, NoReturn

from karma.errors import KarmaError
from karma.offline import go_offline
from karma.world.player.fifo import farewell
from karma.world.player.pipes import ClientGoneError, await_client, open_sink, open_source

if TYPE_CHECKING:
    from karma.world.player.player import Player

log = logging.getLogger("karma-player")


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
    """Be `main` in a child process, see `karma.children`."""
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
        "karma.world.player.command()).",
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
            "  To fix: Controller(local_executable_path=karma.world.player.command())"
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
    from karma.world.player.player import Player
    from karma.world.player.scenes import catalogue, folders

    scenes = catalogue(folders(options.scenes, os.environ))
    return Player(
        scenes,
        width=options.screen_width,
        height=options.screen_height,
        images=os.environ.get("AI2THOR_SERVER_SIDE_SCREENSHOT", "True") != "False",
    )
