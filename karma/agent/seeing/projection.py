"""From the world to a picture by the camera's own pose.

Where an object's box shows is a perception aid. It needs coordinates and the camera, which every
world gives (KARMA §3.4: "acquired through a simulator"), and no segmentation; it tells nothing of
an object's state. What was looked at is told by the same geometry: which points of a space were in
view, and not behind a thing seen there.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from karma.household.places import FLOOR, ROUND_A_CORNER
from karma.household.types import object_types
from karma.types.observation import SeenObject
from karma.types.space import CameraPose, Point, Region, Vec3

NEAR_M = 0.05
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b).bit_count() == 1]


def placed(sight: SeenObject, camera: CameraPose, box: SeenObject | None = None) -> SeenObject:
    """Return a sight with its region and silhouette in the camera's frame.

    `box` is the sight whose box is projected, if it is another one.
    """
    center_m, size_m = (box or sight).box_center_m, (box or sight).box_size_m
    return replace(
        sight,
        region=region_of(camera, center_m, size_m),
        silhouette=silhouette_of(camera, center_m, size_m),
    )


def region_of(camera: CameraPose, center_m: Vec3, size_m: Vec3) -> Region | None:
    """Return where an upright box is in the frame: left, top, right, bottom; pixels, clipped.

    None when it is out of the frame.
    """
    points = _points(camera, center_m, size_m)
    if not len(points):
        return None
    left, right = np.clip([points[:, 0].min(), points[:, 0].max()], 0, float(camera.width_px))
    top, bottom = np.clip([points[:, 1].min(), points[:, 1].max()], 0, float(camera.height_px))
    if right - left < 1 or bottom - top < 1:
        return None
    left, top, right, bottom = (round(float(side), 1) for side in (left, top, right, bottom))
    return left, top, right, bottom


def silhouette_of(camera: CameraPose, center_m: Vec3, size_m: Vec3) -> tuple[Point, ...]:
    """Return the corners of what an upright box covers in the frame, in order; pixels, unclipped.

    () when it is behind the camera.
    """
    points = _points(camera, center_m, size_m)
    ordered = sorted({(round(float(x), 1), round(float(y), 1)) for x, y in points})
    return (*_chain(ordered), *_chain(ordered[::-1]))


def axes_of(camera: CameraPose) -> NDArray[np.float64]:
    """Return a camera's axes in the world: rows right, up and forward, shape (3, 3)."""
    yaw, pitch = np.radians([camera.yaw_deg, camera.horizon_deg])
    return np.array(
        [
            (np.cos(yaw), 0.0, -np.sin(yaw)),
            (np.sin(yaw) * np.sin(pitch), np.cos(pitch), np.cos(yaw) * np.sin(pitch)),
            (np.sin(yaw) * np.cos(pitch), -np.sin(pitch), np.cos(yaw) * np.cos(pitch)),
        ]
    )


def _points(camera: CameraPose, center_m: Vec3, size_m: Vec3) -> np.ndarray:
    """Return where a box's corners are in the frame, shape (n, 2), pixels."""
    axes = axes_of(camera)
    signs = np.array([[(i >> axis) & 1 for axis in range(3)] for i in range(8)]) - 0.5
    corners = np.asarray(center_m) + signs * np.asarray(size_m) - np.asarray(camera.position_m)
    points = _before(corners @ axes.T).reshape(-1, 3)
    width, height = float(camera.width_px), float(camera.height_px)
    scale = height / 2 / np.tan(np.radians(camera.fov_deg) / 2)
    x = width / 2 + points[:, 0] / points[:, 2] * scale
    y = height / 2 - points[:, 1] / points[:, 2] * scale
    return np.stack([x, y], axis=1)


def _chain(points: Sequence[Point]) -> list[Point]:
    """Return one side of the hull of ordered points, without its last point (Andrew, 1979)."""
    found: list[Point] = []
    for x, y in points:
        while len(found) > 1:
            (x0, y0), (x1, y1) = found[-2:]
            if (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0):
                break
            found.pop()
        found.append((x, y))
    return found[:-1]


def _before(corners: np.ndarray) -> np.ndarray:
    """Return a box's corners before the camera, and where its edges come through the near plane."""
    found = [corner for corner in corners if corner[2] >= NEAR_M]
    for a, b in _EDGES:
        one, other = corners[a], corners[b]
        if (one[2] < NEAR_M) != (other[2] < NEAR_M):
            share = (NEAR_M - one[2]) / (other[2] - one[2])
            found.append(one + share * (other - one))
    return np.array(found)


# ----------------------------------------------------------------- what was looked at

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
