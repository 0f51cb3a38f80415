"""Run AI2-THOR's own client, kept from what it does to a lab without a network.

`Client` is `ai2thor.controller.Controller` with a guard before the player and these differences:
no look-up or download of builds (the executable is given), no pruning of other releases, no look at
CUDA_VISIBLE_DEVICES, a DISPLAY that is always text, and `WorldLost` for a player that is gone.
Needs the package `ai2thor` 5.0.0; imported only when a world starts.
"""

import os
import select
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import ai2thor.platform
from ai2thor.controller import Controller
from ai2thor.fifo_server import FifoServer

from karma.errors import UnknownNameError, WorldLost
from karma.world.thor import guard
from karma.world.thor.builds import Build

T = TypeVar("T")
LOOK_S = 0.1
END_S = 2.0
TAIL_BYTES = 600


class Pipes(FifoServer):  # type: ignore[misc]
    """AI2-THOR's end of the pipes, which also notices that the launched process is gone.

    `failure` says why nothing more can be read or written; "" while all is well.
    """

    failure = ""
    client_pipe: Any
    server_pipe: Any

    def start(self) -> None:
        """Make the pipes; opened at once, since the client's own open() waits for a writer."""
        super().start()
        pipe = os.open(self.server_pipe_path, os.O_RDONLY | os.O_NONBLOCK)
        self.server_pipe = os.fdopen(pipe, "rb", buffering=0)

    def receive(self, timeout: float | None = None) -> Any:
        """Return the next event; whatever goes wrong here is the end of this player."""
        try:
            return super().receive(timeout)
        except BaseException as error:
            self.failure = self._why(error)
            raise

    def _why(self, error: BaseException) -> str:
        data = self.raw_metadata
        if isinstance(data, dict) and data.get("sequenceId") == -1:
            return f"the player {data.get('guard', 'died')}"
        if isinstance(error, TimeoutError):
            return "no answer in time; it hangs, or the time limit is too short"
        if isinstance(error, OSError | KeyboardInterrupt):
            return str(error) or type(error).__name__
        return f"the player sent what makes no sense: {type(error).__name__}: {error}"

    def _send_message(self, message_type: Any, body: bytes) -> None:
        try:
            if self.client_pipe is None:  # the client's own open() waits for a reader
                pipe = os.open(self.client_pipe_path, os.O_WRONLY | os.O_NONBLOCK)
                os.set_blocking(pipe, True)
                self.client_pipe = os.fdopen(pipe, "wb")
            super()._send_message(message_type, body)
        except BaseException as error:
            self.failure = f"nothing can be sent to it: {error}"
            raise

    def _read_with_timeout(
        self, server_pipe: Any, message_size: int, timeout: float | None
    ) -> bytes:
        """Return `message_size` bytes.

        Raises:
            TimeoutError: they did not come in time.
            ConnectionError: the launched process is gone.
        """
        limit_s = time.monotonic() + (timeout or self.timeout)
        parts = []
        while message_size > 0:
            if select.select([server_pipe], [], [], LOOK_S)[0]:
                part = os.read(server_pipe.fileno(), message_size)
                if not part:
                    raise ConnectionError("the launched process closed its pipe")
                parts.append(part)
                message_size -= len(part)
            elif self.unity_proc is not None and self.unity_proc.poll() is not None:
                raise ConnectionError(f"the launched process ended ({self.unity_proc.returncode})")
            elif time.monotonic() > limit_s:
                raise TimeoutError
        return b"".join(parts)


class Client(Controller):  # type: ignore[misc]
    """One running player.

    Args:
        build: what to launch.
        folder: for the client's log; ~/.ai2thor as a rule.
        display: X display, any text.
        scene: name of the first scene; None = the client's choice.
        start_timeout_s: until the first frame.
        step_timeout_s: for each answer.
        settings: further arguments of AI2-THOR's Controller, and of Initialize.

    Raises:
        WorldLost: the player could not be started; nothing is left running.
        ValueError: the scene or an argument of Initialize is refused.
    """

    server: Pipes | None

    def __init__(
        self,
        build: Build,
        *,
        folder: Path,
        display: str,
        scene: str | None,
        start_timeout_s: float,
        step_timeout_s: float,
        **settings: Any,
    ) -> None:
        self._folder, self._build_path = folder, build.path
        self._plays_on = getattr(ai2thor.platform, build.platform)
        self._log_from = _size(self.log_path)
        words = (sys.executable, "-I", "-S", guard.__file__, *build.command)
        try:
            self._guarded(
                "start",
                lambda: super(Client, self).__init__(
                    local_executable_path=shlex.join(words),
                    x_display=display,
                    scene=scene,
                    server_timeout=step_timeout_s,
                    server_start_timeout=start_timeout_s,
                    **settings,
                ),
            )
        except BaseException:
            self.end()
            raise

    @property
    def base_dir(self) -> str:
        """The client's own folder."""
        return str(self._folder)

    @property
    def log_path(self) -> Path:
        """What the player prints."""
        return Path(self.log_dir) / "unity.log"

    @property
    def reason(self) -> str:
        """Why the player is not alive."""
        return (self.server and self.server.failure) or "the launched process ended"

    @property
    def alive(self) -> bool:
        """Whether the player can still be talked to."""
        server = self.server
        return (
            server is not None
            and not server.failure
            and server.unity_proc is not None
            and server.unity_proc.poll() is None
        )

    def prune_releases(self) -> None:
        """Delete nothing: what lies beside the build is the user's."""

    def step(self, action: Any = None, **arguments: Any) -> Any:
        """Do one action as AI2-THOR's client does.

        Raises:
            WorldLost: the player is gone.
            ValueError: the action or an argument is refused.
            RuntimeError: `raise_for_failure` was asked for, and the action failed.
        """
        name = action.get("action") if isinstance(action, dict) else action
        return self._guarded(str(name), lambda: super(Client, self).step(action, **arguments))

    def reset(self, scene: Any = None, **settings: Any) -> Any:
        """Load a scene in the running player.

        Raises:
            UnknownNameError: the build has no such scene.
            WorldLost: the player is gone.
            ValueError: an argument of Initialize is refused.
            RuntimeError: Initialize fails.
        """
        if isinstance(scene, str):
            self._check(scene)
        return self._guarded("reset", lambda: super(Client, self).reset(scene, **settings))

    def end(self) -> None:
        """Stop the player, whatever state it is in, and remove the pipes."""
        server = getattr(self, "server", None)
        if server is None:
            return
        with suppress(OSError, ValueError):
            if server.client_pipe is not None:
                server.client_pipe.close()  # the guard ends its player and then itself
                _wait(server.unity_proc)
        with suppress(OSError, ValueError):
            self.stop()
        _wait(server.unity_proc)
        server.tmp_dir.cleanup()

    def _check(self, scene: str) -> None:
        known = self.scenes_in_build
        if known and self.normalize_scene(scene) not in known:
            near = get_close_matches(scene, sorted(known), n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            reason = f"{self._build_path}: no scene named {scene!r}.{hint}"
            raise UnknownNameError(
                f"{reason} It has {len(known)} scenes, `world.scenes` lists them"
            )

    # ------------------------------------------------------------- the client's own steps

    def _build_server(self, host: str, port: int, width: int, height: int) -> None:
        if self.server is None:
            self.server = Pipes(
                width,
                height,
                timeout=self.server_timeout,
                depth_format=self.depth_format,
                add_depth_noise=self.add_depth_noise,
            )

    def start(self, *arguments: Any, **named: Any) -> Any:
        """Start the player; a given executable would always count as one that needs X."""
        self._build.platform = self._plays_on
        return super().start(*arguments, **named)

    def _start_unity_thread(self, env: dict[str, str], *arguments: Any) -> None:
        env.pop("CUDA_VISIBLE_DEVICES", None)
        self.gpu_device = None  # else `vulkaninfo` and `nvidia-smi` are called
        super()._start_unity_thread(env, *arguments)

    def _guarded(self, during: str, call: Callable[[], T]) -> T:
        """Call, and turn the end of the player into WorldLost."""
        try:
            return call()
        except WorldLost:
            raise
        except Exception as error:
            server = getattr(self, "server", None)
            if server is None or not server.failure:
                raise
            log, tail = self.log_path, _tail(self.log_path, self._log_from)
            raise WorldLost(server.failure, during=during, log=log, tail=tail) from error


def _wait(process: "subprocess.Popen[bytes] | None") -> None:
    if process is not None:
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=END_S)


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _tail(path: Path, start: int) -> str:
    """Return the last lines that were written to a log since `start`, indented."""
    with suppress(OSError), path.open("rb") as file:
        file.seek(max(start, _size(path) - TAIL_BYTES))
        lines = file.read().decode(errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-6:])
    return ""
