"""Measure axis-aligned boxes: one at a time, or all objects' as arrays that rays meet."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.types.space import Vec3
from karma.world.core.scene import SceneObject


class Box(NamedTuple):
    """An axis-aligned box by its two corners, metres."""

    x0: float
    y0: float
    z0: float
    x1: float
    y1: float
    z1: float

    @classmethod
    def around(cls, center: Vec3, size: Vec3) -> "Box":
        """Return the box with this centre and size."""
        low = [c - s / 2 for c, s in zip(center, size, strict=True)]
        return cls(*low, *(a + s for a, s in zip(low, size, strict=True)))

    @classmethod
    def hull(cls, boxes: Iterable["Box"]) -> "Box":
        """Return the smallest box round some others, at least one."""
        x0, y0, z0, x1, y1, z1 = zip(*boxes, strict=True)
        return cls(min(x0), min(y0), min(z0), max(x1), max(y1), max(z1))

    @property
    def center(self) -> Vec3:
        """The middle of the box."""
        return ((self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2, (self.z0 + self.z1) / 2)

    @property
    def size(self) -> Vec3:
        """The sides of the box."""
        return (self.x1 - self.x0, self.y1 - self.y0, self.z1 - self.z0)

    def grown(self, x: float, y: float, z: float) -> "Box":
        """Return the box moved outwards on all sides."""
        return Box(
            self.x0 - x, self.y0 - y, self.z0 - z, self.x1 + x, self.y1 + y, self.z1 + z
        )  # fmt: skip

    def shifted(self, x: float, z: float) -> "Box":
        """Return the box moved across the floor."""
        return Box(self.x0 + x, self.y0, self.z0 + z, self.x1 + x, self.y1, self.z1 + z)

    def overlaps(self, other: "Box", slack: float = 1e-6) -> bool:
        """Return whether the two share more than a face."""
        return (
            self.x0 + slack < other.x1 and other.x0 + slack < self.x1
            and self.z0 + slack < other.z1 and other.z0 + slack < self.z1
            and self.y0 + slack < other.y1 and other.y0 + slack < self.y1
        )  # fmt: skip

    def distance(self, x: float, y: float, z: float) -> float:
        """Return the distance of a point from the box; 0 inside."""
        dx = max(self.x0 - x, x - self.x1, 0.0)
        dy = max(self.y0 - y, y - self.y1, 0.0)
        dz = max(self.z0 - z, z - self.z1, 0.0)
        return float((dx * dx + dy * dy + dz * dz) ** 0.5)


def rounded(values: Sequence[float]) -> Vec3:
    """Return a place or size in tenths of a millimetre, as scenes have them; no negative zero."""
    x, y, z = (round(float(value), 4) + 0.0 for value in values)
    return (x, y, z)


Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class BoxArrays:
    """Positions, and boxes by their middles and half their sizes; shape (n, 3) each, metres."""

    def __init__(self, origin: Floats, center: Floats, half: Floats) -> None:
        self.origin, self.center, self.half = origin, center, half
        self.low, self.high = center - half, center + half  # corners

    @classmethod
    def of(cls, things: Iterable[SceneObject]) -> "BoxArrays":
        """Return the arrays of some objects."""
        rows = [(thing.position, thing.center, thing.size) for thing in things]
        sides = (np.array([row[side] for row in rows]).reshape(-1, 3) for side in range(3))
        origin, center, size = sides
        return cls(origin, center, size / 2)

    def replaced(self, things: Mapping[int, SceneObject]) -> "BoxArrays":
        """Return the arrays with the rows of some objects written anew."""
        origin, center, half = self.origin.copy(), self.center.copy(), self.half.copy()
        for row, thing in things.items():
            origin[row], center[row] = thing.position, thing.center
            half[row] = np.array(thing.size) / 2
        return BoxArrays(origin, center, half)


def crossing(
    starts: Floats, directions: Floats, low: Floats, high: Floats
) -> tuple[Floats, Floats]:
    """Return how far along their rays boxes begin and end, each shape (n,); met if less in turn.

    Arguments have shape (n, d), or (d,) when shared; distances are in lengths of the directions.
    """
    along = np.where(np.abs(directions) < 1e-9, 1e-9, directions)
    ends = (low - starts) / along, (high - starts) / along
    return np.minimum(*ends).max(axis=-1), np.maximum(*ends).min(axis=-1)
