"""Put things into poses that no hand brings them to, and find what they lie in there."""

import math
from dataclasses import replace

import msgspec
import numpy as np

from karma.contracts import Vec3
from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.world.core.arguments import Place
from karma.world.core.boxes import Flags, Floats
from karma.world.core.hiding import inert_rows, solid_boxes
from karma.world.core.objects import Objects
from karma.world.core.placement import floor_id, land, nested, parents_in
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.state import HAND_M, Refusal, WorldState
from karma.world.core.thing import bottom, corners, difference, is_inert, moved, top, turned

_SAME_M, _SAME_DEG = 1e-4, 1e-3
_LEVEL_M = 0.06  # a thing whose bottom is so near to a surface lies on it
_SEAT = 0.3  # share of a box that is below any surface in it: under a table is not on it
_CLOSE_M = 0.01  # boxes that overlap by less do not collide
_ON_FLOOR_M = 0.1


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


def same_pose(thing: SceneObject, there: SceneObject) -> bool:
    """Return whether two moments of a thing have the same pose."""
    off = max(abs(a - b) for a, b in zip(thing.position, there.position, strict=True))
    pairs = zip(thing.rotation, there.rotation, strict=True)
    return off <= _SAME_M and max(abs(_half_turn(a - b)) for a, b in pairs) <= _SAME_DEG


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


def holder_of(objects: Objects, thing: SceneObject) -> str | None:
    """Return the smallest receptacle that a thing lies in or on where it is, by their boxes."""
    mine = {thing.id, *objects.containment.inside(thing.id)}
    found = [
        (other.size[0] * other.size[1] * other.size[2], other.id)
        for other in objects.values()
        if "receptacle" in other.capabilities
        and other.id not in mine
        and other.type != FLOOR
        and not is_inert(other)
        and _takes(other, thing)
    ]
    return min(found)[1] if found else None


def _takes(other: SceneObject, thing: SceneObject) -> bool:
    """Return whether a thing is where the contents of a receptacle lie."""
    if any(abs(thing.center[k] - other.center[k]) > other.size[k] / 2 for k in (0, 2)):
        return False
    low, high, level = bottom(other), top(other), bottom(thing)
    if only := object_types()[other.type].accepts_only:  # towels hang, and mugs stand, anywhere
        return thing.type in only and level < high + _LEVEL_M and top(thing) > low
    rim = high - low <= _LEVEL_M or other.type in rules().put.open_top
    if rim or other.type in rules().put.inside:
        return low - _LEVEL_M / 2 <= level <= high + (_LEVEL_M if rim else -_LEVEL_M) / 2
    return low + (high - low) * _SEAT <= level <= high + _LEVEL_M


def let_lie(state: WorldState, there: SceneObject, *, falls: bool) -> WorldState:
    """Return the state with a thing put in a new pose, out of any hand, lying in what is there.

    With nothing below, it `falls` or stays in the air.
    """
    without = replace(state, held=there.id)  # it is in nobody's way, least of all its own
    holder = holder_of(state.objects, there)
    if holder is None and falls:
        middle, holder = land(without, there, there.center[0], there.center[2])
        there = moved(there, difference(middle, there.center))
    elif holder is None and bottom(there) <= state.room.floor_y + _ON_FLOOR_M:
        holder = floor_id(state.objects)
    if holder is not None and holder in state.objects.containment.inside(there.id):
        holder = None
    parents = () if holder is None else parents_in(state.objects, there, holder)
    there = msgspec.structs.replace(there, parents=parents, is_picked_up=False)
    objects = with_contents(state.objects, there)
    return replace(state if state.held != there.id else emptied(state), objects=objects)


def emptied(state: WorldState) -> WorldState:
    """Return the state with nothing in the hand, and the hand at rest."""
    return replace(state, held=None, hand_m=HAND_M, hand_turn_deg=(0.0, 0.0, 0.0))


def collision(state: WorldState, there: SceneObject) -> Refusal | None:
    """Return what a thing would be stuck in at a place, or that it is outside the room."""
    middle, size = state.room.bounds_center, state.room.bounds_size
    if any(abs(there.center[k] - middle[k]) > size[k] / 2 + _CLOSE_M for k in range(3)):
        return Refusal(f"{there.name} would be outside the scene's bounds.")
    hit = stuck_in(state, there)
    return None if hit is None else Refusal(f"{there.name} is colliding with {hit} at that place.")


def stuck_in(state: WorldState, there: SceneObject) -> str | None:
    """Return the name of the first object whose solid part a thing overlaps; None when free."""
    objects = state.objects
    holder = holder_of(objects, there)
    mine = {there.id, *objects.containment.inside(there.id), *state.in_hand}
    if holder is not None:
        mine.update((holder, *objects.containment.around(holder)))
    half = np.maximum(np.array(there.size) / 2 - _CLOSE_M, 0.0)
    center = np.array(there.center)
    ids = list(objects)
    for row in np.flatnonzero(met_by(objects, center - half, center + half)):
        if ids[row] not in mine and objects[ids[row]].type != FLOOR:
            return objects[ids[row]].name
    return None


def met_by(objects: Objects, low: Floats, high: Floats) -> Flags:
    """Return which objects' solid parts a box overlaps, shape (n,)."""
    solid_low, solid_high = solid_boxes(objects)
    overlap: Flags = np.all((solid_low < high) & (solid_high > low), axis=1)
    return overlap & ~inert_rows(objects)
