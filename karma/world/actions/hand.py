"""Move and turn what is in the hand, which stays there."""

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np

from karma.types.space import Vec3
from karma.world.actions.moving import hang
from karma.world.core.arguments import Place
from karma.world.core.posing import angles, rotation_matrix, spun, vector, with_contents
from karma.world.core.state import Performed, Refusal, Result, WorldState
from karma.world.core.view import camera, camera_axes, in_picture

_EMPTY = "Agent is not holding anything in its hand."


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
    return Performed(replace(after, objects=hang(after, state.held, 0.0)))


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
    objects = with_contents(state.objects, there)
    return Performed(replace(state, objects=objects, hand_turn_deg=angles(wanted)))
