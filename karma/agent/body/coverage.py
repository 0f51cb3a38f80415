"""What was looked at: which points of a space were in view, and not behind a thing seen there."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from karma.contracts import CameraPose, SeenObject, Vec3
from karma.household.places import FLOOR, ROUND_A_CORNER
from karma.household.types import object_types

_STEP_M = 0.35  # between points of a space: the smaller things of a home are no smaller apart
_INSET_M = 0.05  # of the outer points from the sides
_BESIDE_M = 0.06  # between boxes that adjoin
_MARGIN = 0.95  # of the picture: at its very edge only a part of a thing is in view

_Floats = NDArray[np.float64]
_Flags = NDArray[np.bool_]


def spots(space: SeenObject, *, inside: bool) -> list[Vec3]:
    """Return points of what holds things: all through it, or just above its top."""
    center, size = space.box_center_m, space.box_size_m
    x, y, z = (_along(middle, length) for middle, length in zip(center, size, strict=True))
    levels = y if inside else [center[1] + size[1] / 2 + 0.03]
    return [(a, b, c) for a in x for b in levels for c in z]


def _along(middle: float, length: float) -> list[float]:
    """Return evenly spread places along one side of a box."""
    half = max(length / 2 - _INSET_M, 0.0)
    count = math.ceil(2 * half / _STEP_M) + 1 if half else 1
    return [float(one) for one in np.linspace(middle - half, middle + half, count)]


def unseen(
    points: Sequence[Vec3],
    cameras: Iterable[CameraPose],
    things: Iterable[SeenObject],
    *,
    reach_m: float,
) -> list[Vec3]:
    """Return the points that no camera showed.

    Behind a thing nothing shows; `reach_m` is across the floor.
    """
    rest = np.array(points, dtype=np.float64).reshape(-1, 3)
    boxes = [(one.box_center_m, one.box_size_m) for one in things]
    center, size = np.array(boxes, dtype=np.float64).reshape(-1, 2, 3).swapaxes(0, 1)
    for camera in cameras:
        if not len(rest):
            break
        eye = np.array(camera.position_m)
        shown = _in_picture(rest - eye, camera, reach_m)
        shown[shown] &= _clear(eye, rest[shown], center - size / 2, center + size / 2)
        rest = rest[~shown]
    return [(float(x), float(y), float(z)) for x, y, z in rest]


def before(
    space: SeenObject, things: Iterable[SeenObject], *, inside: bool, surely: bool = True
) -> list[SeenObject]:
    """Return which things may hide a part of what holds things, or of its inside.

    `surely` leaves out what is built in beside an inside, whose front is open, whatever its box
    says, and what may be bent, whose box is free in a corner.
    """
    others = [one for one in things if one.object_id != space.object_id]
    if not surely:
        return [one for one in others if one.object_type != FLOOR]
    outer = (FLOOR, *ROUND_A_CORNER)
    return [
        one
        for one in others
        if one.pickupable
        or object_types()[one.object_type].can("moveable")
        or (one.object_type not in outer and not (inside and _adjoins(one, space)))
    ]


def _adjoins(one: SeenObject, other: SeenObject) -> bool:
    sides = zip(one.box_center_m, one.box_size_m, other.box_center_m, other.box_size_m, strict=True)
    return all(abs(a - b) <= (m + n) / 2 + _BESIDE_M for a, m, b, n in sides)


def _in_picture(offsets: _Floats, camera: CameraPose, reach_m: float) -> _Flags:
    """Return which points, shape (n, 3) from the eye, a camera has in its picture and in reach."""
    yaw, dip = math.radians(camera.yaw_deg), math.radians(camera.horizon_deg)
    east, north = math.sin(yaw), math.cos(yaw)
    forward = offsets @ (east * math.cos(dip), -math.sin(dip), north * math.cos(dip))
    right = offsets @ (north, 0.0, -east)
    up = offsets @ (east * math.sin(dip), math.cos(dip), north * math.sin(dip))
    wide = forward * math.tan(math.radians(camera.fov_deg) / 2) * _MARGIN
    near: _Flags = np.hypot(offsets[:, 0], offsets[:, 2]) <= reach_m
    aspect = camera.width_px / camera.height_px
    return near & (forward > 0) & (abs(right) < wide * aspect) & (abs(up) < wide)


def _clear(eye: _Floats, points: _Floats, low: _Floats, high: _Floats) -> _Flags:
    """Return which points no box is before; one that a point lies in hides it not."""
    along = (points - eye)[:, None, :]
    along = np.where(np.abs(along) < 1e-9, 1e-9, along)
    ends = (low - eye) / along, (high - eye) / along
    enter, leave = np.minimum(*ends).max(axis=-1), np.maximum(*ends).min(axis=-1)
    hidden: _Flags = ((enter < leave) & (leave > 0.0) & (leave < 1.0)).any(axis=1)
    return ~hidden
