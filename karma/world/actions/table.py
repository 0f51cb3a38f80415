"""List the actions: the arguments that each takes, and the function that does it.

Those of AI2-THOR that the embedded world leaves out (`left_out.toml`) are refused with the reason.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgspec import Struct

from karma.files import read_toml
from karma.world.actions import arranging, hand, handling, moving, questions, setup
from karma.world.core.arguments import fit, kinds
from karma.world.core.state import Refusal, Result, WorldState


class _Group(Struct, frozen=True, forbid_unknown_fields=True):
    reason: str
    names: tuple[str, ...]


_TABLE = Path(__file__).with_name("left_out.toml")
LEFT_OUT: Mapping[str, str] = {  # why, by name
    name: group.reason
    for group in read_toml(_TABLE, dict[str, tuple[_Group, ...]])["group"]
    for name in group.names
}


def _refuser(name: str, reason: str) -> Callable[..., Result]:
    def left_out(state: WorldState) -> Result:
        return Refusal(f"{name} is not part of the embedded world: {reason}.")

    return left_out


@dataclass(frozen=True, slots=True)
class ActionEntry:
    """One entry of the dispatch table: what may be said, and what it does."""

    name: str
    handler: Callable[..., Result]
    takes: Mapping[str, Any]  # argument -> the handler's annotation
    kinds: Mapping[str, tuple[type, ...]]  # argument -> types it may have
    required: tuple[str, ...]
    lenient: bool  # a legacy action: unknown arguments are ignored

    def ready(self, given: Mapping[str, Any]) -> dict[str, Any] | Refusal:
        """Return the arguments as the handler takes them, or what is wrong with them."""
        unknown = [name for name in given if name not in self.kinds]
        if unknown and not self.lenient:
            return Refusal(self._misfit(unknown, given), "InvalidArgument")
        if missing := [name for name in self.required if name not in given]:
            return moving.lacks(self.name, *missing)
        found: dict[str, Any] = {}
        for name, value in given.items():
            if name in self.takes:
                value = fit(self.name, name, value, self.takes[name], self.kinds[name])
                if isinstance(value, Refusal):
                    return value
                found[name] = value
        return found

    def _misfit(self, unknown: list[str], given: Mapping[str, Any]) -> str:
        return (
            f"action: {self.name} has invalid arguments: {', '.join(map(str, unknown))}.\n"
            f"Expected arguments: {', '.join(self.kinds)}\n"
            f"Your arguments: {', '.join(map(str, given))}"
        )


def _action(name: str, handler: Callable[..., Result], *, lenient: bool = False) -> ActionEntry:
    parameters = list(inspect.signature(handler).parameters.values())[1:]
    takes = {p.name: p.annotation for p in parameters}
    types = {name: kinds(annotation) for name, annotation in takes.items()}
    required = tuple(p.name for p in parameters if p.default is inspect.Parameter.empty)
    return ActionEntry(name, handler, takes, types, required, lenient)


_SIGNED: dict[str, Callable[..., Result]] = {
    # walking and looking
    "MoveAhead": moving.mover(0.0),
    "MoveRight": moving.mover(90.0),
    "MoveBack": moving.mover(180.0),
    "MoveLeft": moving.mover(270.0),
    "RotateRight": moving.turner(+1),
    "RotateLeft": moving.turner(-1),
    "Teleport": moving.teleport,
    "TeleportFull": moving.teleport_full,
    # questions
    "GetReachablePositions": questions.reachable_positions,
    "GetShortestPath": questions.shortest_path,
    "GetInteractablePoses": questions.interactable_poses,
    "GetCoordinateFromRaycast": questions.coordinate,
    # handling
    "PickupObject": handling.pick_up,
    "PutObject": handling.put,
    "DropHeldObject": handling.drop,
    "DropHandObject": handling.drop,
    "ThrowObject": handling.throw,
    "OpenObject": handling.open_object,
    "CloseObject": handling.close_object,
    "ToggleObjectOn": handling.toggler(True),
    "ToggleObjectOff": handling.toggler(False),
    # the hand
    "MoveHeldObject": hand.move,
    "MoveHeldObjectAhead": hand.mover(0.0, 0.0, 1.0),
    "MoveHeldObjectBack": hand.mover(0.0, 0.0, -1.0),
    "MoveHeldObjectLeft": hand.mover(-1.0, 0.0, 0.0),
    "MoveHeldObjectRight": hand.mover(1.0, 0.0, 0.0),
    "MoveHeldObjectUp": hand.mover(0.0, 1.0, 0.0),
    "MoveHeldObjectDown": hand.mover(0.0, -1.0, 0.0),
    "RotateHeldObject": hand.rotate,
    # arranging the household
    "InitialRandomSpawn": arranging.initial_random_spawn,
    # cameras
    "AddThirdPartyCamera": setup.add_camera,
    "UpdateThirdPartyCamera": setup.update_camera,
    # setting up
    "SetObjectFilter": setup.set_object_filter,
    "ResetObjectFilter": setup.reset_object_filter,
    "SetRandomSeed": setup.set_random_seed,
    "ChangeResolution": setup.change_resolution,
    "TestFastEmit": setup.echo_fast,
    "TestActionReflectParam": setup.echo,
}
_LEGACY: dict[str, Callable[..., Result]] = {
    "Initialize": setup.initialize,
    "Pass": moving.wait,
    "Done": moving.wait,
    "NoOp": moving.wait,
    "Crouch": moving.stander(False),
    "Stand": moving.stander(True),
    "LookDown": moving.looker(+1),
    "LookUp": moving.looker(-1),
    "RotateLook": moving.rotate_look,
    "GetScenesInBuild": questions.scenes_in_build,
    "SliceObject": handling.slice_object,
    "BreakObject": handling.break_object,
    "FillObjectWithLiquid": handling.fill,
    **handling.STATE_CHANGES,
    **{name: _refuser(name, reason) for name, reason in LEFT_OUT.items()},
}
ACTIONS: Mapping[str, ActionEntry] = {
    **{name: _action(name, handler) for name, handler in _SIGNED.items()},
    **{name: _action(name, handler, lenient=True) for name, handler in _LEGACY.items()},
}
