"""Move and turn what is in the hand, which stays there; push what is not.

There is no physics, only a slide: a pushing force acts for one physics step and friction ends it;
the thing keeps its height and its turn, stops before the first box in its way, at the edge of what
it lies on, at the room's wall and at the agent, and takes along what lies in it.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np

from karma.contracts import Vec3
from karma.household.places import FLOOR
from karma.world.actions.aiming import on_object
from karma.world.actions.moving import hang
from karma.world.core.arguments import Place
from karma.world.core.boxes import Floats, crossing
from karma.world.core.hiding import inert_rows, solid_boxes
from karma.world.core.posing import angles, met_by, rotation_matrix, spun, vector, with_contents
from karma.world.core.scene import SceneObject
from karma.world.core.state import BODY_M, Performed, Refusal, Result, WorldState
from karma.world.core.thing import heading, is_loose, moved
from karma.world.core.view import camera, camera_axes, in_picture

_EMPTY = "Agent is not holding anything in its hand."
_CLOSE_M = 0.01
_PUSH_S = 0.02  # for which the force acts
_BRAKE_MS2 = 2 * 0.5 * 9.81  # twice the braking by friction
_LIGHTEST_KG = 0.05
_LONGEST_M = 3.0
_GAP_M = 0.002  # left between a thing and what stops it


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


# ----------------------------------------------------------------- pushing


def pusher(action: str, angle: float) -> Callable[..., Result]:
    """Return the action that pushes in a direction relative to the agent's yaw."""

    @on_object(action)
    def push(state: WorldState, thing: SceneObject, *, moveMagnitude: float = 0.0) -> Result:
        return _push(state, thing, moveMagnitude, angle)

    return push


@on_object("DirectionalPush")
def directional_push(
    state: WorldState, thing: SceneObject, *, moveMagnitude: float = 0.0, pushAngle: float = 0.0
) -> Result:
    """Push in a direction given in degrees clockwise from where the agent looks."""
    return _push(state, thing, moveMagnitude, pushAngle % 360)


def _push(state: WorldState, thing: SceneObject, newtons: float, angle: float) -> Result:
    if thing.id in state.in_hand:
        return Refusal("Please use Throw for an item in the Agent's Hand")
    if not is_loose(thing):
        return Refusal(f"{thing.name} is neither pickupable nor moveable and cannot be pushed.")
    if newtons < 0:
        return Refusal("moveMagnitude must not be negative")
    speed = newtons * _PUSH_S / max(thing.mass_kg, _LIGHTEST_KG)
    far = min(speed**2 / _BRAKE_MS2, _LONGEST_M)
    x, z = heading(round((state.pose.yaw_deg + angle) % 360, 4))
    far = _slide(state, thing, np.array((x, z)), far)
    by = (round(x * far, 6), 0.0, round(z * far, 6))
    ids = (thing.id, *state.objects.carried(thing.id))
    changes = {object_id: moved(state.objects[object_id], by) for object_id in ids}
    return Performed(replace(state, objects=state.objects.changed(changes)))


def _slide(state: WorldState, thing: SceneObject, step: Floats, far: float) -> float:
    """Return how far a thing slides before something stops it, metres."""
    objects = state.objects
    center, half = np.array(thing.center), np.array(thing.size) / 2
    lies = objects.containment
    mine = {thing.id, *lies.inside(thing.id), *lies.around(thing.id), *state.in_hand}
    rows = [row for object_id, row in objects.rows.items() if object_id not in mine]
    low, high = (side[rows] for side in solid_boxes(objects))
    level = (low[:, 1] < center[1] + half[1] - 0.005) & (high[:, 1] > center[1] - half[1] + 0.005)
    level &= ~inert_rows(objects)[rows]
    flat = [0, 2]
    stops = _entries(center[flat], step, low[level][:, flat] - half[flat],
                     high[level][:, flat] + half[flat])  # fmt: skip
    ends = [far, _body(state, center[flat], half[flat], step), *stops]
    for edge_low, edge_high in _edges(state, thing):
        ends.append(_exit(center[flat], step, edge_low[flat], edge_high[flat]))
    return max(min(ends), 0.0)


def _entries(place: Floats, step: Floats, low: Floats, high: Floats) -> list[float]:
    """Return how far away grown boxes begin; those that a place is in already do not count."""
    enter, leave = crossing(place, step, low, high)
    outside = ~np.all((low < place) & (high > place), axis=1)
    found = enter[(enter < leave) & (enter > -_GAP_M) & outside]
    return [float(value) - _GAP_M for value in found]


def _exit(place: Floats, step: Floats, low: Floats, high: Floats) -> float:
    """Return how far away the edge of a box is from inside; 0 from outside."""
    if np.any(place < low) or np.any(place > high):
        return 0.0
    return float(crossing(place, step, low, high)[1])


def _edges(state: WorldState, thing: SceneObject) -> list[tuple[Floats, Floats]]:
    """Return the boxes that the thing's middle may not leave: the room, and what it lies on."""
    middle, size = np.array(state.room.bounds_center), np.array(state.room.bounds_size) / 2
    own = np.array(thing.size) / 2
    found = [(np.minimum(middle - size + own, thing.center),
              np.maximum(middle + size - own, thing.center))]  # fmt: skip
    parents = [state.objects[parent] for parent in thing.parents]
    found.extend(
        (np.minimum(np.array(p.center) - np.array(p.size) / 2, thing.center),
         np.maximum(np.array(p.center) + np.array(p.size) / 2, thing.center))
        for p in parents[:1] if p.type != FLOOR
    )  # fmt: skip
    return found


def _body(state: WorldState, place: Floats, half: Floats, step: Floats) -> float:
    """Return how far away the agent's body is, as a square; infinity when it is not in the way."""
    body = np.array((state.pose.position_m[0], state.pose.position_m[2]))
    reach = half + BODY_M
    found = _entries(place, step, (body - reach)[None], (body + reach)[None])
    return found[0] if found else math.inf
