"""Run AI2-THOR's own client, kept from what it does to a lab without a network.

`Client` is `ai2thor.controller.Controller` with a guard before the player and these differences: a
deadline for each wait, no look-up or download of builds (the executable is given), no pruning of
other releases, no look at CUDA_VISIBLE_DEVICES, a DISPLAY that is always text, and `WorldLost` for
a player that is gone.
Needs the package `ai2thor` 5.0.0; imported only when a world starts.
"""

import os
import select
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import ai2thor.platform
from ai2thor.controller import Controller
from ai2thor.fifo_server import FifoServer

from karma.errors import UnknownNameError, WorldLost, did_you_mean
from karma.world.thor import guard
from karma.world.thor.builds import Build

LOOK_S = 0.1
STALL_S = 0.8  # a message that stops half-way for longer is damage
CODE_S = 0.3
END_S = 2.0
LONGEST = 1 << 28  # bytes of one field; more is taken for damage
TAIL_BYTES = 600


class Pipes(FifoServer):  # type: ignore[misc]
    """AI2-THOR's end of the pipes: every wait has a deadline, and ends with the player.

    `failure` says why nothing more can be read or written; "" while all is well.
    """

    failure = ""
    client_pipe: Any
    server_pipe: Any
    _heard_s: float | None = None  # when the last part of a message came

    def start(self) -> None:
        """Make the pipes; opened at once, since the client's own open() waits for the player."""
        super().start()
        self.server_pipe = _opened(self.server_pipe_path, os.O_RDONLY, "rb")
        self.client_pipe = _opened(self.client_pipe_path, os.O_RDWR, "wb")

    def receive(self, timeout: float | None = None) -> Any:
        """Return the next event; whatever goes wrong here is the end of this player."""
        self._heard_s = None
        with self._noted():
            return super().receive(timeout)

    def stop(self) -> None:
        """End the player by its guard, which takes along what it has started."""
        if self.unity_proc is not None:
            self.unity_proc.terminate()
            with suppress(subprocess.TimeoutExpired):
                self.unity_proc.wait(timeout=END_S)
        super().stop()

    @contextmanager
    def _noted(self) -> Iterator[None]:
        try:
            yield
        except TimeoutError:
            self.failure = "no answer in time; it hangs, or the time limit is too short"
            raise
        except (OSError, KeyboardInterrupt) as error:
            self.failure = str(error) or type(error).__name__
            raise
        except BaseException as error:
            said = f"{type(error).__name__}: {error}"
            self.failure = f"the player sent what makes no sense: {said}"
            raise

    def _send_message(self, message_type: Any, body: bytes) -> None:
        data = memoryview(self._create_header(message_type, body) + body + self.eom_header)
        self._heard_s, until_s = None, time.monotonic() + self.timeout
        with self._noted():
            while data:
                self._await(self.client_pipe, until_s, writing=True)
                data = data[os.write(self.client_pipe.fileno(), data) :]

    def _read_with_timeout(
        self, server_pipe: Any, message_size: int, timeout: float | None
    ) -> bytes:
        """Return `message_size` bytes; errors as `_await`."""
        if message_size > LONGEST:
            raise ConnectionError(f"the player sent what is no message ({message_size} bytes)")
        until_s = time.monotonic() + (timeout or self.timeout)
        parts = []
        while message_size > 0:
            self._await(server_pipe, until_s)
            part = os.read(server_pipe.fileno(), message_size)
            if not part:
                raise ConnectionError(self.ended())
            self._heard_s = time.monotonic()
            parts.append(part)
            message_size -= len(part)
        return b"".join(parts)

    def _await(self, pipe: Any, until_s: float, *, writing: bool = False) -> None:
        """Wait until a pipe can be read, or written.

        Raises:
            TimeoutError: not in time.
            ConnectionError: the player is gone, or has stopped in the middle of a message.
        """
        reads, writes = ([], [pipe]) if writing else ([pipe], [])
        while not any(select.select(reads, writes, [], LOOK_S)):
            now_s = time.monotonic()
            if self.unity_proc is not None and self.unity_proc.poll() is not None:
                raise ConnectionError(self.ended())
            if self._heard_s is not None and now_s - self._heard_s > STALL_S:
                raise ConnectionError("the player stopped in the middle of a message")
            if now_s > until_s:
                raise TimeoutError

    def ended(self) -> str:
        """Return how the player has ended; of its exit code one hears a moment later."""
        with suppress(subprocess.TimeoutExpired):
            code = self.unity_proc.wait(timeout=CODE_S)
            number = -code if code < 0 else code - 128
            if number in set(signal.Signals):
                return f"the player was killed by {signal.Signals(number).name}"
            return f"the player ended with exit code {code}"
        return "the player closed its pipe"


def _opened(path: str, how: int, mode: str) -> Any:
    return os.fdopen(os.open(path, how | os.O_NONBLOCK), mode, buffering=0)


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
            with self._guarded("start"):
                super().__init__(
                    local_executable_path=shlex.join(words),
                    x_display=display,
                    scene=scene,
                    server_timeout=step_timeout_s,
                    server_start_timeout=start_timeout_s,
                    **settings,
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
        """Why the player is not alive; "" while it is, and before it was started."""
        server = getattr(self, "server", None)
        if server is None or server.unity_proc is None:
            return ""
        return server.failure or ("" if server.unity_proc.poll() is None else server.ended())

    @property
    def alive(self) -> bool:
        """Whether the player can still be talked to."""
        server = self.server
        return server is not None and server.unity_proc is not None and not self.reason

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
        with self._guarded(str(name)):
            return super().step(action, **arguments)

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
        with self._guarded("reset"):
            return super().reset(scene, **settings)

    def end(self) -> None:
        """Stop the player, whatever state it is in, and remove the pipes."""
        server = getattr(self, "server", None)
        if server is None:
            return
        with suppress(OSError, ValueError):
            server.stop()
            self.stop()
        server.tmp_dir.cleanup()

    def _check(self, scene: str) -> None:
        known = self.scenes_in_build
        if known and self.normalize_scene(scene) not in known:
            reason = f"{self._build_path}: no scene named {scene!r}.{did_you_mean(scene, known)}"
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

    @contextmanager
    def _guarded(self, during: str) -> Iterator[None]:
        """Turn the end of the player into WorldLost."""
        try:
            yield
        except WorldLost:
            raise
        except Exception as error:
            if not (reason := self.reason):
                raise
            log, tail = self.log_path, _tail(self.log_path, self._log_from)
            raise WorldLost(reason, during=during, log=log, tail=tail) from error


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _tail(path: Path, start: int) -> str:
    """Return the last lines that were written to a log since `start`, indented."""
    with suppress(OSError), path.open("rb") as file:
        file.seek(max(start, _size(path) - TAIL_BYTES))
        lines = file.read().decode(errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-6:])
    return ""
