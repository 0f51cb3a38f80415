"""Where area nodes go: few cells from which every reachable cell is a short walk."""

from collections.abc import Iterable, Mapping, Sequence

Cell = tuple[int, int]  # grid column and row

_STEPS = ((1, 0), (-1, 0), (0, 1), (0, -1))
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
    nodes = _cover(sorted(grid), steps)
    for _ in range(_ROUNDS):
        moved = _centred(nodes, grid.keys())
        if moved == nodes:
            break
        nodes = moved
    region = _regions(nodes, grid.keys())
    return [grid[node] for node in nodes], _touching(region)


def _cover(cells: Sequence[Cell], steps: int) -> list[Cell]:
    """Return nodes so that every cell is within `steps` of one, the most useful cell first."""
    free = frozenset(cells)
    near = {cell: frozenset(_distances(cell, free, steps)) for cell in cells}
    left, nodes = set(cells), []
    while left:
        best = max(cells, key=lambda cell: len(near[cell] & left))
        nodes.append(best)
        left -= near[best]
    return sorted(nodes)


def _centred(nodes: Sequence[Cell], free: Iterable[Cell]) -> list[Cell]:
    """Move each node to the cell of its region whose farthest cell is nearest."""
    members: dict[int, set[Cell]] = {}
    for cell, number in _regions(nodes, free).items():
        members.setdefault(number, set()).add(cell)
    moved = []
    for number, node in enumerate(nodes):
        region = members[number]
        reach = {cell: _distances(cell, region).values() for cell in sorted(region)}
        best = min(reach, key=lambda cell: (max(reach[cell]), sum(reach[cell]), cell))
        better = max(reach[best]) < max(reach[node]) or sum(reach[best]) < sum(reach[node])
        moved.append(best if better else node)
    return sorted(moved)


def _regions(nodes: Sequence[Cell], free: Iterable[Cell]) -> dict[Cell, int]:
    """Return for each reachable cell its nearest node on foot; of equals the smaller number."""
    free = set(free)
    region = {node: number for number, node in enumerate(nodes)}
    edge = dict(region)
    while edge:
        following: dict[Cell, int] = {}
        for cell, number in edge.items():
            for other in _neighbours(cell):
                if other in free and other not in region:
                    following[other] = min(number, following.get(other, number))
        region.update(following)
        edge = following
    return region


def _touching(region: Mapping[Cell, int]) -> list[tuple[int, int]]:
    pairs = set()
    for cell, number in region.items():
        for other in _neighbours(cell):
            if region.get(other, number) > number:
                pairs.add((number, region[other]))
    return sorted(pairs)


def _distances(
    start: Cell, free: frozenset[Cell] | set[Cell], limit: int | None = None
) -> dict[Cell, int]:
    """Return the cells on foot from `start`, and how many steps away."""
    found, edge, steps = {start: 0}, [start], 0
    while edge and (limit is None or steps < limit):
        steps += 1
        following = []
        for cell in edge:
            for other in _neighbours(cell):
                if other in free and other not in found:
                    found[other] = steps
                    following.append(other)
        edge = following
    return found


def _neighbours(cell: Cell) -> tuple[Cell, ...]:
    return tuple((cell[0] + dx, cell[1] + dz) for dx, dz in _STEPS)
