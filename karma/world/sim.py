"""The embedded world: AI2-THOR 5.0.0's vocabulary over a scene file, headless and deterministic.

Covered: the actions in `ACTIONS`, all event and object fields, containment, visibility, heat,
cold, water, coffee, slicing, breaking. Not covered: pictures, meshes, doors that swing, pushing.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from karma.errors import KarmaError
from karma.world import scene
from karma.world.actions import ACTIONS
from karma.world.event import WorldEvent
from karma.world.rules import settle
from karma.world.scene import Scene
from karma.world.state import Refusal, Settings, WorldState, begin

MISUSE = frozenset({"InvalidAction", "MissingArguments", "AmbiguousAction", "InvalidArgument"})
_PLAYER_ARGUMENTS = frozenset(
    {"agentId", "sequenceId", "renderImage", "renderDepthImage", "renderInstanceSegmentation",
     "renderSemanticSegmentation", "renderNormalsImage", "visibilityDistance"}
)  # fmt: skip


class EmbeddedWorld:
    """A household of boxes; implements `contracts.World`.

    Args:
        scene: loaded at once when given; a name, a path, or a `Scene`.
        gridSize: metres of one step; None = the scene's own.
        visibilityDistance: reach across the floor, metres.
        fieldOfView: vertical, degrees.
        width: of the picture, pixels.
        height: of the picture, pixels.
        rotateStepDegrees: of one turn.
        snapToGrid: whether a step ends on a cell.
    """

    def __init__(
        self,
        scene: str | Path | Scene | None = None,
        *,
        gridSize: float | None = None,
        visibilityDistance: float = 1.5,
        fieldOfView: float = 90.0,
        width: int = 300,
        height: int = 300,
        rotateStepDegrees: float = 90.0,
        snapToGrid: bool = True,
    ) -> None:
        self._grid_m = gridSize
        self._settings = Settings(
            visibility_m=visibilityDistance,
            fov_deg=fieldOfView,
            width=width,
            height=height,
            rotate_deg=rotateStepDegrees,
            snap=snapToGrid,
        )
        self._event: WorldEvent | None = None
        if scene is not None:
            self.reset(scene)

    @property
    def last_event(self) -> WorldEvent:
        """The event of the last `reset` or `step`.

        Raises:
            KarmaError: no scene is loaded.
        """
        if self._event is None:
            raise KarmaError("no scene is loaded\n  To fix: world.reset('<scene name or path>')")
        return self._event

    @property
    def state(self) -> WorldState:
        """The present moment; the world's truth, not for agents."""
        return self.last_event.state

    def reset(self, scene: str | Path | Scene) -> WorldEvent:
        """Load a scene by name or path, or one already read.

        Raises:
            FileError: there is no such scene, or it is damaged.
        """
        loaded = scene if isinstance(scene, Scene) else _load(scene)
        settings = replace(self._settings, grid_m=self._grid_m or loaded.grid_m)
        planes = {"cameraNearPlane": 0.01, "cameraFarPlane": 20.0}
        state = settle(begin(loaded, settings))
        self._event = WorldEvent(state=state, action="Initialize", value=planes, first=True)
        return self._event

    def step(self, action: str | Mapping[str, Any], **arguments: Any) -> WorldEvent:
        """Do one action, as AI2-THOR's Controller does.

        Args:
            action: its name, or a mapping with the name under "action" and its arguments.
            arguments: of the action; `raise_for_failure=True` turns a refusal into RuntimeError.

        Raises:
            ValueError: the action is unknown, or its arguments do not fit; nothing changes.
        """
        if not isinstance(action, str):
            arguments = {**action, **arguments}
            action = str(arguments.pop("action"))
        loud = bool(arguments.pop("raise_for_failure", False))
        event = _act(self.last_event, action, arguments)
        self._event = event
        if event.code in MISUSE:
            raise ValueError(event.message)
        if loud and not event.success:
            raise RuntimeError(event.message)
        return event

    def stop(self) -> None:
        """Forget the scene."""
        self._event = None


def _load(name: str | Path) -> Scene:
    return scene.load(name)


def _act(last: WorldEvent, name: str, arguments: Mapping[str, Any]) -> WorldEvent:
    """Return the event of one action."""
    given = {k: v for k, v in arguments.items() if k not in _PLAYER_ARGUMENTS and v is not None}
    action = ACTIONS.get(name)
    if action is None:
        return _refused(last, name, Refusal(f"Invalid action: {name}", "InvalidAction"))
    wrong = action.check(given)
    if wrong is not None:
        return _refused(last, name, wrong)
    known = {k: v for k, v in given.items() if k in action.kinds}
    result = action.handler(last.state, **known)
    if isinstance(result, Refusal):
        return _refused(last, name, result)
    if result.state is last.state and not result.seconds:
        return WorldEvent(state=last.state, action=name, value=result.value, before=last)
    state = settle(replace(result.state, time_s=result.state.time_s + result.seconds))
    return WorldEvent(state=state, action=name, value=result.value)


def _refused(last: WorldEvent, name: str, refusal: Refusal) -> WorldEvent:
    return WorldEvent(
        state=last.state,
        action=name,
        success=False,
        message=refusal.message,
        code=refusal.code,
        before=last,
    )
