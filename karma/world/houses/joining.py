"""Lay rooms side by side so that a doorway joins each to one that is there already."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from karma.world.core.boxes import Box, rounded
from karma.world.core.ground import GRID_M, Cell
from karma.world.core.scene import Scene, Wall
from karma.world.core.thing import box_of

WALL_M = 0.05  # thickness on either side of a wall's middle
LEAST_GAP_M = 0.1  # between the insides of two rooms
DOOR_M = 0.9  # wide
_FREE_M = 0.1  # things so near to a wall stand in the way of a doorway
_BODY_M = 0.2
_ALONG = (-GRID_M, 0.0, GRID_M)  # cells side by side in a doorway
SIDES = ("x0", "x1", "z0", "z1")
OPPOSITE = {"x0": "x1", "x1": "x0", "z0": "z1", "z1": "z0"}


@dataclass(slots=True)
class LaidRoom:
    """One drawn room with its place in the home; `doors` grows as others are joined to it."""

    scene: Scene
    name: str
    x: float = 0.0  # by how much it was moved, whole multiples of the grid
    z: float = 0.0
    doors: dict[str, list[float]] = field(default_factory=dict)  # side -> middles, home's metres

    @property
    def inside(self) -> Box:
        """The room between its walls, in the home."""
        box = Box.around(self.scene.bounds_center, self.scene.bounds_size)
        return box.shifted(self.x, self.z)

    def openings(self, side: str) -> list[float]:
        """Return where along a side a doorway may be, in the room's own metres."""
        box = Box.around(self.scene.bounds_center, self.scene.bounds_size)
        cells = {_key(x, z) for x, z in self.scene.reachable}
        edge = _edge_column(box, side)
        low, high = (box.z0, box.z1) if side[0] == "x" else (box.x0, box.x1)
        first, last = int(np.ceil(low / GRID_M)), int(np.floor(high / GRID_M))
        found = []
        for number in range(first, last + 1):
            along = number * GRID_M
            beside = [_key(*_point(side, edge, along + step)) for step in _ALONG]
            if all(key in cells for key in beside) and not self._taken(side, box, along):
                found.append(along)
        return found

    def _taken(self, side: str, box: Box, along: float) -> bool:
        """Return whether something stands or hangs at the wall where a doorway would be."""
        half = DOOR_M / 2
        wall = getattr(box, side)
        reach = (wall - _FREE_M, wall + _FREE_M)
        span = (along - half, along + half)
        xs, zs = (reach, span) if side[0] == "x" else (span, reach)
        gate = Box(xs[0], box.y0 + 0.05, zs[0], xs[1], box.y1, zs[1])
        return any(gate.overlaps(box_of(thing)) for thing in self.scene.objects)


def lay(rooms: Sequence[LaidRoom], rng: np.random.Generator) -> list[list[Cell]] | None:
    """Move rooms beside one another and return the cells of each doorway; None where one has none.

    Each room but the first is put where the home stays most compact; of equals, a drawn one.
    """
    doorways = []
    for number, room in enumerate(rooms[1:], start=1):
        choices = list(_choices(rooms[:number], room))
        if not choices:
            return None
        sizes = np.array([choice[0] for choice in choices])
        best = np.flatnonzero(sizes <= sizes.min() * 1.15)
        _, host, side, along, x, z = choices[int(rng.choice(best))]
        room.x, room.z = x, z
        host.doors.setdefault(side, []).append(along)
        room.doors.setdefault(OPPOSITE[side], []).append(along)
        doorways.append(_doorway(host, room, side, along))
    return doorways


_Choice = tuple[float, LaidRoom, str, float, float, float]


def _choices(there: Sequence[LaidRoom], room: LaidRoom) -> Iterator[_Choice]:
    """Yield the ways to join a room: size of the home then, host, side, door, and the shift."""
    own = Box.around(room.scene.bounds_center, room.scene.bounds_size)
    for host in there:
        for side in SIDES:
            taken, by = host.doors.get(side, []), host.z if side[0] == "x" else host.x
            theirs = [along + by for along in host.openings(side)]
            free = [one for one in theirs if all(abs(one - other) > DOOR_M for other in taken)]
            for home_along in free[::2]:
                for mine in room.openings(OPPOSITE[side])[::2]:
                    x, z = _shift(host, own, side, home_along - mine)
                    box = own.shifted(x, z)
                    if any(_too_near(box, other.inside) for other in there):
                        continue
                    size = _extent([*(one.inside for one in there), box])
                    yield (size, host, side, home_along, x, z)


def _shift(host: LaidRoom, own: Box, side: str, along: float) -> tuple[float, float]:
    """Return by how much a room is moved to lie at a side of its host."""
    wall = getattr(host.inside, side)
    facing = getattr(own, OPPOSITE[side])
    if side in ("x1", "z1"):
        across = np.ceil((wall + LEAST_GAP_M - facing) / GRID_M - 1e-9) * GRID_M
    else:
        across = np.floor((wall - LEAST_GAP_M - facing) / GRID_M + 1e-9) * GRID_M
    across, along = round(float(across), 4), round(along, 4)
    return (across, along) if side[0] == "x" else (along, across)


def _too_near(box: Box, other: Box) -> bool:
    by = LEAST_GAP_M / 2 - 1e-6
    return box.grown(by, 0.0, by).overlaps(other.grown(by, 0.0, by))


def _extent(boxes: Sequence[Box]) -> float:
    """Return the longer side of the ground that boxes take up, and a little of the shorter."""
    x, _, z = Box.hull(boxes).size
    return max(x, z) + 0.3 * min(x, z)


def _doorway(host: LaidRoom, room: LaidRoom, side: str, along: float) -> list[Cell]:
    """Return the cells that lead through a doorway."""
    start = _edge_column(host.inside, side)
    end = _edge_column(room.inside, OPPOSITE[side])
    low, high = sorted((round(start / GRID_M), round(end / GRID_M)))
    return [
        _point(side, number * GRID_M, along + step)
        for number in range(low, high + 1)
        for step in _ALONG
    ]


def _edge_column(box: Box, side: str) -> float:
    """Return where the cells nearest to a wall lie, across it."""
    if side in ("x1", "z1"):
        return float(np.floor((getattr(box, side) - _BODY_M) / GRID_M + 1e-6) * GRID_M)
    return float(np.ceil((getattr(box, side) + _BODY_M) / GRID_M - 1e-6) * GRID_M)


def _point(side: str, across: float, along: float) -> tuple[float, float]:
    point = (across, along) if side[0] == "x" else (along, across)
    return (round(point[0], 4) + 0.0, round(point[1], 4) + 0.0)


def _key(x: float, z: float) -> tuple[int, int]:
    return (round(x / GRID_M), round(z / GRID_M))


def walls_of(room: LaidRoom) -> Iterator[Wall]:
    """Yield the boxes round a room, with gaps where doorways are."""
    box = room.inside
    for side in SIDES:
        wall = getattr(box, side)
        out = (wall, wall + WALL_M) if side in ("x1", "z1") else (wall - WALL_M, wall)
        low, high = (box.z0, box.z1) if side[0] == "x" else (box.x0, box.x1)
        start = low - WALL_M
        for middle in [*sorted(room.doors.get(side, [])), None]:
            end = high + WALL_M if middle is None else middle - DOOR_M / 2
            if end - start > 1e-6:
                xs, zs = (out, (start, end)) if side[0] == "x" else ((start, end), out)
                yield Wall(
                    low=rounded((xs[0], box.y0, zs[0])), high=rounded((xs[1], box.y1, zs[1]))
                )
            start = end if middle is None else middle + DOOR_M / 2
