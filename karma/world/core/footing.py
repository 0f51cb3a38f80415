"""Tell where the agent may stand between the cells of the scene's grid."""

from math import ceil, floor

import numpy as np

from karma.household.places import FLOOR
from karma.world.core.state import BODY_M, SILL_M, WorldState
from karma.world.core.thing import is_inert

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
        place = np.array((x, z))
        gap = np.maximum(np.maximum(self._low - place, place - self._high), 0.0)
        return np.asarray((gap**2).sum(axis=1) < (BODY_M - 1e-6) ** 2)


def _sides(value: float) -> tuple[int, ...]:
    whole = round(value)
    return (whole,) if abs(value - whole) <= _ON_LINE else (floor(value), ceil(value))
