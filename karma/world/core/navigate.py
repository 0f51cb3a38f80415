"""Find paths across the floor, and places to stand and look from, also between the cells.

All orders are fixed.
"""

from collections.abc import Container, Iterator, Sequence
from itertools import product
from math import ceil, floor
from typing import NamedTuple

import numpy as np

from karma.household.places import FLOOR
from karma.types.space import Pose
from karma.world.core.boxes import Flags, Floats
from karma.world.core.ground import outside, walk
from karma.world.core.hiding import hidden_rows
from karma.world.core.state import BODY_M, SILL_M, Cell, WorldState
from karma.world.core.thing import is_inert
from karma.world.core.view import blocked, camera, camera_axes, in_picture, sample_points

_YAWS = (0.0, 90.0, 180.0, 270.0)
_HORIZONS = (-30.0, 0.0, 30.0, 60.0)
_CHUNK = 8  # cells looked from at once


class _Looks(NamedTuple):
    standings: Sequence[bool]
    angles: Sequence[tuple[float, float]]  # yaw, horizon


def nearest_cell(state: WorldState, x: float, z: float) -> Cell | None:
    """Return the cell to stand on that is nearest to a place; None when there is none."""
    key = state.room.key(x, z)
    if key in state.cells:
        return key
    far = (((c[0] - x) ** 2 + (c[1] - z) ** 2, key) for key, c in state.cells.items())
    return min(far, default=(0.0, None))[1]


def path(cells: Container[Cell], start: Cell, goal: Cell) -> list[Cell] | None:
    """Return a shortest path in single steps, both ends included; None when there is none."""
    before = walk(cells, start)
    if goal not in before:
        return None
    found = [goal]
    while found[-1] != start:
        found.append(before[found[-1]])
    return found[::-1]


def corners(cells: Sequence[Cell]) -> list[Cell]:
    """Return the ends and turning points of a path."""
    found = list(cells[:1])
    for before, here, after in zip(cells, cells[1:], cells[2:], strict=False):
        if (here[0] - before[0], here[1] - before[1]) != (after[0] - here[0], after[1] - here[1]):
            found.append(here)
    return found + list(cells[1:])[-1:]


def approach(state: WorldState, object_id: str) -> Cell | None:
    """Return the reachable cell nearest to an object's box; None without cells."""
    start = agent_cell(state)
    if start is None:
        return None
    cells = list(walk(state.cells, start))
    row = state.objects.rows[object_id]
    gap = _gap(state, row, cells)
    return cells[int(np.argmin(np.round(gap, 6)))]


def agent_cell(state: WorldState) -> Cell | None:
    """Return the cell that the agent stands on, or the nearest one."""
    return nearest_cell(state, state.pose.position_m[0], state.pose.position_m[2])


def interactable_poses(
    state: WorldState,
    object_id: str,
    *,
    cells: Sequence[Cell] | None = None,
    yaws: Sequence[float] = _YAWS,
    horizons: Sequence[float] = _HORIZONS,
    standings: Sequence[bool] = (True, False),
    max_m: float | None = None,
    limit: int | None = None,
) -> list[Pose]:
    """Return poses, at most `limit`, from which an object can be interacted with.

    What the agent holds is not in the way; cells are those it can walk to unless given, and the
    reach is the world's. Nearest first by walking distance, standing first, the object's middle
    nearest to the picture's; so the first is a good one to take.
    """
    objects, row = state.objects, state.objects.rows[object_id]
    start = agent_cell(state)
    if hidden_rows(objects)[row] or start is None:
        return []
    order = list(walk(state.cells, start))
    wanted = order if cells is None else [cell for cell in order if cell in set(cells)]
    reach = state.settings.visibility_m if max_m is None else max_m
    gaps = _gap(state, row, wanted)
    near = [cell for cell, gap in zip(wanted, gaps, strict=True) if gap <= reach]
    found: list[Pose] = []
    looks = _Looks(tuple(dict.fromkeys(standings)), list(product(yaws, horizons)))
    for first in range(0, len(near), _CHUNK):
        found.extend(_look(state, row, near[first : first + _CHUNK], looks))
        if limit is not None and len(found) >= limit:
            return found[:limit]
    return found


def _gap(state: WorldState, row: int, cells: Sequence[Cell]) -> Floats:
    """Return each cell's distance from a box across the floor, shape (cells,)."""
    places = np.array([state.room.cells[cell] for cell in cells]).reshape(-1, 2)
    center, half = state.objects.boxes.center[row], state.objects.boxes.half[row]
    gap = np.maximum(np.abs(places - center[[0, 2]]) - half[[0, 2]], 0.0)
    found: Floats = np.hypot(gap[:, 0], gap[:, 1])
    return found


def _look(state: WorldState, row: int, cells: Sequence[Cell], looks: _Looks) -> Iterator[Pose]:
    """Yield the poses on some cells that have the object in view, best first on each cell."""
    y, settings = state.pose.position_m[1], state.settings
    places = [state.room.cells[cell] for cell in cells]
    good: list[list[tuple[bool, float, float, float]]] = [[] for _ in cells]
    axes = np.stack([camera_axes(yaw, horizon) for yaw, horizon in looks.angles])
    for standing in looks.standings:
        at = [
            Pose(position_m=(x, y, z), yaw_deg=0.0, horizon_deg=0.0, standing=standing)
            for x, z in places
        ]
        eyes = np.array([camera(pose) for pose in at])
        points, clear = _open_points(state, row, eyes)
        shown = in_picture(
            (points - eyes[:, None])[:, None], axes[None], settings.fov_deg, settings.aspect
        )
        middle = state.objects.boxes.center[row] - eyes
        middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-9)
        off = np.round(1.0 - middle @ axes[:, 2].T, 6)
        for index, look in np.argwhere(np.any(shown & clear[:, None], axis=2)):
            score = (not standing, float(off[index, look]), *looks.angles[look])
            good[index].append(score)
    for (x, z), scores in zip(places, good, strict=True):
        for crouching, _, yaw, horizon in sorted(scores):
            yield Pose(
                position_m=(x, y, z), yaw_deg=yaw, horizon_deg=horizon, standing=not crouching
            )


def _open_points(state: WorldState, row: int, eyes: Floats) -> tuple[Floats, Flags]:
    """Return per camera the sample points, shape (eyes, points, 3), and which nothing hides."""
    objects, shell, reach = state.objects, state.room.shell, state.settings.visibility_m
    points = np.stack([sample_points(objects, np.array([row]), eye, reach)[0] for eye in eyes])
    targets = np.full(points.shape[1], row)
    hidden = np.zeros(points.shape[:2], dtype=bool)
    for index, eye in enumerate(eyes):
        solid, glass = blocked(objects, eye, points[index], targets, state.in_hand, shell)
        hidden[index] = solid | glass
    return points, ~hidden


# ----------------------------------------------------------------- between the cells

BODY_TOP_M = 1.8  # above the floor
_ON_LINE = 0.04  # of a cell: so near to a line of cells that it counts as on it


def finer(state: WorldState) -> bool:
    """Return whether the agent's steps are shorter than the cells are apart."""
    return state.settings.grid_m < state.room.grid_m * 0.99


def snapped(state: WorldState, x: float, z: float) -> tuple[float, float]:
    """Return the point of the agent's own, finer grid that is nearest to a place.

    As in AI2-THOR it consists of the whole multiples of gridSize.
    """
    grid = state.settings.grid_m
    return (round(round(x / grid) * grid, 6), round(round(z / grid) * grid, 6))


class Ground:
    """The floor of one moment: the cells, and what stands where."""

    def __init__(self, state: WorldState) -> None:
        self._room = room = state.room
        self._cells = state.cells
        objects, floor_y = state.objects, state.room.floor_y
        rows = [
            objects.rows[thing.id]
            for thing in objects.values()
            if "pickupable" not in thing.capabilities and thing.type != FLOOR
            and not is_inert(thing)
        ]  # fmt: skip
        high = objects.boxes.high[rows, 1] >= floor_y + SILL_M
        low = objects.boxes.low[rows, 1] <= floor_y + BODY_TOP_M
        self._low = objects.boxes.low[rows][high & low][:, [0, 2]]
        self._high = objects.boxes.high[rows][high & low][:, [0, 2]]
        self._origin = room.cells.get((0, 0), (0.0, 0.0))

    def free(self, x: float, z: float) -> bool:
        """Return whether the agent can stand at a place.

        It can where all cells round the place are free; beside a free cell, also where no box
        comes within its body that does not come within it on the cell already.
        """
        cells = self._cells
        if all(key in cells for key in self._around(x, z)):
            return True
        nearest = cells.get(self._room.key(x, z))
        if nearest is None:
            return False
        return not np.any(self._touched(x, z) & ~self._touched(*nearest))

    def _around(self, x: float, z: float) -> list[tuple[int, int]]:
        grid = self._room.grid_m
        across, along = (x - self._origin[0]) / grid, (z - self._origin[1]) / grid
        return [(column, row) for column in _sides(across) for row in _sides(along)]

    def _touched(self, x: float, z: float) -> np.ndarray:
        return np.asarray(outside(self._low, self._high, np.array((x, z))) < BODY_M - 1e-6)


def _sides(value: float) -> tuple[int, ...]:
    whole = round(value)
    return (whole,) if abs(value - whole) <= _ON_LINE else (floor(value), ceil(value))
