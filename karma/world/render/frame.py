"""Find how an object stands: its own axes, its sides along them, and its front."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.contracts import Vec3
from karma.world.core.rays import own_frame
from karma.world.core.scene import SceneObject

Front = Literal["turn", "room", "thin", "long"]
Floats = NDArray[np.float64]

REACH_M = 0.55  # the place before a front is this far from it
OWN_M = 0.2  # how much less free the side may be that the object's own turn names


class ObjectFrame(NamedTuple):
    """An upright or lying box: axes x, y, z as rows, the middle of its lower side, its sides."""

    axes: Floats  # (3, 3)
    foot: Floats  # (3,)
    size: Vec3  # along the own axes: width, height, depth


def frame(thing: SceneObject, cells: Floats, *, front: Front, laid: bool) -> ObjectFrame:
    """Return the frame of an object among cells (x, z) where an agent can stand, shape (n, 2).

    Its front is where its yaw points ("turn"), or the side before which an agent can best stand
    ("room"), among those across the thinner ("thin") or along the longer side ("long"). What is
    laid has its longest side as depth and its shortest as height, as cutlery.
    """
    axes, size = own_frame(thing)
    if laid:
        axes, size = _sorted(axes, size)
    middle = np.array(thing.center)
    if thing.corners is not None:
        middle = np.array(thing.corners).mean(axis=0)
    quarters = _choices(size, front)
    if len(quarters) > 1 and len(cells):
        turn = _best(axes, size, middle, quarters, cells)
        axes, size = _quarter(axes, size, turn)
    elif quarters:
        axes, size = _quarter(axes, size, quarters[0])
    return ObjectFrame(axes, middle - axes[1] * size[1] / 2, size)


def _sorted(axes: Floats, size: Vec3) -> tuple[Floats, Vec3]:
    thin, middle, long = np.argsort(size, kind="stable")
    up = axes[thin] * (1.0 if axes[thin][1] >= 0 else -1.0)
    along = axes[long]
    return np.array([np.cross(up, along), up, along]), (size[middle], size[thin], size[long])


def _quarter(axes: Floats, size: Vec3, turn: int) -> tuple[Floats, Vec3]:
    """Return the frame seen from the side that a number of quarter turns names."""
    x, y, z = axes
    w, h, d = size
    turned = ((x, y, z), (-z, y, x), (-x, y, -z), (z, y, -x))[turn]
    return np.array(turned), ((w, h, d) if turn % 2 == 0 else (d, h, w))


def _choices(size: Vec3, front: Front) -> tuple[int, ...]:
    if front == "turn":
        return ()
    wide = size[0] >= size[2]
    if front == "room":
        return (0, 1, 2, 3)
    if front == "thin":
        return (0, 2) if wide else (1, 3)
    return (1, 3) if wide else (0, 2)


def _best(
    axes: Floats, size: Vec3, middle: Floats, quarters: tuple[int, ...], cells: Floats
) -> int:  # fmt: skip
    """Return the quarter turn whose front has cells nearest; the own one if nearly as good."""
    gaps = []
    for turn in quarters:
        facing, (_, _, depth) = _quarter(axes, size, turn)
        place = middle + facing[2] * (depth / 2 + REACH_M)
        gaps.append(float(np.hypot(*(cells - place[[0, 2]]).T).min()))
    best = min(gaps)
    if quarters[0] == 0 and gaps[0] <= best + OWN_M:
        return 0
    return quarters[gaps.index(best)]
