"""Tell what of its box a loose thing fills: a bottle narrows to its neck, a laptop is mostly air.

Bands of the box from bottom to top, after how the type is drawn (`filled` of `rules.toml`), in the
thing's own frame: what lies aslant hides with its turned box, not with the upright one round it.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.contracts import Vec3
from karma.world.core.arrays import Flags, Floats, crossing
from karma.world.core.objects import Change, Derived, Objects
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.thing import heading

_ASLANT = 0.02  # off the room's axes, as a sine


class Silhouette(NamedTuple):
    """The filled parts of a box, and the way into the frame in which it reaches from -1 to 1."""

    middle: Floats  # shape (3,)
    into: Floats  # shape (3, 3), from the right on offsets from the middle
    low: Floats  # corners of the parts, shape (parts, 3)
    high: Floats


def _of_the_same(
    before: Objects, known: dict[int, Silhouette | None], change: Change
) -> dict[int, Silhouette | None]:
    if not change.moved:
        return known
    rows = {before.rows[thing.id] for _, thing in change.pairs}
    return {row: one for row, one in known.items() if row not in rows}


_silhouettes: Derived[dict[int, Silhouette | None]] = Derived(
    lambda objects: {}, patch=_of_the_same
)  # filled as boxes are met


def missed(objects: Objects, eye: Floats, ends: Floats, rows: NDArray[np.intp]) -> Flags:
    """Return which segments that meet the box of an object miss what fills it, shape (n,).

    Args:
        objects: of this moment.
        eye: where the segments begin, shape (3,).
        ends: where they end, shape (n, 3).
        rows: of the object whose box each meets, shape (n,).
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
