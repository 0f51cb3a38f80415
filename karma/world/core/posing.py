"""Put things into poses that no hand brings them to, and find what they lie in there."""

import math
from dataclasses import replace

import msgspec
import numpy as np

from karma.types.space import Vec3
from karma.world.core.arguments import Place
from karma.world.core.boxes import Floats
from karma.world.core.objects import Objects
from karma.world.core.placement import nested, parents_in
from karma.world.core.scene import SceneObject
from karma.world.core.state import HAND_M, WorldState
from karma.world.core.thing import corners, difference, moved, turned

_SAME_DEG = 1e-3


def vector(place: Place, usual: Vec3 = (0.0, 0.0, 0.0)) -> Vec3:
    """Return a place with what was left out filled in."""
    return (place.get("x", usual[0]), place.get("y", usual[1]), place.get("z", usual[2]))


def rotation_matrix(degrees: Vec3) -> Floats:
    """Return Unity's rotation by pitch, yaw and roll, shape (3, 3): roll first, then pitch, yaw."""
    (sx, sy, sz), (cx, cy, cz) = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    pitch = np.array([(1, 0, 0), (0, cx, -sx), (0, sx, cx)])
    yaw = np.array([(cy, 0, sy), (0, 1, 0), (-sy, 0, cy)])
    roll = np.array([(cz, -sz, 0), (sz, cz, 0), (0, 0, 1)])
    found: Floats = yaw @ pitch @ roll
    return found


def angles(matrix: Floats) -> Vec3:
    """Return pitch, yaw and roll of a rotation, each in [0, 360); roll is 0 looking straight down.

    >>> angles(rotation_matrix((90.0, 270.0, 270.0)))
    (90.0, 0.0, 0.0)
    """
    sine = float(np.clip(-matrix[1, 2], -1.0, 1.0))
    pitch = math.degrees(math.asin(sine))
    if abs(sine) > 1 - 1e-9:
        yaw, roll = math.degrees(math.atan2(-matrix[2, 0], matrix[0, 0])), 0.0
    else:
        yaw = math.degrees(math.atan2(matrix[0, 2], matrix[2, 2]))
        roll = math.degrees(math.atan2(matrix[1, 0], matrix[1, 1]))
    return (_degrees(pitch), _degrees(yaw), _degrees(roll))


def _degrees(value: float) -> float:
    return round(value % 360, 4) % 360


def hand_rotation(state: WorldState) -> Vec3:
    """Return how the hand is turned in the room: by the agent's yaw, and its own turn."""
    facing = rotation_matrix((0.0, state.pose.yaw_deg, 0.0))
    return angles(facing @ rotation_matrix(state.hand_turn_deg))


def posed(thing: SceneObject, position: Vec3, rotation: Vec3 | None = None) -> SceneObject:
    """Return a thing at a position, turned to a rotation; None = as it is turned."""
    rotation = thing.rotation if rotation is None else rotation
    rotation = (_degrees(rotation[0]), _degrees(rotation[1]), _degrees(rotation[2]))
    off = [abs(_half_turn(a - b)) for a, b in zip(rotation, thing.rotation, strict=True)]
    if max(off) > _SAME_DEG:
        if max(off[0], off[2]) > _SAME_DEG:
            delta = rotation_matrix(rotation) @ rotation_matrix(thing.rotation).T
            thing = spun(thing, delta, rotation)
        else:
            thing = turned(thing, _degrees(rotation[1] - thing.rotation[1]), thing.position)
    return moved(thing, difference(position, thing.position))


def _half_turn(degrees: float) -> float:
    return (degrees + 180) % 360 - 180


def spun(thing: SceneObject, delta: Floats, rotation: Vec3) -> SceneObject:
    """Return a thing turned about its position by a rotation, which leaves it at `rotation`."""
    origin = np.array(thing.position)
    there = (np.array(corners(thing)) - origin) @ delta.T + origin
    low, high = there.min(axis=0), there.max(axis=0)
    return msgspec.structs.replace(
        thing,
        rotation=rotation,
        corners=tuple(_rounded(corner) for corner in there),
        center=_rounded((low + high) / 2),
        size=_rounded(high - low),
    )


def _rounded(point: Floats) -> Vec3:
    x, y, z = (round(float(value), 6) for value in point)
    return (x, y, z)


# ----------------------------------------------------------------- what it lies in


def with_contents(objects: Objects, there: SceneObject) -> Objects:
    """Return the objects with one of them elsewhere, and what it carries with it."""
    thing = objects[there.id]
    turn = there.rotation[1] - thing.rotation[1]
    by = difference(there.position, thing.position)
    carried = objects.carried(there.id)
    mine = {there.id, *carried}
    changes = {there.id: there}
    for child in carried:
        inner = moved(turned(objects[child], turn, thing.position), by)
        own = tuple(parent for parent in inner.parents if parent in mine)
        changes[child] = msgspec.structs.replace(inner, parents=own)
    objects = objects.changed(changes)
    for child in carried:
        inner = objects[child]
        objects = objects.changed({child: nested(objects, inner)})
    return objects


def emptied(state: WorldState) -> WorldState:
    """Return the state with nothing in the hand, and the hand at rest."""
    return replace(state, held=None, hand_m=HAND_M, hand_turn_deg=(0.0, 0.0, 0.0))


def released(state: WorldState, middle: Vec3, holder: str | None) -> WorldState:
    """Return the state with the held object, and what it carries, let go somewhere."""
    thing = state.objects[state.held or ""]
    objects = state.objects
    by = difference(middle, thing.center)
    changes = {child: moved(objects[child], by) for child in objects.carried(thing.id)}
    there = msgspec.structs.replace(moved(thing, by), is_picked_up=False)
    parents = () if holder is None else parents_in(objects, there, holder)
    changes[thing.id] = msgspec.structs.replace(there, parents=parents)
    objects = objects.changed(changes)
    changes = {c: nested(objects, objects[c]) for c in objects.carried(thing.id)}
    return replace(emptied(state), objects=objects.changed(changes))
