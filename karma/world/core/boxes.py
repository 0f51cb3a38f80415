"""Measure axis-aligned boxes, and find the cells between them on which an agent can stand."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from math import ceil, floor
from typing import NamedTuple

import numpy as np

from karma.contracts import Vec3

Cell = tuple[float, float]  # (x, z), metres
AGENT_RADIUS_M = 0.2
AGENT_HEIGHT_M = 1.6  # what hangs higher does not block a cell


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


def reachable_cells(
    room: Box, obstacles: Iterable[Box], *, grid_m: float = 0.25, radius_m: float = AGENT_RADIUS_M
) -> tuple[Cell, ...]:
    """Return the largest of `free_parts`; () when there is none."""
    parts = free_parts(room, obstacles, grid_m=grid_m, radius_m=radius_m)
    return max(parts, key=len, default=())


def free_parts(
    room: Box, obstacles: Iterable[Box], *, grid_m: float = 0.25, radius_m: float = AGENT_RADIUS_M
) -> list[tuple[Cell, ...]]:
    """Return the connected sets of free cells, each sorted, in the order of their first cells.

    Args:
        room: the inside of the walls; its y0 is the floor.
        obstacles: boxes of which those that begin below the agent's head block cells.
        grid_m: distance of the cells, which lie on whole multiples of it.
        radius_m: free distance that the agent needs around a cell.
    """
    free = set(_grid(room.grown(-radius_m, 0.0, -radius_m), grid_m))
    for box in obstacles:
        if box.y0 - room.y0 <= AGENT_HEIGHT_M:
            free -= _blocked(box, grid_m, radius_m)
    return [tuple(sorted((i * grid_m, j * grid_m) for i, j in part)) for part in _parts(free)]


def nearest_to_centre(cells: Sequence[Cell]) -> Cell:
    """Return the cell nearest to the mean of all; the first of equals."""
    points = np.asarray(cells, dtype=float)
    return cells[int(np.argmin(((points - points.mean(axis=0)) ** 2).sum(axis=1).round(9)))]


def distances(cells: Sequence[Cell], boxes: Sequence[Box]) -> np.ndarray:
    """Return for each box the horizontal distance to the nearest cell, shape (boxes,)."""
    points = np.asarray(cells, dtype=float)[:, None, :]
    low = np.array([(box.x0, box.z0) for box in boxes])
    high = np.array([(box.x1, box.z1) for box in boxes])
    gap = np.maximum(np.maximum(low - points, points - high), 0.0)
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]).min(axis=0))


def _grid(box: Box, grid_m: float) -> Iterator[tuple[int, int]]:
    for i in range(ceil(box.x0 / grid_m), floor(box.x1 / grid_m) + 1):
        for j in range(ceil(box.z0 / grid_m), floor(box.z1 / grid_m) + 1):
            yield i, j


def _blocked(box: Box, grid_m: float, radius_m: float) -> set[tuple[int, int]]:
    near = radius_m - 1e-6
    return {
        (i, j)
        for i, j in _grid(box.grown(near, 0.0, near), grid_m)
        if box.distance(i * grid_m, box.y0, j * grid_m) < near
    }


def _parts(free: set[tuple[int, int]]) -> Iterator[set[tuple[int, int]]]:
    left = set(free)
    for start in sorted(free):
        if start not in left:
            continue
        part, queue = {start}, deque([start])
        while queue:
            i, j = queue.popleft()
            for step in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
                if step in left and step not in part:
                    part.add(step)
                    queue.append(step)
        left -= part
        yield part
