"""Push things along what they stand on; there is no physics, only a slide.

A force acts for one physics step and friction ends the slide; the thing keeps its height and its
turn, stops before the first box in its way, at the edge of what it lies on, at the room's wall and
at the agent, and takes along what lies in it.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from karma.household.places import FLOOR
from karma.world.actions.aiming import on_object
from karma.world.core.boxes import Floats, crossing
from karma.world.core.hiding import inert_rows, solid_boxes
from karma.world.core.scene import SceneObject
from karma.world.core.state import BODY_M, Performed, Refusal, Result, WorldState
from karma.world.core.thing import heading, is_loose, moved

_PUSH_S = 0.02  # for which the force acts
_BRAKE_MS2 = 2 * 0.5 * 9.81  # twice the braking by friction
_LIGHTEST_KG = 0.05
_LONGEST_M = 3.0
_GAP_M = 0.002  # left between a thing and what stops it


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
