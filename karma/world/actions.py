"""The dispatch table: which actions there are, what may be said with each, and who does it."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Any, get_args, get_origin

from karma.world import handling, moving
from karma.world.state import Refusal, Result


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
