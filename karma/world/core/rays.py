"""Shoot rays at boxes: which are met, and which of them let the ray pass all the same.

A box is coarser than what fills it. A ray that meets one goes on through a worktop where a basin
is let in, or where the box of a bent one spans floor that people walk on, and past a loose thing
whose silhouette it misses: bands of its box from bottom to top, after how the type is drawn
(`filled` of `rules.toml`), in the thing's own frame, so that what lies aslant hides with its turned
box and not with the upright one round it.
"""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.types.space import Vec3
from karma.world.core.boxes import Flags, Floats, crossing
from karma.world.core.ground import outside
from karma.world.core.hiding import holes_by_row, solid_boxes
from karma.world.core.objects import Derived, Objects
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.thing import heading

Rows = NDArray[np.intp]


class RoomShell(NamedTuple):
    """What hides or shows, and is no object; the same for all moments of a room."""

    low: Floats = np.empty((0, 3))  # of the walls between rooms
    high: Floats = np.empty((0, 3))
    walked: Mapping[str, Floats] = MappingProxyType({})  # see `holes.walked_in`

    def hides(self, eye: Floats, ends: Floats) -> Flags:
        """Return which points, shape (n, 3), are behind a wall."""
        hidden = np.zeros(len(ends), dtype=bool)
        if len(self.low):
            across = [0, 2]
            within = outside(self.low[:, across], self.high[:, across], eye[across]) <= farthest(
                eye, ends
            )
            low, high = self.low[within], self.high[within]
            point, wall = np.nonzero(perhaps_cut(eye, ends, low, high))
            hidden[point[cut(eye, ends[point], low[wall], high[wall])]] = True
        return hidden


NO_SHELL = RoomShell()


def stopped(
    objects: Objects, eye: Floats, ends: Floats, rows: Rows, hides: Flags, shell: RoomShell
) -> tuple[Rows, Rows]:
    """Return which segments which objects stop, as pairs: a segment's number, an object's row.

    Segments lead from an eye, shape (3,), to their ends, (segments, 3); `rows`, (n,), are of the
    objects that may stop them, `hides` says which may which: (segments, n), or broadcasts to it.
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

    All have shape (n, 3); starts and corners (3,) when shared.
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


# ----------------------------------------------------------------- silhouettes

_ASLANT = 0.02  # off the room's axes, as a sine


class Silhouette(NamedTuple):
    """The filled parts of a box, and the way into the frame in which it reaches from -1 to 1."""

    middle: Floats  # shape (3,)
    into: Floats  # shape (3, 3), from the right on offsets from the middle
    low: Floats  # corners of the parts, shape (parts, 3)
    high: Floats


# filled as boxes are met
_silhouettes: Derived[dict[int, Silhouette | None]] = Derived(lambda objects: {}, "place")


def missed(objects: Objects, eye: Floats, ends: Floats, rows: NDArray[np.intp]) -> Flags:
    """Return which segments that meet the box of an object miss what fills it, shape (n,).

    They lead from an eye, shape (3,), to their ends, (n, 3); `rows` says whose box each meets.
    """
    found: Flags = np.zeros(len(rows), dtype=bool)
    known, things = _silhouettes(objects), list(objects.values())
    for row in np.unique(rows).tolist():
        if row not in known:
            known[row] = silhouette(things[row])
        shape = known[row]
        if shape is not None:
            mine = rows == row
            start = (eye - shape.middle) @ shape.into
            along = (ends[mine] - eye) @ shape.into
            enter, leave = crossing(start, along[:, None], shape.low, shape.high)
            found[mine] = ~np.any(np.maximum(enter, 0.0) < np.minimum(leave, 1.0), axis=1)
    return found


def silhouette(thing: SceneObject) -> Silhouette | None:
    """Return what a thing fills of its box; None: it counts as full."""
    if "pickupable" not in thing.capabilities:
        return None
    bands = rules().view.filled.get(thing.type)
    if bands is None and thing.corners is None:
        return None
    axes, size = own_frame(thing)
    aslant = np.any((np.abs(axes) > _ASLANT) & (np.abs(axes) < 1 - _ASLANT))
    if bands is None and not aslant:
        return None
    middle = np.array(thing.corners or (thing.center,)).mean(axis=0)
    return Silhouette(middle, axes.T * 2 / np.array(size), *_parts(bands or ((1.0, 1.0),)))


@cache
def _parts(bands: tuple[tuple[float, ...], ...]) -> tuple[Floats, Floats]:
    """Return the corners of bands: each half a width, then half a depth or the depth's two ends."""
    rows = []
    for number, (x, *z) in enumerate(bands):
        y0, y1 = (2 * (number + step) / len(bands) - 1 for step in (0, 1))
        rows.append(((-x, y0, z[0] if len(z) > 1 else -z[0]), (x, y1, z[-1])))
    low, high = np.array(rows).transpose(1, 0, 2)
    return low, high


def own_frame(thing: SceneObject) -> tuple[Floats, Vec3]:
    """Return axes and sides; without an oriented box the nearest quarter turn tells."""
    if thing.corners is not None:
        c = np.array(thing.corners)
        edges = np.array([c[0] - c[1], c[4] - c[0], c[1] - c[2]])
        sides = np.linalg.norm(edges, axis=1)
        if sides.min() > 1e-6:
            x, y, z = sides
            return edges / sides[:, None], (float(x), float(y), float(z))
    yaw = round(thing.rotation[1] / 90) * 90.0
    x_z, z_z = heading(yaw)
    axes = np.array([(z_z, 0.0, -x_z), (0.0, 1.0, 0.0), (x_z, 0.0, z_z)])
    x, y, z = (max(side, 1e-3) for side in thing.size)
    return axes, ((z, y, x) if round(yaw / 90) % 2 else (x, y, z))
