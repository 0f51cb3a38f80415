"""Long-term memory: floors, areas, immovable objects (KARMA §3.3).

Area nodes are spread over the cells that can be stood on, few, so that every cell is a short walk
from one; every immovable object belongs to the nearest area. The graph is built once, grows as
objects are seen, and lasts on disk.
"""

from collections.abc import Iterable, Iterator
from math import hypot, prod
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from karma.errors import FileError
from karma.files import read_json, to_json, write_atomic
from karma.household.uses import with_wholes
from karma.types.memory import Area, Known, Tour
from karma.types.observation import SeenObject
from karma.types.space import Vec3, outside_m

VERSION = 1
SPACING_M = 1.25  # no cell is farther from its area node, on foot
RADIUS_M = 3.0  # objects farther than this from every area node are not kept
_ROUNDS = 10  # of moving nodes to the middle of their regions; a few suffice

Cell = tuple[int, int]  # grid column and row
Numbers = NDArray[np.intp]


class ObjectNode(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An immovable object: where it is and how much room it takes."""

    id: str
    type: str
    position_m: Vec3
    box_center_m: Vec3
    box_size_m: Vec3
    volume_m3: float  # of its box

    def distance_m(self, position: Vec3) -> float:
        """Return the distance on the floor plan from a position to the box; 0 inside."""
        x, _, z = outside_m(position, self.box_center_m, self.box_size_m)
        return hypot(x, z)

    def known(self) -> Known:
        """Return the object as a belief."""
        return Known(
            object_id=self.id,
            object_type=self.type,
            position_m=self.position_m,
            box_center_m=self.box_center_m,
            box_size_m=self.box_size_m,
        )


class AreaNode(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A cell to stand on, and the areas that can be walked to from it directly."""

    name: str
    position_m: Vec3
    adjacent: tuple[str, ...] = ()


class SceneGraph:
    """The three levels of §3.3 over one floor; areas are fixed, objects come and go.

    Args:
        areas: in order; their names are unique and adjacency is mutual.
        room: names what the map was made of, for whoever saves it; not compared.
    """

    def __init__(self, areas: Iterable[AreaNode], *, room: str = "") -> None:
        self.room = room
        self.tour: Tour | None = None  # that the graph was made on; not compared
        self._areas = {area.name: area for area in areas}
        self._objects: dict[str, ObjectNode] = {}
        self._area_of: dict[str, str] = {}

    @classmethod
    def over(
        cls,
        cells: Iterable[tuple[float, float]],
        *,
        height_m: float = 0.0,
        cell_m: float = 0.25,
        spacing_m: float = SPACING_M,
        room: str = "",
    ) -> "SceneGraph":
        """Return a graph whose area nodes cover the reachable cells, without objects yet.

        Every cell is within `spacing_m` of an area node on foot: a greedy cover (the cell that most
        uncovered cells are near to, first of equals), then each node moves to the middle of its
        region, which never lets a cell lose its cover. Two areas are adjacent when their regions
        (cells nearest to them) touch. Equal cells give an equal graph, in any order.

        Args:
            cells: (x, z) of each reachable cell, metres.
            height_m: y of the floor.
            cell_m: grid step between neighbouring cells.
            spacing_m: largest walking distance from a cell to its area node.
            room: see the class.
        """
        grid = _grid(cells, cell_m)
        order = sorted(grid)
        if not order:
            return cls((), room=room)
        floor = _floor(order)
        away = dijkstra(floor, unweighted=True)  # steps on foot between any two cells
        nodes = _cover(away <= int(spacing_m / cell_m + 1e-9))
        for _ in range(_ROUNDS):
            moved = _centred(nodes, away, floor)
            if np.array_equal(moved, nodes):
                break
            nodes = moved
        edges = _touching(_regions(nodes, away), floor)
        areas = []
        for number, node in enumerate(nodes):
            adjacent = sorted(b if a == number else a for a, b in edges if number in (a, b))
            names = tuple(f"node_{other + 1}" for other in adjacent)
            x, z = grid[order[node]]
            position = (x, height_m, z)
            areas.append(AreaNode(name=f"node_{number + 1}", position_m=position, adjacent=names))
        return cls(areas, room=room)

    # ------------------------------------------------------------- what is seen

    def observe(self, seen: Iterable[SeenObject]) -> None:
        """Add or move the immovable objects among those seen; the last look at an object counts.

        Order and batches do not matter otherwise. An object that was moved out of reach of every
        area is dropped. What has no position, as depth cameras tell it, was not seen.
        """
        for item in seen:
            if item.pickupable or not item.is_somewhere or not self._areas:
                continue
            node = ObjectNode(
                id=item.object_id,
                type=item.object_type,
                position_m=item.position_m,
                box_center_m=item.box_center_m,
                box_size_m=item.box_size_m,
                volume_m3=prod(item.box_size_m),
            )
            self.forget(node.id)
            area = min(self._areas.values(), key=lambda area: node.distance_m(area.position_m))
            if node.distance_m(area.position_m) <= RADIUS_M:
                self._objects[node.id] = node
                self._area_of[node.id] = area.name

    def forget(self, object_id: str) -> None:
        """Remove an object if it is known."""
        self._area_of.pop(object_id, None)
        self._objects.pop(object_id, None)

    # ------------------------------------------------------------- what is known

    def areas(self) -> tuple[Area, ...]:
        """Return the area nodes in order, each with its objects, and their types, sorted."""
        return tuple(
            Area(
                name=name,
                position_m=area.position_m,
                contains=tuple(sorted(with_wholes(node.type for node in self.objects(name)))),
                adjacent=area.adjacent,
                fixtures=tuple(node.known() for node in self.objects(name)),
            )
            for name, area in self._areas.items()
        )

    def objects(self, area: str | None = None) -> tuple[ObjectNode, ...]:
        """Return the objects, of one area or of all, sorted by id."""
        ids = sorted(i for i in self._objects if area is None or self._area_of[i] == area)
        return tuple(self._objects[object_id] for object_id in ids)

    def known(self, name: str, *, near: Vec3) -> Known | None:
        """Return the object of an id or type whose box is nearest to a position, if any."""
        nodes = [node for node in self.objects() if name in (node.id, node.type)]
        nearest = min(nodes, key=lambda node: node.distance_m(near), default=None)
        return nearest.known() if nearest is not None else None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SceneGraph) and self._saved() == other._saved()

    __hash__ = None  # type: ignore[assignment]  # it changes

    # ------------------------------------------------------------- as text

    def to_text(self, *, edges: bool = True) -> str:
        """Return the form of §3.3: a line for each area, then one for each edge; ends in newline.

        The edges say again what the lines before them do, and can be left out.

        {name: node_1, type: Area, contains: [Bed], adjacent nodes: [node_2], position: [...]}
        node_1 <-> node_2
        """
        written = []
        for area in self.areas():
            x, y, z = (round(value, 2) + 0.0 for value in area.position_m)  # no negative zeros
            written.append(
                f"{{name: {area.name}, type: Area, contains: [{', '.join(area.contains)}], "
                f"adjacent nodes: [{', '.join(area.adjacent)}], "
                f"position: [{x:.2f}, {y:.2f}, {z:.2f}]}}"
            )
        written += [f"{a} <-> {b}" for a, b in self._edges()] if edges else []
        return "".join(f"{line}\n" for line in written)

    def _edges(self) -> Iterator[tuple[str, str]]:
        """Yield each edge once, from the area named first."""
        rank = {name: number for number, name in enumerate(self._areas)}
        for name, area in self._areas.items():
            yield from ((name, other) for other in area.adjacent if rank[name] < rank[other])

    # ------------------------------------------------------------- on disk

    def save(self, path: str | Path) -> None:
        """Write the graph as JSON, or leave the file as it was.

        Raises:
            FileError: the file cannot be written.
        """
        saved = msgspec.structs.replace(self._saved(), tour=self.tour, room=self.room)
        write_atomic(path, to_json(saved, indent=1))

    @classmethod
    def load(cls, path: str | Path) -> "SceneGraph":
        """Read a graph that `save` wrote.

        Raises:
            FileError: missing, torn, an unknown key, or another version.
        """
        fix = "delete it; the graph is built anew from the scene"
        saved = read_json(path, _SavedGraph, fix=fix)
        if saved.version != VERSION:
            raise FileError(path, f"version {saved.version}, expected {VERSION}", fix=fix)
        graph = cls((one.area for one in saved.floor.areas), room=saved.room)
        graph.tour = saved.tour
        for one in saved.floor.areas:
            graph._objects.update((node.id, node) for node in one.objects)
            graph._area_of.update((node.id, one.area.name) for node in one.objects)
        return graph

    def _saved(self) -> "_SavedGraph":
        areas = tuple(
            _SavedArea(area=area, objects=self.objects(name)) for name, area in self._areas.items()
        )
        return _SavedGraph(version=VERSION, floor=_SavedFloor(areas=areas))


class _SavedArea(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    area: AreaNode
    objects: tuple[ObjectNode, ...]


class _SavedFloor(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    name: str = "floor_1"
    areas: tuple[_SavedArea, ...]


class _SavedGraph(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Floors -> areas -> objects, as nested on disk."""

    version: int
    radius_m: float = RADIUS_M
    floor: _SavedFloor
    tour: Tour | None = None
    room: str = ""  # of maps from before rooms were told apart


# ----------------------------------------------------------------- where area nodes go


def _grid(cells: Iterable[tuple[float, float]], cell_m: float) -> dict[Cell, tuple[float, float]]:
    """Return the cells by column and row."""
    points = sorted(set(cells))
    x0, z0 = min((x for x, _ in points), default=0.0), min((z for _, z in points), default=0.0)
    grid: dict[Cell, tuple[float, float]] = {}
    for x, z in points:
        grid.setdefault((round((x - x0) / cell_m), round((z - z0) / cell_m)), (x, z))
    return grid


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
