"""Measure the floor: the cells that an agent can stand on, which hang together, and polygons."""

from collections import deque
from collections.abc import Collection, Container, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.world.core.boxes import Box

Cell = tuple[float, float]  # (x, z), metres
Key = tuple[int, int]  # column and row of a grid
AGENT_RADIUS_M = 0.2
AGENT_HEIGHT_M = 1.6  # what hangs higher does not block a cell
GRID_M = 0.25
NEAR_M = AGENT_RADIUS_M - 1e-6  # what is nearer to a cell blocks it
_NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def walk(cells: Container[Key], start: Key) -> dict[Key, Key]:
    """Return each cell that can be reached, the nearest first, with the cell before it.

    The start comes first and stands for itself.
    """
    before = {start: start}
    queue = deque([start])
    while queue:
        column, row = cell = queue.popleft()
        for across, along in _NEIGHBOURS:
            other = (column + across, row + along)
            if other in cells and other not in before:
                before[other] = cell
                queue.append(other)
    return before


def parts(cells: Collection[Key]) -> list[list[Key]]:
    """Return the sets of cells that steps lead through, each sorted, by their first cells."""
    left, found = set(cells), []
    for start in sorted(left):
        if start in left:
            found.append(sorted(walk(left, start)))
            left.difference_update(found[-1])
    return found


def nearest_to_centre(cells: Sequence[Cell]) -> Cell:
    """Return the cell nearest to the mean of all; the first of equals."""
    points = np.asarray(cells, dtype=float)
    return cells[int(np.argmin(((points - points.mean(axis=0)) ** 2).sum(axis=1).round(9)))]


def outside(low: Any, high: Any, points: Any) -> NDArray[np.float64]:
    """Return how far points (x, z) are from boxes' corners (x, z), whatever the leading sides."""
    gap = np.maximum(np.maximum(low - points, points - high), 0.0)
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]))


def distances(cells: Sequence[Cell], boxes: Sequence[Box]) -> NDArray[np.float64]:
    """Return for each box the horizontal distance to the nearest cell, shape (boxes,)."""
    low = np.array([(box.x0, box.z0) for box in boxes])
    high = np.array([(box.x1, box.z1) for box in boxes])
    return np.asarray(outside(low, high, np.asarray(cells, dtype=float)[:, None, :]).min(axis=0))


def edges(corners: Sequence[Cell]) -> Iterator[tuple[Cell, Cell]]:
    """Yield the edges of a polygon, the closing one last."""
    return zip(corners, (*corners[1:], corners[0]), strict=True)


def inside(corners: Sequence[Cell], x: Any, z: Any) -> Any:
    """Return whether points, one or arrays that broadcast, are in a polygon."""
    found: Any = False
    for (x0, z0), (x1, z1) in edges(corners):
        if z0 != z1:
            found ^= ((z0 > z) != (z1 > z)) & (x < x0 + (z - z0) / (z1 - z0) * (x1 - x0))
    return found
