"""Hold the boxes of all objects as arrays, a row each in their order, and meet boxes with rays."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from karma.world.core.scene import SceneObject

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
