"""Work out where an agent can walk in a room of which only the objects are known.

Metadata has no walls. What hangs on them tells where they are; what stands or lies about tells the
rest. `tests/plugins/thor_tools/test_importers.py` holds the result against recorded cells.
"""

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from karma.household.places import (
    BACK_TO_WALLS,
    FACE_EITHER_WAY,
    FLOOR,
    HANG_ON_WALLS,
    ROUND_A_CORNER,
)
from karma.household.uses import BASINS
from karma.plugins.thor_tools.importing.dump import Seen
from karma.types.space import Vec3
from karma.world.core.boxes import Box, Flags, Floats
from karma.world.core.ground import AGENT_HEIGHT_M, AGENT_RADIUS_M, Cell, Key, distances, parts
from karma.world.core.thing import heading

REACH_M = 1.5
_STEP_M = 0.1  # what is lower is stepped over
_STRAIGHT_M = 0.95  # a deeper counter is bent: its box covers free floor
_RIM_M = 0.3  # of a counter, round what lies on it
_BORDER_M = 0.45  # from the outermost boxes: what hangs on walls reaches into them
_BESIDE_M = 0.6  # a wall goes on so far beside what hangs on it
_LEAN = 0.3  # the farther behind, the farther the wall goes on
_SQUEEZE_M = 0.1  # from boxes, to join parts: they are wider than what is in them
_GAP_CELLS = 6  # at most are added at a time
_SPAN_M = 0.01  # residual of an agent's place, when distances tell one
_SWITCHES = ("LightSwitch",)


def start_of(seen: Sequence[Seen]) -> Vec3 | None:
    """Return the agent's place that the objects' distances agree on; None if they do not.

    AI2-THOR gives for every object how far its origin is from the agent's.
    """
    measured = [one for one in seen if one.distance is not None]
    if len(measured) < 5:
        return None
    places = np.array([one.position.tuple for one in measured])
    far = np.array([one.distance for one in measured])
    normal = 2 * (places[1:] - places[0])
    offset = (places[1:] ** 2).sum(1) - (places[0] ** 2).sum() - far[1:] ** 2 + far[0] ** 2
    place, _, rank, _ = np.linalg.lstsq(normal, offset, rcond=1e-3)
    if rank < 3 or np.abs(np.linalg.norm(places - place, axis=1) - far).max() > _SPAN_M:
        return None
    x, y, z = (round(float(value), 3) + 0.0 for value in place)
    return (x, y, z)


def gaps(things: Sequence[Seen], points: Floats) -> Floats:
    """Return how far points (n, 2) are from the nearest thing, shape (n,); inf without one.

    Things are upright boxes on the ground, turned as they are.
    """
    if not things:
        return np.full(len(points), np.inf)
    rows = np.array([_rectangle(one) for one in things])
    center, axis, half = rows[:, :2], rows[:, 2:4], rows[:, 4:]
    offset = points[:, None] - center
    along = np.abs((offset * axis).sum(axis=2)) - half[:, 0]
    aside = np.abs(offset[..., 0] * axis[:, 1] - offset[..., 1] * axis[:, 0]) - half[:, 1]
    found: Floats = np.hypot(np.maximum(along, 0.0), np.maximum(aside, 0.0)).min(axis=1)
    return found


def _rectangle(one: Seen) -> tuple[float, ...]:
    """Return centre, direction and half sides on the ground; turned if the thing stands upright."""
    if one.object_oriented_bounding_box is not None:
        corners = np.array(one.object_oriented_bounding_box.corner_points)
        sides = corners[[1, 3]] - corners[0]
        long, wide = map(float, np.linalg.norm(sides, axis=1))
        if min(long, wide) > 1e-6 and np.all(np.abs(sides[:, 1]) < 0.1 * np.array((long, wide))):
            x, _, z = map(float, corners.mean(axis=0))
            flat = float(np.hypot(sides[0, 0], sides[0, 2]))
            return (x, z, sides[0, 0] / flat, sides[0, 2] / flat, flat / 2, wide / 2)
    (x, _, z), (long, _, wide) = one.box.center, one.box.size
    return (x, z, 1.0, 0.0, long / 2, wide / 2)


class Floor:
    """The grid over a room, and what of it is free.

    Args:
        room: what holds all objects; its y0 is the floor.
        start: where the agent stands (x, z), if it is known.
        origin: a point (x, z) of the grid.
    """

    def __init__(
        self,
        seen: Sequence[Seen],
        room: Box,
        *,
        start: Cell | None = None,
        origin: Cell = (0.0, 0.0),
        grid_m: float = 0.25,
    ) -> None:
        self._seen, self._room, self._origin, self._grid_m = seen, room, origin, grid_m
        self._start = start
        columns, rows = (
            np.arange(np.ceil((low - at) / grid_m), np.floor((high - at) / grid_m) + 1)
            for low, high, at in zip((room.x0, room.z0), (room.x1, room.z1), origin, strict=True)
        )
        self._keys = np.array([(i, j) for i in columns for j in rows], dtype=int).reshape(-1, 2)
        self._points: Floats = self._keys * grid_m + np.array(origin)

    def key(self, cell: Cell) -> Key:
        """Return the place on the grid that is nearest to a cell."""
        x, z = (round((a - b) / self._grid_m) for a, b in zip(cell, self._origin, strict=True))
        return (x, z)

    def cell(self, key: Key) -> Cell:
        """Return x and z of a place on the grid."""
        x, z = (
            round(a * self._grid_m + b, 6) + 0.0 for a, b in zip(key, self._origin, strict=True)
        )
        return (x, z)

    def walkable(self, stood: Iterable[Cell] = ()) -> tuple[Cell, ...]:
        """Return the cells that an agent can walk to, sorted; those stood on are known to be free.

        Without a start, the part with most things in reach counts.
        """
        free = self._keys_of(self._clear(AGENT_RADIUS_M) & self._inside() & ~self._behind_walls())
        free.update(map(self.key, stood))
        if self._start is not None:
            main = self.key(self._start)
            free.add(main)
        else:
            loose = [one.box for one in self._seen if one.pickupable]
            things = loose or [one.box for one in self._seen]
            main = max(parts(free), key=lambda part: self._worth(part, things), default=[(0, 0)])[0]
        free = joined(free, self._keys_of(self._clear(_SQUEEZE_M)))
        mine = next((part for part in parts(free) if main in part), [])
        return tuple(sorted(map(self.cell, self._reaching(mine) if mine else mine)))

    def connected(self, cells: Sequence[Cell], *, from_start: bool) -> tuple[tuple[Cell, ...], str]:
        """Return recorded cells that hang together, and a word on what was done to them.

        Parts are joined where a body can pass. ALFRED's cells leave out a ninth of what its
        demonstrators walk on: where no start was recorded with them they are led on to what lies
        out of reach. Of parts that stay apart the start's counts, else the largest.
        """
        known = {self.key(cell): cell for cell in cells}
        apart = len(parts(known))
        every = joined(known, self._keys_of(self._clear(_SQUEEZE_M)))
        chosen = parts(every)
        main = max(chosen, key=len)
        if from_start and self._start is not None:
            here = self.key(self._start)
            main = next((part for part in chosen if here in part), main)
        added, left = len(every) - len(known), sum(key not in main for key in known)
        note = f"floor in {apart} parts: {added} cells added between them, {left} left out"
        found = set(main) if from_start else self._reaching(main)
        notes = [note] if apart > 1 else []
        if len(found) > len(main):
            notes.append(f"{len(found) - len(main)} cells added to reach what lies out of reach")
        return tuple(sorted(known.get(key, self.cell(key)) for key in found)), "; ".join(notes)

    def _reaching(self, cells: Collection[Key]) -> set[Key]:
        """Return the cells with the shortest ways on to things that none of them is near to."""
        found = set(cells)
        things = [one.box for one in self._seen if one.pickupable]
        if not things:
            return found
        gaps = distances([self.cell(key) for key in sorted(found)], things)
        far = [box for box, gap in zip(things, gaps, strict=True) if gap > REACH_M]
        if far:
            open_floor = self._keys_of(self._clear(_SQUEEZE_M) & ~self._behind_walls())
            for box in far:
                near = {key for key in open_floor if self._gap(key, box) <= REACH_M}
                found |= _bridge(sorted(found), near, open_floor)
        return found

    def _gap(self, key: Key, box: Box) -> float:
        x, z = self.cell(key)
        return box.distance(x, box.y0, z)

    def _keys_of(self, which: Flags) -> set[Key]:
        return {(int(i), int(j)) for i, j in self._keys[which]}

    def _worth(self, part: Sequence[Key], things: Sequence[Box]) -> tuple[int, int]:
        """Return how many things are within reach of a part, and how many cells it has."""
        near = distances([self.cell(key) for key in part], things)
        return int((near <= REACH_M).sum()), len(part)

    @property
    def _solid(self) -> list[Seen]:
        """What nobody walks through: what stands on the floor or hangs low, but no wall."""
        return [
            one
            for one in self._seen
            if not one.pickupable and one.type not in (FLOOR, *BASINS, *HANG_ON_WALLS)
            and not _is_bent(one)
            and one.box.y0 - self._room.y0 <= AGENT_HEIGHT_M
            and one.box.y1 - self._room.y0 >= _STEP_M
        ]  # fmt: skip

    def _clear(self, radius_m: float) -> Flags:
        """Return where nothing stands within a radius, shape (cells,)."""
        bent = {one.id for one in self._seen if _is_bent(one)}
        laid = [
            one
            for one in self._seen
            if one.pickupable and not bent.isdisjoint(one.parent_receptacles or ())
        ]
        free: Flags = gaps(self._solid, self._points) > radius_m - 1e-6
        rim = max(_RIM_M + radius_m - AGENT_RADIUS_M, 0)
        free &= gaps(laid, self._points) > rim - 1e-6
        return free

    def _inside(self) -> Flags:
        """Return which cells are within the walls, and beside what lies about, shape (cells,)."""
        room, (x, z) = self._room, self._points.T
        border = np.stack([x - room.x0, room.x1 - x, z - room.z0, room.z1 - z]).min(axis=0)
        loose = gaps([one for one in self._seen if one.pickupable], self._points)
        free: Flags = (border >= _BORDER_M - 1e-6) & (loose >= AGENT_RADIUS_M)
        return free

    def _behind_walls(self) -> Flags:
        """Return which cells are behind a wall.

        They are nearer to the back of what hangs there, or has its back to it, than to the front
        of any other such thing.
        """
        found = np.zeros(len(self._points), dtype=bool)
        for kinds in (_SWITCHES, FACE_EITHER_WAY, BACK_TO_WALLS):
            back, front = (np.full(len(self._points), np.inf) for _ in range(2))
            for one in self._seen:
                if one.type in kinds:
                    behind, near = self._sides(one)
                    back = np.minimum(back, np.where(behind, near, np.inf))
                    front = np.minimum(front, np.where(behind, np.inf, near))
            least = 1.2 if kinds is BACK_TO_WALLS else 0.0
            found |= (back <= _BESIDE_M) & (back < front) & (front > least)
        return found

    def _sides(self, one: Seen) -> tuple[Flags, Floats]:
        """Return which cells are behind a thing's back, and how far beside it they are."""
        middle = np.array((one.box.center[0], one.box.center[2]))
        half = np.array((one.box.size[0], one.box.size[2])) / 2
        ahead = np.array(heading(round(one.rotation.y / 90) * 90.0))
        if one.type in FACE_EITHER_WAY and self._start is not None:
            ahead = np.eye(2)[int(half[0] >= half[1])]
            ahead = ahead * np.sign((np.array(self._start) - middle) @ ahead)
        offset = self._points - middle
        depth = offset @ ahead + abs(half @ ahead)
        aside = np.abs(offset @ ahead[::-1]) - abs(half @ ahead[::-1])
        far = np.where(depth < AGENT_RADIUS_M, np.minimum(depth, 0.0), depth) * _LEAN
        return depth < AGENT_RADIUS_M, np.hypot(np.maximum(aside, 0.0), far)


def _is_bent(one: Seen) -> bool:
    x, _, z = one.box.size
    return one.type in ROUND_A_CORNER and min(x, z) > _STRAIGHT_M


# ----------------------------------------------------------------- parts


def joined(free: Collection[Key], passable: Collection[Key]) -> set[Key]:
    """Return the free cells, with the fewest passable ones that join their parts to the largest.

    A gap of more than 1.5 m stays.
    """
    found, between = set(free), set(passable)
    while True:
        main, *others = sorted(parts(found), key=lambda part: -len(part)) or [[]]
        goal = {key for part in others for key in part}
        way = _bridge(main, goal, between)
        if not way:
            return found
        found |= way


def _bridge(main: Sequence[Key], goal: Collection[Key], between: Collection[Key]) -> set[Key]:
    """Return the cells of a shortest way from a part to any goal, if there is a short one."""
    before: dict[Key, Key] = {key: key for key in main}
    edge = list(main)
    for _ in range(_GAP_CELLS + 1):
        edge_now, edge = edge, []
        for i, j in edge_now:
            for step in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
                if step in before or not (step in between or step in goal):
                    continue
                before[step] = (i, j)
                if step in goal:
                    return _traced(before, step)
                edge.append(step)
    return set()


def _traced(before: dict[Key, Key], key: Key) -> set[Key]:
    way = set()
    while before[key] != key:
        way.add(key)
        key = before[key]
    return way
