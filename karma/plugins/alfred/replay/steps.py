"""Translate a demonstrator's actions into AI2-THOR 5.0.0's, and follow where they lead.

ALFRED was recorded on an older AI2-THOR. Its turns are of 90 degrees, its looks of 15; PutObject
names the held object and the receptacle, where 5.0.0's names the receptacle alone; pieces of what
was sliced are numbered from 1, 5.0.0's from 0.
"""

from collections.abc import Collection
from typing import Any

from karma.errors import KarmaError
from karma.household.ids import type_of
from karma.household.pieces import is_piece
from karma.plugins.alfred.replay.trial import ApiAction, PlannerAction, Trial
from karma.world.core.thing import heading

TURN_DEG, LOOK_DEG, STEP_M = 90.0, 15.0, 0.25
MOVES = {"MoveAhead": 0.0, "MoveRight": 90.0, "MoveBack": 180.0, "MoveLeft": 270.0}
TURNS = {"RotateRight": TURN_DEG, "RotateLeft": -TURN_DEG}
LOOKS = ("LookDown", "LookUp")
ON_OBJECTS = (
    "PickupObject", "PutObject", "OpenObject", "CloseObject", "ToggleObjectOn", "ToggleObjectOff",
    "SliceObject",
)  # fmt: skip

Step = tuple[str, dict[str, Any]]  # an action and its arguments, as `World.step` takes them


class UntranslatableError(KarmaError):
    """An action that cannot be said to AI2-THOR 5.0.0."""


def translated(given: ApiAction, *, held: str | None, present: Collection[str]) -> Step:
    """Return an action in AI2-THOR 5.0.0's words, while an id is held and others are present.

    Raises:
        UntranslatableError: unknown, without its object, or it puts what is not in the hand.
    """
    name = given.action
    if name in MOVES:
        return name, {"moveMagnitude": given.move_magnitude or STEP_M, **_force(given)}
    if name in TURNS:
        return name, {"degrees": TURN_DEG, **_force(given)}
    if name in LOOKS:
        return name, {"degrees": LOOK_DEG}
    if name not in ON_OBJECTS:
        raise UntranslatableError(f"{name} is no action of ALFRED's demonstrations")
    if given.object_id is None:
        raise UntranslatableError(f"{name} names no object")
    target = piece_now(given.object_id, present)
    if name != "PutObject":
        return name, {"objectId": target, **_force(given)}
    if given.receptacle_object_id is None:
        raise UntranslatableError("PutObject names no receptacle")
    if held != target:
        raise UntranslatableError(f"puts {given.object_id}, but the hand holds {held or 'nothing'}")
    stationary = {} if given.place_stationary is None else {"placeStationary": True}
    return name, {"objectId": given.receptacle_object_id, **stationary, **_force(given)}


def _force(given: ApiAction) -> dict[str, bool]:
    return {"forceAction": True} if given.force_action else {}


def piece_now(object_id: str, present: Collection[str]) -> str:
    """Return the id that a piece has here; others stay as they are.

    How many pieces there are is each model's own affair, so the last one stands for those beyond.

    >>> piece_now("Apple|0|1|2|AppleSliced_2", {"Apple|0|1|2|AppleSliced_1"})
    'Apple|0|1|2|AppleSliced_1'
    """
    stem, _, number = object_id.rpartition("_")
    if not number.isdecimal() or not is_piece(type_of(object_id)):
        return object_id
    for index in range(int(number) - 1, -1, -1):
        if f"{stem}_{index}" in present:
            return f"{stem}_{index}"
    return object_id


def visited(trial: Trial) -> tuple[tuple[float, float], ...]:
    """Return the places (x, z) that a demonstrator's moves lead to, the start first; each once."""
    start = trial.scene.init_action
    x, z, yaw = start.x, start.z, start.rotation
    found = {(round(x, 4), round(z, 4)): None}
    for low in trial.plan.low_actions:
        given = low.api_action
        yaw += TURNS.get(given.action, 0.0)
        if given.action in MOVES:
            right, ahead = heading(yaw + MOVES[given.action])
            far = given.move_magnitude or STEP_M
            for _ in range(max(round(far / STEP_M), 1)):
                x, z = x + right * STEP_M, z + ahead * STEP_M
                found[(round(x, 4), round(z, 4))] = None
    return tuple(found)


def named(trial: Trial) -> tuple[str, ...]:
    """Return every id that the plan or the actions name, in order, each once; no pieces."""
    steps: list[PlannerAction | ApiAction] = [goal.planner_action for goal in trial.plan.high_pddl]
    steps += (low.api_action for low in trial.plan.low_actions)
    ids = [one for step in steps for one in (step.object_id, step.receptacle_object_id) if one]
    kinds = {one: type_of(one) for one in ids}
    return tuple(one for one, kind in kinds.items() if kind and not is_piece(kind))
