"""Run AI2-THOR's own client in a child process, where it can hang and be killed.

The child and the player that it starts are a session of their own, which ends as one: with the
player, with the parent, or when the parent says so. Needs the package `ai2thor` 5.0.0.
"""

import os
import shlex
import signal
import subprocess
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import ai2thor.platform
from ai2thor.controller import Controller
from ai2thor.fifo_server import FifoServer

from karma.errors import UnknownNameError, did_you_mean

LOOK_S = 0.1
CODE_S = 0.3  # an exit code is heard of a moment after the pipe has ended
LONGEST = 1 << 28  # bytes of one field; more is taken for damage

Lost = Callable[[str], None]  # takes why the player is lost


def serve(handle: str, folder: str) -> None:
    """Be the child: answer calls over a connection until the parent hangs up.

    A call is a method of `Client`, its arguments and its named ones; the first is "start" with
    those of the class. An answer is the value, the client's last event, and the error: an exception
    of the call's, or the text of why there is no player any more, after which there is no child.

    Args:
        handle: of the connection.
        folder: takes the pipes.
    """
    tempfile.tempdir = folder
    connection, sending = Connection(int(handle)), threading.Lock()

    def lost(reason: str) -> None:
        with suppress(OSError), sending:
            connection.send((None, None, reason))
            connection.close()
        os.killpg(0, signal.SIGKILL)

    client: Client | None = None
    try:
        while True:
            name, given, named = connection.recv()
            value, error = None, None
            try:
                if client is None:
                    client = Client(lost, **named)
                else:
                    value = getattr(client, name)(*given, **named)
            except Exception as wrong:  # noqa: BLE001  (for the parent to raise)
                error = wrong
            with sending:
                connection.send((value, client and client.last_event, error))
    except EOFError:  # the parent is done
        pass
    finally:
        os.killpg(0, signal.SIGKILL)


class Pipes(FifoServer):  # type: ignore[misc]
    """AI2-THOR's end of the pipes, without time limits: the parent has one for each call."""

    def __init__(self, lost: Lost, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._lost = lost

    def send(self, action: dict[str, Any]) -> None:
        """Send an action; that nobody reads it is the end of this player."""
        try:
            super().send(action)
        except OSError:
            self._lost(self._ended())

    def receive(self, timeout: float | None = None) -> Any:
        """Return the next event; whatever goes wrong here is the end of this player."""
        try:
            return super().receive(timeout)
        except ConnectionError as error:
            self._lost(str(error))
        except Exception as error:  # noqa: BLE001  (the player may have sent anything)
            sent = f"{type(error).__name__}: {error}"
            self._lost(f"the player sent what makes no sense: {sent}")

    def _read_with_timeout(self, server_pipe: Any, message_size: int, timeout: object) -> bytes:
        if message_size > LONGEST:
            raise ConnectionError(f"the player sent what is no message ({message_size} bytes)")
        data: bytes = server_pipe.read(message_size)
        if len(data) < message_size:
            raise ConnectionError(self._ended())
        return data

    def _ended(self) -> str:
        return ended(self.unity_proc, CODE_S) or "the player closed its pipe"


def ended(player: "subprocess.Popen[bytes]", wait_s: float) -> str:
    """Return how the player has ended; "" if it goes on."""
    try:
        code = player.wait(wait_s)
    except subprocess.TimeoutExpired:
        return ""
    number = -code if code < 0 else code - 128
    if number in set(signal.Signals):
        return f"the player was killed by {signal.Signals(number).name}"
    return f"the player ended with exit code {code}"


class Client(Controller):  # type: ignore[misc]
    """AI2-THOR's client, kept from what it does to a lab without a network.

    The build is given, so that none is looked up or fetched; other releases are left alone.

    Args:
        lost: called when the player is gone or makes no sense.
        command: of the build.
        platform: what it renders with; a given executable would count as one for X.
        folder: the client's own.
        settings: further arguments of AI2-THOR's Controller, and of Initialize.

    Raises:
        ValueError: the scene or an argument of Initialize is refused.
    """

    def __init__(
        self, lost: Lost, *, command: tuple[str, ...], platform: str, folder: Path, **settings: Any
    ) -> None:
        self._lost, self._folder, self._build_path = lost, folder, command[0]
        self._plays_on = getattr(ai2thor.platform, platform)
        executable = shlex.join(command)
        super().__init__(local_executable_path=executable, server_timeout=None, **settings)

    @property
    def base_dir(self) -> str:
        """The client's own folder."""
        return str(self._folder)

    def prune_releases(self) -> None:
        """Delete nothing: what lies beside the build is the user's."""

    def scenes(self) -> list[str]:
        """Return the names of the build's scenes, sorted."""
        return sorted(self.scenes_in_build)

    def reset(self, scene: Any = None, **settings: Any) -> Any:
        """Load a scene.

        Raises:
            UnknownNameError: the build has no such scene.
            ValueError: an argument of Initialize is refused.
            RuntimeError: Initialize fails.
        """
        known = self.scenes_in_build
        if isinstance(scene, str) and known and self.normalize_scene(scene) not in known:
            reason = f"{self._build_path}: no scene named {scene!r}.{did_you_mean(scene, known)}"
            raise UnknownNameError(
                f"{reason} It has {len(known)} scenes, `world.scenes` lists them"
            )
        return super().reset(scene, **settings)

    # ------------------------------------------------------------- the client's own steps

    def _build_server(self, host: str, port: int, width: int, height: int) -> None:
        self.server = Pipes(
            self._lost, width, height, timeout=None,
            depth_format=self.depth_format, add_depth_noise=self.add_depth_noise,
        )  # fmt: skip

    def start(self, *arguments: Any, **named: Any) -> Any:
        """Start the player."""
        self._build.platform, self.server_start_timeout = self._plays_on, None
        return super().start(*arguments, **named)

    def _start_unity_thread(self, *arguments: Any) -> None:
        try:
            super()._start_unity_thread(*arguments)
        except Exception as error:  # noqa: BLE001  (the client raises bare ones here)
            self._lost(f"the player cannot be started: {error}")
        threading.Thread(target=self._watch, args=(os.getppid(),), daemon=True).start()

    def _watch(self, parent: int) -> None:
        """Wait for the end of the player, or of the parent."""
        reason = ""
        while os.getppid() == parent and not reason:
            reason = ended(self.server.unity_proc, LOOK_S)
        self._lost(reason or "the parent is gone")
