"""Measure, move and turn one object, and tell whether it is still whole."""

import math
from typing import Any

import msgspec

from karma.types.space import Vec3
from karma.world.core.boxes import Box
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject

GRAVITY_MS2 = 9.81


def box_of(thing: SceneObject) -> Box:
    """Return the box of a thing."""
    return Box.around(thing.center, thing.size)


def is_loose(thing: SceneObject) -> bool:
    """Return whether a thing can be carried or pushed."""
    return "pickupable" in thing.capabilities or "moveable" in thing.capabilities


def is_inert(thing: SceneObject) -> bool:
    """Return whether an object is only kept for its id: sliced, or broken to pieces."""
    return thing.is_sliced or (thing.is_broken and shatters(thing))


def is_movable(thing: SceneObject) -> bool:
    """Return whether a thing is there to be carried."""
    return "pickupable" in thing.capabilities and not is_inert(thing)


def shatters(thing: SceneObject) -> bool:
    """Return whether only pieces are left of an object that breaks; screens and panes stay."""
    return "pickupable" in thing.capabilities and thing.type not in rules().fragile.stays_whole


def is_shut(thing: SceneObject) -> bool:
    """Return whether an object is closed, so that what lies in it is hidden."""
    return thing.type in rules().view.hides_when_closed and thing.openness <= 0


def moved(thing: SceneObject, by: Vec3) -> SceneObject:
    """Return the object shifted by a vector."""
    return msgspec.structs.replace(
        thing,
        position=_add(thing.position, by),
        center=_add(thing.center, by),
        corners=None if thing.corners is None else tuple(_add(c, by) for c in thing.corners),
    )


def turned(thing: SceneObject, degrees: float, about: Vec3) -> SceneObject:
    """Return the object turned round a vertical axis; clockwise seen from above, as yaw."""
    if degrees % 360 == 0:
        return thing
    x, y, z = thing.rotation
    change: dict[str, Any] = {
        "rotation": (x, (y + degrees) % 360, z),
        "position": _turn(thing.position, degrees, about),
        "center": _turn(thing.center, degrees, about),
    }
    if thing.corners is not None:
        corners = tuple(_turn(corner, degrees, about) for corner in thing.corners)
        low = [min(c[axis] for c in corners) for axis in range(3)]
        high = [max(c[axis] for c in corners) for axis in range(3)]
        change["corners"] = corners
        change["center"] = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
        change["size"] = tuple(b - a for a, b in zip(low, high, strict=True))
    elif round(degrees / 90) % 2:
        change["size"] = (thing.size[2], thing.size[1], thing.size[0])
    return msgspec.structs.replace(thing, **change)


def corners(thing: SceneObject) -> tuple[Vec3, ...]:
    """Return the oriented box, its lower side first, each side in turn."""
    if thing.corners is not None:
        return thing.corners
    (x, y, z), (sx, sy, sz) = thing.center, thing.size
    low = y - sy / 2
    ring = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return tuple((x + i * sx / 2, low + up, z + k * sz / 2) for up in (0.0, sy) for i, k in ring)


def difference(a: Vec3, b: Vec3) -> Vec3:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def gaps(thing: SceneObject, x: float, z: float) -> tuple[float, float]:
    """Return how far a place is from a box across the floor, along x and along z; 0 within."""
    along_x = max(abs(x - thing.center[0]) - thing.size[0] / 2, 0.0)
    return along_x, max(abs(z - thing.center[2]) - thing.size[2] / 2, 0.0)


def bottom(thing: SceneObject) -> float:
    """Return the height of the box's lower side, metres."""
    return thing.center[1] - thing.size[1] / 2


def top(thing: SceneObject) -> float:
    """Return the height of the box's upper side, metres."""
    return thing.center[1] + thing.size[1] / 2


def _add(a: Vec3, b: Vec3) -> Vec3:
    return (round(a[0] + b[0], 6), round(a[1] + b[1], 6), round(a[2] + b[2], 6))


def _turn(point: Vec3, degrees: float, about: Vec3) -> Vec3:
    sine, cosine = heading(degrees)
    x, z = point[0] - about[0], point[2] - about[2]
    return (about[0] + x * cosine + z * sine, point[1], about[2] + z * cosine - x * sine)


def heading(yaw_deg: float) -> tuple[float, float]:
    """Return (x, z) of the direction a yaw points to; exact for multiples of 90.

    >>> heading(90), heading(-1e-15)
    ((1.0, 0.0), (0.0, 1.0))
    """
    quarter, rest = divmod(yaw_deg % 360, 90)
    if rest == 0:
        return [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][int(quarter) % 4]
    return math.sin(math.radians(yaw_deg)), math.cos(math.radians(yaw_deg))
