"""Where area nodes go: few cells from which every reachable cell is a short walk."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

Cell = tuple[int, int]  # grid column and row
Numbers = NDArray[np.intp]

_ROUNDS = 10  # of moving nodes to the middle of their regions; a few suffice


def spread_areas(
    cells: Iterable[tuple[float, float]], *, cell_m: float, spacing_m: float
) -> tuple[list[tuple[float, float]], list[tuple[int, int]]]:
    """Choose area nodes among the cells.

    Greedy cover (the cell that most uncovered cells are near to, first of equals), then each node
    moves to the middle of its region, which never lets a cell lose its cover.

    Args:
        cells: (x, z), metres.
        cell_m: grid step.
        spacing_m: largest distance on foot from a cell to the nearest node.

    Returns:
        Nodes (x, z) sorted by x, then z; and pairs of node numbers, smaller first, sorted, whose
        regions touch.

    Raises:
        ValueError: cell_m or spacing_m is not positive.
    """
    if cell_m <= 0 or spacing_m <= 0:
        raise ValueError(f"cell_m and spacing_m must be positive, not {cell_m} and {spacing_m}")
    points = sorted(set(cells))
    if not points:
        return [], []
    x0, z0 = points[0][0], min(z for _, z in points)
    grid: dict[Cell, tuple[float, float]] = {}
    for x, z in points:
        grid.setdefault((round((x - x0) / cell_m), round((z - z0) / cell_m)), (x, z))
    steps = int(spacing_m / cell_m + 1e-9)
    order = sorted(grid)
    floor = _floor(order)
    away = dijkstra(floor, unweighted=True)  # steps on foot between any two cells
    nodes = _cover(away <= steps)
    for _ in range(_ROUNDS):
        moved = _centred(nodes, away, floor)
        if np.array_equal(moved, nodes):
            break
        nodes = moved
    return [grid[order[node]] for node in nodes], _touching(_regions(nodes, away), floor)


def _floor(cells: list[Cell]) -> csr_matrix:
    """Return which cells lie side by side."""
    number = {cell: at for at, cell in enumerate(cells)}
    beside = [
        (at, number[other])
        for (x, z), at in number.items()
        for other in ((x + 1, z), (x, z + 1))
        if other in number
    ]
    rows, columns = np.array(beside, np.intp).reshape(-1, 2).T
    size = (len(cells), len(cells))
    found = csr_matrix((np.ones(len(beside)), (rows, columns)), shape=size)
    return csr_matrix(found + found.T)


def _cover(near: NDArray[np.bool_]) -> Numbers:
    """Return nodes so that every cell is near to one, the most useful cell first."""
    left, nodes = np.ones(len(near), bool), list[int]()
    while left.any():
        nodes.append(int(near[:, left].sum(axis=1).argmax()))
        left &= ~near[nodes[-1]]
    return np.array(sorted(nodes))


def _regions(nodes: Numbers, away: NDArray[np.float64]) -> Numbers:
    """Return for each cell its nearest node on foot; of equals the smaller number."""
    found: Numbers = np.argmin(away[nodes], axis=0)
    return found


def _centred(nodes: Numbers, away: NDArray[np.float64], floor: csr_matrix) -> Numbers:
    """Move each node to the cell of its region whose farthest cell is nearest."""
    regions, moved = _regions(nodes, away), []
    for number, node in enumerate(nodes):
        members = np.flatnonzero(regions == number)
        inside = dijkstra(floor[members][:, members], unweighted=True)
        farthest, total = inside.max(axis=1), inside.sum(axis=1)
        best = np.lexsort((total, farthest))[0]
        own = np.searchsorted(members, node)
        better = farthest[best] < farthest[own] or total[best] < total[own]
        moved.append(members[best] if better else node)
    return np.sort(moved)


def _touching(regions: Numbers, floor: csr_matrix) -> list[tuple[int, int]]:
    """Return the pairs of regions that lie side by side."""
    rows, columns = floor.nonzero()
    pairs = zip(regions[rows].tolist(), regions[columns].tolist(), strict=True)
    return sorted({pair for pair in pairs if pair[0] < pair[1]})
