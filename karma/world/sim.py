"""The embedded world: AI2-THOR 5.0.0's vocabulary over a scene file, headless and deterministic.

Covered: the actions in `ACTIONS`, all event and object fields, containment, visibility, heat,
cold, water, coffee, slicing, breaking. Not covered: pictures, meshes, doors that swing, pushing.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin

from karma.errors import KarmaError
from karma.world import handling, moving, scene
from karma.world.event import WorldEvent
from karma.world.rules import settle
from karma.world.scene import Scene
from karma.world.state import Refusal, Result, Settings, WorldState, begin

MISUSE = frozenset({"InvalidAction", "MissingArguments", "AmbiguousAction", "InvalidArgument"})
_PLAYER_ARGUMENTS = frozenset(
    {"agentId", "sequenceId", "renderImage", "renderDepthImage", "renderInstanceSegmentation",
     "renderSemanticSegmentation", "renderNormalsImage", "visibilityDistance"}
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Action:
    """One entry of the dispatch table: what may be said, and what it does."""

    name: str
    handler: Callable[..., Result]
    kinds: Mapping[str, tuple[type, ...]]  # argument -> types it may have
    required: tuple[str, ...]
    lenient: bool  # a legacy action: unknown arguments are ignored

    def check(self, given: Mapping[str, Any]) -> Refusal | None:
        """Return what is wrong with the arguments, if anything."""
        unknown = [name for name in given if name not in self.kinds]
        if unknown and not self.lenient:
            return Refusal(self._misfit(unknown, given), "InvalidArgument")
        if missing := [name for name in self.required if name not in given]:
            text = f"action: {self.name} is missing the following arguments: {', '.join(missing)}"
            return Refusal(text, "MissingArguments")
        for name, value in given.items():
            kinds = self.kinds.get(name)
            if kinds is not None and not _fits(value, kinds):
                wanted = " or ".join(kind.__name__ for kind in kinds if kind is not NoneType)
                text = f"action: {self.name} has an invalid argument: {name} (=={value!r})."
                return Refusal(f"{text} Cannot convert to: {wanted}", "InvalidArgument")
        return None

    def _misfit(self, unknown: list[str], given: Mapping[str, Any]) -> str:
        return (
            f"action: {self.name} has invalid arguments: {', '.join(unknown)}.\n"
            f"Expected arguments: {', '.join(self.kinds)}\nYour arguments: {', '.join(given)}"
        )


def _fits(value: Any, kinds: tuple[type, ...]) -> bool:
    if isinstance(value, bool):
        return bool in kinds
    return isinstance(value, kinds) or (float in kinds and isinstance(value, int))


def _action(name: str, handler: Callable[..., Result], *, lenient: bool = False) -> Action:
    parameters = list(inspect.signature(handler).parameters.values())[1:]
    kinds = {p.name: _kinds(p.annotation) for p in parameters}
    required = tuple(p.name for p in parameters if p.default is inspect.Parameter.empty)
    return Action(name, handler, kinds, required, lenient)


def _kinds(annotation: Any) -> tuple[type, ...]:
    parts = get_args(annotation) if isinstance(annotation, UnionType) else (annotation,)
    return tuple(get_origin(part) or part for part in parts)


def _legacy(name: str, handler: Callable[..., Result]) -> Action:
    return _action(name, handler, lenient=True)


_SIGNED: dict[str, Callable[..., Result]] = {
    "MoveAhead": moving.mover(0.0),
    "MoveRight": moving.mover(90.0),
    "MoveBack": moving.mover(180.0),
    "MoveLeft": moving.mover(270.0),
    "RotateRight": moving.turner(+1),
    "RotateLeft": moving.turner(-1),
    "Teleport": moving.teleport,
    "TeleportFull": moving.teleport_full,
    "GetReachablePositions": moving.reachable_positions,
    "GetShortestPath": moving.shortest_path,
    "GetShortestPathToPoint": moving.shortest_path_to_point,
    "GetInteractablePoses": moving.interactable_poses,
    "SetTemperatureDecayTime": moving.set_decay_time,
    "PickupObject": handling.pick_up,
    "PutObject": handling.put,
    "DropHeldObject": handling.drop,
    "DropHandObject": handling.drop,
    "ThrowObject": handling.throw,
    "OpenObject": handling.open_object,
    "CloseObject": handling.close_object,
    "ToggleObjectOn": handling.toggler(True),
    "ToggleObjectOff": handling.toggler(False),
}
_LEGACY: dict[str, Callable[..., Result]] = {
    "Pass": moving.wait,
    "Done": moving.wait,
    "NoOp": moving.wait,
    "Crouch": moving.crouch,
    "Stand": moving.stand,
    "LookDown": moving.looker(+1),
    "LookUp": moving.looker(-1),
    "GetScenesInBuild": moving.scenes_in_build,
    "SliceObject": handling.slice_object,
    "BreakObject": handling.break_object,
    "FillObjectWithLiquid": handling.fill,
}
_STATES: dict[str, tuple[Any, ...]] = {
    "DirtyObject": ("dirtyable", "is_dirty", True, "dirty"),
    "CleanObject": ("dirtyable", "is_dirty", False, "clean"),
    "EmptyLiquidFromObject": ("canFillWithLiquid", "is_filled", False, "empty"),
    "UseUpObject": ("canBeUsedUp", "is_used_up", True, "used up"),
    "CookObject": ("cookable", "is_cooked", True, "cooked"),
}
ACTIONS: Mapping[str, Action] = {
    **{name: _action(name, handler) for name, handler in _SIGNED.items()},
    **{name: _legacy(name, handler) for name, handler in _LEGACY.items()},
    **{name: _legacy(name, handling.state_changer(name, *row)) for name, row in _STATES.items()},
}


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
