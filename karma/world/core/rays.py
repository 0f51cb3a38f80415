"""Shoot rays at boxes: which are met, and which of them let the ray pass all the same.

A box is coarser than what fills it. A ray that meets one goes on through a worktop where a basin
is let in, or where the box of a bent one spans floor that people walk on, and past a loose thing
whose silhouette it misses (`silhouettes.py`).
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.world.core.arrays import Flags, Floats, crossing
from karma.world.core.hiding import solid_boxes
from karma.world.core.holes import holes_by_row
from karma.world.core.objects import Objects
from karma.world.core.silhouettes import missed

Rows = NDArray[np.intp]


class WallBoxes(NamedTuple):
    """The walls between rooms; they hide what is behind them and are no objects."""

    low: Floats  # shape (walls, 3)
    high: Floats

    def hide(self, eye: Floats, ends: Floats) -> Flags:
        """Return which points, shape (n, 3), cannot be seen from an eye for a wall."""
        hidden = np.zeros(len(ends), dtype=bool)
        gap = np.maximum(np.maximum(self.low - eye, eye - self.high), 0.0)[:, [0, 2]]
        within = np.hypot(gap[:, 0], gap[:, 1]) <= farthest(eye, ends)
        if not within.any():
            return hidden
        low, high = self.low[within], self.high[within]
        point, wall = np.nonzero(perhaps_cut(eye, ends, low, high))
        hidden[point[cut(eye, ends[point], low[wall], high[wall])]] = True
        return hidden


class RoomShell(NamedTuple):
    """What hides or shows, and is no object; the same for all moments of a room."""

    walls: WallBoxes | None = None  # between rooms
    walked: Mapping[str, Floats] = MappingProxyType({})  # see `holes.walked_in`

    def hides(self, eye: Floats, ends: Floats) -> Flags:
        """Return which points, shape (n, 3), are behind a wall."""
        if self.walls is None:
            return np.zeros(len(ends), dtype=bool)
        return self.walls.hide(eye, ends)


NO_SHELL = RoomShell()


def stopped(
    objects: Objects, eye: Floats, ends: Floats, rows: Rows, hides: Flags, shell: RoomShell
) -> tuple[Rows, Rows]:
    """Return which segments which objects stop, as pairs: a segment's number, an object's row.

    Args:
        objects: of this moment.
        eye: where the segments begin, shape (3,).
        ends: where they end, shape (segments, 3).
        rows: of the objects that may stop them, shape (n,).
        hides: whether each may, shape (segments, n), or what broadcasts to it.
        shell: of the room.
    """
    low, high = (corners[rows] for corners in solid_boxes(objects))
    ray, box = np.nonzero(perhaps_cut(eye, ends, low, high) & hides)
    hits = cut(eye, ends[ray], low[box], high[box])
    ray, row = ray[hits], rows[box[hits]]
    passes = _through_holes(objects, eye, ends[ray], row, shell.walked)
    passes |= missed(objects, eye, ends[ray], row)
    return ray[~passes], row[~passes]


def _through_holes(
    objects: Objects, eye: Floats, ends: Floats, rows: Rows, walked: Mapping[str, Floats]
) -> Flags:
    """Return which rays pass their boxes where a basin is let in, or people walk, shape (n,)."""
    found: Flags = np.zeros(len(rows), dtype=bool)
    low, high = solid_boxes(objects)
    for row, grounds in _open_grounds(objects, walked).items():
        mine = np.flatnonzero(rows == row)
        if not len(mine):
            continue
        along = ends[mine] - eye
        inside = np.ones(len(mine), dtype=bool)
        for part in crossing(eye, along, low[row], high[row]):
            place = (eye + along * np.clip(part, 0.0, 1.0)[:, None])[:, None, [0, 2]]
            there = np.all((place >= grounds[:, :2]) & (place <= grounds[:, 2:]), axis=2)
            inside &= there.any(axis=1)
        found[mine] = inside
    return found


def _open_grounds(objects: Objects, walked: Mapping[str, Floats]) -> Mapping[int, Floats]:
    basins = holes_by_row(objects)
    if not walked:
        return basins
    found = dict(basins)
    for object_id, grounds in walked.items():
        row = objects.rows.get(object_id)
        if row is not None:
            found[row] = np.concatenate([basins[row], grounds]) if row in basins else grounds
    return found


def cut(starts: Floats, ends: Floats, low: Floats, high: Floats) -> Flags:
    """Return which segments pass through their boxes, shape (n,); a box at the end does not count.

    Args:
        starts: shape (n, 3), or (3,) when shared.
        ends: shape (n, 3).
        low: lower box corners, shape (n, 3), or (3,) when shared.
        high: upper box corners, likewise.
    """
    enter, leave = crossing(starts, ends - starts, low, high)
    passes: Flags = (np.maximum(enter, 0.0) < np.minimum(leave, 1.0)) & (enter < 0.999)
    return passes


def perhaps_cut(eye: Floats, ends: Floats, low: Floats, high: Floats) -> Flags:
    """Return which segments come near which boxes' bounding spheres, shape (segments, boxes).

    Quick; never False where `cut` is True.
    """
    along = (ends - eye).astype(np.float32)
    far = np.sqrt((along**2).sum(axis=1, keepdims=True))
    along /= np.maximum(far, 1e-6)
    middle = ((low + high) / 2 - eye).astype(np.float32)
    radius = (np.sqrt(((high - low) ** 2).sum(axis=1)) / 2 + 1e-3).astype(np.float32)
    on_way = along @ middle.T  # of each box's middle, from the eye
    room = (middle**2).sum(axis=1) - radius**2
    near: Flags = (on_way**2 > room) & (on_way > -radius) & (on_way < far + radius)
    return near


def farthest(eye: Floats, ends: Floats) -> float:
    """Return how far the farthest of some points is from an eye across the floor, and a little."""
    away = ends - eye
    return float(np.hypot(away[:, 0], away[:, 2]).max(initial=0.0)) + 1e-6
