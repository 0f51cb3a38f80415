"""Drive the real AI2-THOR 5.0.0 as a world.

A Unity build and the package `ai2thor` are the user's to bring (docs/world/thor.md). AI2-THOR's own
client and the player run in a child process (client.py) with a time limit for each call: a
player that dies, hangs or sends nonsense is a `WorldLost`, and the next `reset` starts another.
Nothing here opens a connection beyond this machine.
"""

import copy
import logging
import os
import signal
import subprocess
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from typing import Any

from karma.errors import FileError, KarmaError, WorldLost
from karma.household.ids import root_type
from karma.offline.children import child_command
from karma.world.thor import builds
from karma.world.thor.builds import Platform

log = logging.getLogger(__name__)

OURS = frozenset(  # arguments of the Controller that would look for a build, or that are set here
    {"local_executable_path", "local_build", "commit_id", "branch", "download_only", "start_unity",
     "include_private_scenes", "server_class", "gpu_device", "x_display", "server_timeout",
     "server_start_timeout", "host", "port", "agentControllerType"}
)  # fmt: skip
BLINDS = "Blinds are never moved: AI2-THOR 5.0.0 does not come back from it (issue 1213)"


TRAPS = ("CUDA_VISIBLE_DEVICES", "AI2THOR_VISIBILITY_DISTANCE")  # variables the client acts on
TAIL_BYTES = 600


class ClientProcess:
    """AI2-THOR's client and player in a child process.

    Raises:
        WorldLost: as in `call`.
    """

    def __init__(self, folder: Path, *, limit_s: float, **settings: Any) -> None:
        self.last_event: Any = None
        self._log = folder / "log" / "unity.log"
        self._log_from = self._log.stat().st_size if self._log.exists() else 0
        self._pipes = tempfile.TemporaryDirectory()
        self._connection, there = Pipe()
        words = child_command(
            "karma.world.thor.client:serve", str(there.fileno()), self._pipes.name
        )
        self.process = subprocess.Popen(
            words,
            env={name: value for name, value in os.environ.items() if name not in TRAPS},
            stdin=subprocess.DEVNULL,
            pass_fds=[there.fileno()],
            start_new_session=True,
        )
        there.close()
        try:
            self.call("start", "start", limit_s=limit_s, folder=folder, **settings)
        except BaseException:
            self.end()
            raise

    def call(self, during: str, name: str, *given: Any, limit_s: float, **named: Any) -> Any:
        """Return what a method of the child's client returns; `during` is what errors call it.

        Raises:
            WorldLost: the player is gone, hangs, or makes no sense; the child has ended.
            Exception: what the method raises.
        """
        message = ForkingPickler.dumps((name, given, named))
        try:
            with suppress(OSError):  # what is left to read says why nobody takes it
                self._connection.send_bytes(message)
            if self._connection.poll(limit_s):
                value, event, error = self._connection.recv()
            else:
                error = "no answer in time; it hangs, or the time limit is too short"
        except (EOFError, OSError):
            error = "the client was killed"
        except BaseException:  # e.g. an interrupt: the answer would be taken for the next call's
            self.end()
            raise
        if isinstance(error, str):
            self.end()
            raise WorldLost(error, during=during, log=self._log, tail=self._tail())
        self.last_event = event
        if error is not None:
            raise error
        return value

    def end(self) -> None:
        """End child and player, whatever state they are in, and remove the pipes."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self._connection.close()
        self._pipes.cleanup()

    def _tail(self) -> str:
        """Return the last lines that the player has printed, indented."""
        with suppress(OSError), self._log.open("rb") as file:
            file.seek(max(self._log_from, self._log.stat().st_size - TAIL_BYTES))
            lines = file.read().decode(errors="replace").splitlines()
            return "\n".join(f"    {line}" for line in lines[-6:])
        return ""


class ThorWorld:
    """AI2-THOR through its own client; implements `karma.types.roles.World`.

    The player starts with the first `reset`.

    Args:
        executable: the Unity build: its file, its folder, or the text of a command; None =
            $KARMA_THOR_BUILD, else AI2-THOR's cache.
        scene: loaded at once when given.
        platform: "Linux64" needs an X display, "CloudRendering" a Vulkan driver; None = by the
            build's name.
        display: X display, e.g. ":0"; None = $DISPLAY, else the first of this machine.
        headless: no pictures, no graphics card.
        start_timeout_s: until the first scene is there.
        step_timeout_s: for each `step` and each further `reset`.
        folder: for the client's log; None = ~/.ai2thor.
        settings: further arguments of AI2-THOR's Controller (width, quality, ...) and of Initialize
            (gridSize, renderDepthImage, ...).

    Raises:
        KarmaError: the package or the build is missing; says what to do.
        WorldLost: as in `reset`, when a scene is given.
    """

    def __init__(
        self,
        executable: str | Path | None = None,
        *,
        scene: str | None = None,
        platform: Platform | None = None,
        display: str | None = None,
        headless: bool = False,
        start_timeout_s: float = 120.0,
        step_timeout_s: float = 100.0,
        folder: str | Path | None = None,
        **settings: Any,
    ) -> None:
        if forbidden := sorted(settings.keys() & OURS):
            raise TypeError(f"ThorWorld has no argument {forbidden[0]!r}")
        builds.check_package()
        self.build = builds.find(executable, platform)
        self._folder = Path(folder) if folder is not None else builds.home()
        display = display or os.environ.get("DISPLAY") or (*builds.screens(), ":0")[0]
        self._settings = {
            "headless": headless,
            "x_display": display,
            "command": self.build.command,
            "platform": self.build.platform,
            **settings,
        }
        self._start_s, self._step_s = start_timeout_s, step_timeout_s
        self._client: ClientProcess | None = None
        self._event: Any = None
        self._loss: WorldLost | None = None
        if scene is not None:
            self.reset(scene)

    @property
    def last_event(self) -> Any:
        """The event of the last `reset` or `step`.

        Raises:
            KarmaError: no scene is loaded.
        """
        if self._event is None:
            raise KarmaError("no scene is loaded\n  To fix: world.reset('FloorPlan1')")
        return self._event

    @property
    def scenes(self) -> tuple[str, ...]:
        """The names of the build's scenes, sorted; starts the player if none has been.

        Raises:
            WorldLost: the player is gone, or does not start.
        """
        if self._client is None and self._loss is None:
            self._begin(None)
        return tuple(self._called("scenes", "scenes"))

    @property
    def pid(self) -> int:
        """The client's process; the player is its child.

        Raises:
            KarmaError: none is running.
        """
        return self._running().process.pid

    def reset(self, scene: str) -> Any:
        """Load a scene by AI2-THOR's name; a fresh player is started when there is none.

        Raises:
            UnknownNameError: the build has no such scene.
            WorldLost: the player does not start, or dies while it loads the scene.
            ValueError: an argument of Initialize does not fit.
            KarmaError: the player refuses to begin.
        """
        return self._begin(scene)

    def step(self, action: str | Mapping[str, Any], **arguments: Any) -> Any:
        """Do one action, as AI2-THOR's Controller does; pictures are the caller's to write on.

        Raises:
            ValueError: the action is unknown, or its arguments do not fit.
            RuntimeError: `raise_for_failure` was given, and the action failed.
            WorldLost: the player is gone, hangs, or makes no sense; `reset` starts another.
        """
        loud = bool(arguments.pop("raise_for_failure", False))
        given = {"action": action} if isinstance(action, str) else dict(action)
        given.update(arguments)
        client = self._running()
        name = str(given["action"])
        if _moves_blinds(name, given):
            return self._refuse(name, loud=loud)
        try:
            return self._keep(self._called(name, "step", given, raise_for_failure=loud))
        except (ValueError, RuntimeError):
            self._keep(client.last_event)
            raise

    def stop(self) -> None:
        """End the player; a later `reset` starts another."""
        if self._client is not None:
            self._client.end()
        self._client = self._loss = None

    # ------------------------------------------------------------- the player

    def _begin(self, scene: str | None) -> Any:
        try:
            if self._client is not None:
                try:
                    return self._keep(self._called("reset", "reset", scene))
                except WorldLost as loss:  # it died between two episodes: this one gets a fresh one
                    log.warning("%s", loss)
            self._client = ClientProcess(
                _writable(self._folder), limit_s=self._start_s, scene=scene, **self._settings
            )
            return self._keep(self._client.last_event)
        except RuntimeError as error:
            what = scene or "the first scene"
            raise KarmaError(f"{what}: the player refuses to begin: {error}") from error

    def _called(self, during: str, name: str, *given: Any, **named: Any) -> Any:
        try:
            return self._running().call(during, name, *given, limit_s=self._step_s, **named)
        except WorldLost as loss:
            self._client, self._loss = None, loss
            raise

    def _running(self) -> ClientProcess:
        if self._client is not None:
            return self._client
        if self._loss is not None:
            raise WorldLost(self._loss.reason, during=self._loss.during, log=self._loss.log)
        raise KarmaError("no player is running\n  To fix: world.reset('FloorPlan1')")

    def _keep(self, event: Any) -> Any:
        self._event, self._loss = event, None
        return event

    def _refuse(self, action: str, *, loud: bool) -> Any:
        """Return the present moment as the event of an action that failed."""
        last = self.last_event.events[0]
        event = copy.copy(last)
        event.metadata = type(last.metadata)(last.metadata)
        event.metadata.update(
            lastAction=action,
            lastActionSuccess=False,
            errorMessage=BLINDS,
            errorCode=None,
            actionReturn=None,
        )
        event.events = [event]
        self._keep(event)
        if loud:
            raise RuntimeError(BLINDS)
        return event


def _moves_blinds(name: str, given: Mapping[str, Any]) -> bool:
    named = root_type(str(given.get("objectId", "")))
    return name in ("OpenObject", "CloseObject") and named == "Blinds"


def _writable(folder: Path) -> Path:
    """Return the folder, made if need be.

    Raises:
        FileError: nothing can be written there.
    """
    try:
        (folder / "log").mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder / "log"):
            return folder
    except OSError as error:
        fix = "export HOME=/a/folder/you/may/write, or ThorWorld(folder=...)"
        raise FileError(folder, error.strerror or str(error), fix=fix) from error
