"""Drive the real AI2-THOR 5.0.0 as a world.

A Unity build and the package `ai2thor` are the user's to bring; docs/thor.md says how. The player
runs behind a guard (guard.py) under AI2-THOR's own client (client.py): one that dies, hangs or
sends nonsense is a `WorldLost`, and the next `reset` starts another. Nothing here opens a
connection beyond this machine.
"""

import copy
import logging
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from karma.errors import FileError, KarmaError, WorldLost
from karma.household.ids import root_type
from karma.world.thor import builds
from karma.world.thor.builds import Platform

if TYPE_CHECKING:
    from karma.world.thor.client import Client

log = logging.getLogger(__name__)

OURS = frozenset(  # arguments of the Controller that would look for a build, or that are set here
    {"local_executable_path", "local_build", "commit_id", "branch", "download_only", "start_unity",
     "include_private_scenes", "server_class", "gpu_device", "x_display", "server_timeout",
     "server_start_timeout", "host", "port", "agentControllerType"}
)  # fmt: skip
BLINDS = "Blinds are never moved: AI2-THOR 5.0.0 does not come back from it (issue 1213)"


class ThorWorld:
    """AI2-THOR through its own client; implements `contracts.World`.

    The player starts with the first `reset`.

    Args:
        executable: the Unity build: its file, its folder, or the text of a command; None =
            $KARMA_THOR_BUILD, else AI2-THOR's cache.
        scene: loaded at once when given.
        platform: "Linux64" needs an X display, "CloudRendering" a Vulkan driver; None = by the
            build's name.
        display: X display, e.g. ":0"; None = $DISPLAY, else the first of this machine.
        headless: no pictures, no graphics card.
        start_timeout_s: until the player's first frame.
        step_timeout_s: for each answer.
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
        self._display = display or os.environ.get("DISPLAY") or (*builds.screens(), ":0")[0]
        limits = {"start_timeout_s": start_timeout_s, "step_timeout_s": step_timeout_s}
        self._settings = {"headless": headless, **limits, **settings}
        self._client: Client | None = None
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
        return tuple(sorted(self._running().scenes_in_build))

    @property
    def pid(self) -> int:
        """The guard's process; the player is its child.

        Raises:
            KarmaError: none is running.
        """
        pid: int = self._running().unity_pid
        return pid

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
        try:
            if not self._moves_blinds(client, given):
                return self._keep(client.step(given, raise_for_failure=loud))
        except WorldLost as loss:
            self._loss = loss
            raise
        except (ValueError, RuntimeError):
            self._keep(client.last_event)
            raise
        finally:
            if not client.alive:
                self._drop()
        return self._refuse(str(given["action"]), loud=loud)

    def stop(self) -> None:
        """End the player; a later `reset` starts another."""
        self._drop()
        self._loss = None

    # ------------------------------------------------------------- the player

    def _begin(self, scene: str | None) -> Any:
        try:
            return self._keep(self._begun(scene))
        except RuntimeError as error:
            what = scene or "the first scene"
            raise KarmaError(f"{what}: the player refuses to begin: {error}") from error

    def _begun(self, scene: str | None) -> Any:
        if self._client is not None and self._client.alive:
            try:
                return self._client.reset(scene)
            except WorldLost as loss:  # it died between two episodes: this one gets a fresh one
                log.warning("%s", loss)
        self._drop()
        from karma.world.thor.client import Client

        place = _writable(self._folder)
        self._client = Client(
            self.build, folder=place, display=self._display, scene=scene, **self._settings
        )
        return self._client.last_event

    def _running(self) -> "Client":
        if self._client is not None:
            return self._client
        if self._loss is not None:
            raise WorldLost(self._loss.reason, during=self._loss.during, log=self._loss.log)
        raise KarmaError("no player is running\n  To fix: world.reset('FloorPlan1')")

    def _drop(self) -> None:
        if self._client is not None:
            if self._loss is None and not self._client.alive:
                self._loss = WorldLost(
                    self._client.reason, during="the last action", log=self._client.log_path
                )
            self._client.end()
            self._client = None

    def _keep(self, event: Any) -> Any:
        for one in event.events:
            _own_pictures(one)
        self._event = event
        self._loss = None
        return event

    # ------------------------------------------------------------- blinds

    def _moves_blinds(self, client: "Client", given: Mapping[str, Any]) -> bool:
        if given["action"] in ("OpenObject", "CloseObject"):
            return self._type_of(self._target(client, given)) == "Blinds"
        if given["action"] == "SetObjectStates":
            change = given.get("SetObjectStates") or {}
            everything = not change.get("objectType")
            return change.get("stateChange") == "openable" and (
                change.get("objectType") == "Blinds"
                or (everything and bool(self.last_event.objects_by_type("Blinds")))
            )
        return False

    def _target(self, client: "Client", given: Mapping[str, Any]) -> str:
        """Return the id that an action means, also when it gives a point of the picture."""
        if given.get("objectId") or not {"x", "y"} <= given.keys():
            return str(given.get("objectId", ""))
        where = {"x": given["x"], "y": given["y"], "checkVisible": False}
        try:
            return str(client.step("GetObjectInFrame", **where).metadata["actionReturn"] or "")
        except ValueError:
            return ""

    def _type_of(self, object_id: str) -> str:
        found = next(
            (o for o in self.last_event.metadata["objects"] if o["objectId"] == object_id), None
        )
        return found["objectType"] if found else root_type(object_id)

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


def _own_pictures(event: Any) -> None:
    """Replace the client's read-only, upside-down views by arrays of the event's own."""
    for name, value in tuple(vars(event).items()):
        if name.endswith("frames"):
            setattr(event, name, [np.array(one, order="C") for one in value])
        elif name.endswith("frame") and value is not None:
            setattr(event, name, np.array(value, order="C"))


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
