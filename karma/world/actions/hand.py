"""Move and turn what is in the hand, which stays there."""

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np

from karma.types.space import Vec3
from karma.world.actions.moving import hang
from karma.world.core.arguments import Place
from karma.world.core.boxes import Floats
from karma.world.core.posing import angles, met_by, rotation_matrix, spun, vector, with_contents
from karma.world.core.state import Performed, Refusal, Result, WorldState
from karma.world.core.view import camera, camera_axes, in_picture

_EMPTY = "Agent is not holding anything in its hand."
_CLOSE_M = 0.01


def move(
    state: WorldState,
    *,
    ahead: float = 0.0,
    right: float = 0.0,
    up: float = 0.0,
    forceVisible: bool = False,
) -> Result:
    """Move the hand along the camera's axes."""
    return _reach(state, (right, up, ahead), forceVisible)


def mover(right: float, up: float, ahead: float) -> Callable[..., Result]:
    """Return the action that moves the hand one way."""

    def move_one_way(
        state: WorldState, *, moveMagnitude: float, forceVisible: bool = False
    ) -> Result:
        if moveMagnitude < 0:
            return Refusal("moveMagnitude must not be negative")
        by = (right * moveMagnitude, up * moveMagnitude, ahead * moveMagnitude)
        return _reach(state, by, forceVisible)

    return move_one_way


def _reach(state: WorldState, by: Vec3, force: bool) -> Result:
    if state.held is None:
        return Refusal(_EMPTY)
    x, y, z = (round(a + b, 6) for a, b in zip(state.hand_m, by, strict=True))
    after = replace(state, hand_m=(x, y, z))
    if refusal := _out_of_reach(after, force):
        return refusal
    after = replace(after, objects=hang(after, state.held, 0.0))
    hit = bumped(state, after)
    if hit is not None:
        return Refusal(f"{state.objects[state.held].name} would run into {hit}.")
    return Performed(after)


def _out_of_reach(state: WorldState, force: bool) -> Refusal | None:
    """Return why the hand cannot be there: too far, or (unless forced) out of the picture."""
    pose, settings = state.pose, state.settings
    offset = np.array(state.hand) - np.array(camera(pose))
    if np.linalg.norm(offset) > settings.visibility_m:
        return Refusal("The target position is out of range: beyond the visibility distance.")
    axes = camera_axes(pose.yaw_deg, pose.horizon_deg)
    if force or in_picture(offset[None], axes, settings.fov_deg, settings.aspect)[0]:
        return None
    return Refusal("The target position is not in the agent's viewport.")


def rotate(
    state: WorldState,
    *,
    pitch: float = 0.0,
    yaw: float = 0.0,
    roll: float = 0.0,
    rotation: Place | None = None,
) -> Result:
    """Turn what is in the hand: by angles about the agent's axes, or to a rotation in its frame."""
    if state.held is None:
        return Refusal(_EMPTY)
    before = rotation_matrix(state.hand_turn_deg)
    if rotation is None:
        wanted = rotation_matrix((pitch, yaw, -roll)) @ before
    else:
        wanted = rotation_matrix(vector(rotation))
    facing = rotation_matrix((0.0, state.pose.yaw_deg, 0.0))
    delta = facing @ wanted @ before.T @ facing.T
    thing = state.objects[state.held]
    there = spun(thing, delta, angles(delta @ rotation_matrix(thing.rotation)))
    if wanted[1, 1] < 0:  # tilted by more than 90 degrees
        there = msgspec.structs.replace(there, is_filled=False, liquid=None)
    after = replace(
        state, objects=with_contents(state.objects, there), hand_turn_deg=angles(wanted)
    )
    hit = bumped(state, after)
    if hit is not None:
        return Refusal(f"{thing.name} would run into {hit} when turned.")
    return Performed(after)


def bumped(before: WorldState, after: WorldState) -> str | None:
    """Return the name of what the held thing gets into that it was not in; None if nothing."""
    room, held = after.room, after.held or ""
    (low, high), (was_low, was_high) = _box(after), _box(before)
    middle, half = np.array(room.bounds_center), np.array(room.bounds_size) / 2
    below, above = np.minimum(was_low, middle - half), np.maximum(was_high, middle + half)
    if (low < below).any() or (high > above).any():
        return "the room's wall"
    objects = after.objects
    fresh = met_by(objects, low, high) & ~met_by(before.objects, was_low, was_high)
    for object_id in (held, *after.in_hand):
        fresh[objects.rows[object_id]] = False
    rows = np.flatnonzero(fresh)
    return None if not len(rows) else list(objects.values())[rows[0]].name


def _box(state: WorldState) -> tuple[Floats, Floats]:
    thing = state.objects[state.held or ""]
    center, half = np.array(thing.center), np.array(thing.size) / 2 - _CLOSE_M
    return center - half, center + half
