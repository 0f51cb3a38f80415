"""Work out where a house has walls and where an agent can stand, from rooms, walls and doors."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil, dist, floor

import numpy as np

from karma.plugins.thor_tools.importing.house_record import HouseDoor, HouseRecord, HouseWall, Point
from karma.world.core.boxes import Box, Floats
from karma.world.core.ground import (
    AGENT_HEIGHT_M,
    GRID_M,
    NEAR_M,
    Cell,
    Key,
    edges,
    inside,
    outside,
)  # fmt: skip
from karma.world.core.scene import Wall

USUAL_HEIGHT_M = 2.5  # of walls, where a house has none
_THICK_M = 0.01  # of a wall, on either side: what hangs on it must not be inside
_PIECE_M = 0.1  # slanting walls are cut into boxes of this length
_STEP_M = 0.1  # what is lower is stepped over
_EDGE_M = 1e-6


def off(corners: Sequence[Point], x: float, z: float) -> float:
    """Return how far a point is from a polygon, metres; 0 inside."""
    if inside(corners, x, z):
        return 0.0
    return min(float(_apart(a, b, np.array(x), np.array(z))) for a, b in edges(corners))


def _apart(a: Point, b: Point, x: Floats, z: Floats) -> Floats:
    """Return how far points are from the line between two others."""
    along = np.array((b[0] - a[0], b[1] - a[1]))
    square = max(float(along @ along), 1e-12)
    share = np.clip(((x - a[0]) * along[0] + (z - a[1]) * along[1]) / square, 0.0, 1.0)
    found: Floats = np.hypot(x - a[0] - share * along[0], z - a[1] - share * along[1])
    return found


def _share(a: Point, b: Point, point: Point) -> float:
    """Return where beside a line a point is: 0 at its start, 1 at its end."""
    along = (b[0] - a[0], b[1] - a[1])
    square = along[0] ** 2 + along[1] ** 2
    return ((point[0] - a[0]) * along[0] + (point[1] - a[1]) * along[1]) / square


def _at(a: Point, b: Point, share: float) -> Point:
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))


@dataclass(slots=True)
class _BuiltWall:
    """A wall that stands, and the holes in it as shares of its length."""

    start: Point
    end: Point
    holes: list[tuple[float, float]]

    def cut(self, ends: tuple[Point, Point]) -> None:
        """Leave a gap between two points beside the wall."""
        low, high = sorted(_share(self.start, self.end, end) for end in ends)
        self.holes.append((max(low, 0.0), min(high, 1.0)))

    def standing(self) -> Iterator[tuple[Point, Point]]:
        """Yield the parts between the holes."""
        last = 0.0
        for low, high in [*sorted(self.holes), (1.0, 1.0)]:
            if low - last > _EDGE_M:
                yield _at(self.start, self.end, last), _at(self.start, self.end, low)
            last = max(last, high)


class HouseShell:
    """What of a house stands still: its floors, its walls with gaps, its doorways."""

    def __init__(self, record: HouseRecord) -> None:
        self.floors = [room.corners for room in record.rooms]
        self.floor_y = record.floor_y
        points = [point for corners in self.floors for point in corners]
        self.low, self.high = (tuple(map(side, zip(*points, strict=True))) for side in (min, max))
        heights = [point.y for wall in record.walls for point in wall.polygon]
        self.ceiling_y = max(heights, default=self.floor_y + USUAL_HEIGHT_M)
        walls = {wall.id: wall for wall in record.walls}
        built = _built(record.walls)
        self._doorways: list[Box] = []
        for door in record.doors:
            if not door.leads_out:
                self._open(door, walls, built)
        self.spans = [span for wall in built.values() for span in wall.standing()]

    def _open(
        self,
        door: HouseDoor,
        walls: dict[str, HouseWall],
        built: dict[tuple[Point, Point], _BuiltWall],
    ) -> None:
        """Cut a door into its walls, and keep the floor between them."""
        a, b = walls[door.wall0].ends
        low, high = (min(max(metres / dist(a, b), 0.0), 1.0) for metres in door.hole)
        gap = (_at(a, b, low), _at(a, b, high))
        points = list(gap)
        for wall in (walls[door.wall0], walls[door.wall1]):
            if (standing := built.get(_key(wall))) is not None:
                standing.cut(gap)
            points += (_at(*wall.ends, min(max(_share(*wall.ends, p), 0.0), 1.0)) for p in gap)
        self._doorways.append(_hull(*points))

    def walls(self) -> tuple[Wall, ...]:
        """Return the boxes that hide what is behind the walls."""
        return tuple(
            Wall(low=_rounded(low, self.floor_y), high=_rounded(high, self.ceiling_y))
            for a, b in self.spans
            for low, high in _boxes(a, b)
        )

    def cells(self, obstacles: Iterable[Box]) -> dict[Key, Cell]:
        """Return the places on the grid where an agent's body is free.

        Obstacles that hang high or are stepped over are in nobody's way.
        """
        low = [floor(side / GRID_M) for side in self.low]
        high = [ceil(side / GRID_M) for side in self.high]
        columns: Floats = np.arange(low[0], high[0] + 1, dtype=np.float64) * GRID_M
        rows: Floats = np.arange(low[1], high[1] + 1, dtype=np.float64) * GRID_M
        free = np.zeros((len(columns), len(rows)), dtype=bool)
        for corners in self.floors:
            free |= inside(corners, columns[:, None], rows[None])
        for box in self._doorways:
            across = (columns >= box.x0 - _EDGE_M) & (columns <= box.x1 + _EDGE_M)
            along = (rows >= box.z0 - _EDGE_M) & (rows <= box.z1 + _EDGE_M)
            free |= across[:, None] & along[None]
        for a, b in self.spans:
            part = _window(columns, rows, _hull(a, b).grown(NEAR_M, 0.0, NEAR_M))
            gap = _apart(a, b, columns[part[0], None], rows[None, part[1]])
            free[part] &= gap >= NEAR_M
        for box in obstacles:
            if self.floor_y + AGENT_HEIGHT_M >= box.y0 and box.y1 > self.floor_y + _STEP_M:
                part = _window(columns, rows, box.grown(NEAR_M, 0.0, NEAR_M))
                places = np.stack(np.meshgrid(columns[part[0]], rows[part[1]], indexing="ij"), -1)
                free[part] &= outside((box.x0, box.z0), (box.x1, box.z1), places) >= NEAR_M
        return {
            (int(i) + low[0], int(j) + low[1]): (float(columns[i]) + 0.0, float(rows[j]) + 0.0)
            for i, j in np.argwhere(free)
        }


def _built(walls: Iterable[HouseWall]) -> dict[tuple[Point, Point], _BuiltWall]:
    """Return the walls that stand; the two sides of one are one."""
    found: dict[tuple[Point, Point], _BuiltWall] = {}
    for wall in walls:
        if not wall.empty:
            found.setdefault(_key(wall), _BuiltWall(*wall.ends, holes=[]))
    return found


def _key(wall: HouseWall) -> tuple[Point, Point]:
    a, b = sorted((round(x, 3), round(z, 3)) for x, z in wall.ends)
    return a, b


def _hull(*points: Point) -> Box:
    xs, zs = zip(*points, strict=True)
    return Box(min(xs), 0.0, min(zs), max(xs), 0.0, max(zs))


def _boxes(a: Point, b: Point) -> Iterator[tuple[Point, Point]]:
    """Yield upright boxes along a wall: one, or several small ones where it slants."""
    slants = min(abs(a[0] - b[0]), abs(a[1] - b[1])) > _THICK_M
    count = ceil(dist(a, b) / _PIECE_M) if slants else 1
    for number in range(count):
        hull = _hull(_at(a, b, number / count), _at(a, b, (number + 1) / count))
        hull = hull.grown(_THICK_M, 0.0, _THICK_M)
        yield (hull.x0, hull.z0), (hull.x1, hull.z1)


def _rounded(point: Point, y: float) -> tuple[float, float, float]:
    return (round(point[0], 4) + 0.0, round(y, 4) + 0.0, round(point[1], 4) + 0.0)


def _window(columns: Floats, rows: Floats, box: Box) -> tuple[slice, slice]:
    """Return which part of the grid a box on the ground covers."""
    across = np.searchsorted(columns, (box.x0, box.x1))
    along = np.searchsorted(rows, (box.z0, box.z1))
    return slice(int(across[0]), int(across[1]) + 1), slice(int(along[0]), int(along[1]) + 1)
