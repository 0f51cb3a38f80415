"""Furnish a room: along walls, on walls and in the middle, no box inside another."""

from collections.abc import Iterable, Iterator, Sequence
from math import ceil, floor
from typing import NamedTuple

import msgspec
import numpy as np

from karma.household.places import FLOOR
from karma.household.types import object_type
from karma.household.uses import FRIDGE
from karma.plugins.rooms.rooms import Furnishing, FurniturePart, Kind, Piece, RoomTable
from karma.world.core.boxes import Box
from karma.world.core.ground import AGENT_HEIGHT_M, AGENT_RADIUS_M, GRID_M, NEAR_M, Cell, Key, parts

TRIES = 40
FRONT_M = 0.45  # kept free before what stands at a wall
WALK_M = 0.60  # kept free around what stands in the middle


class NoRoomError(Exception):
    """This draw does not work out; the next may."""


class Placed(msgspec.Struct, frozen=True, kw_only=True):
    """One object with its place, before it gets an id."""

    type: str
    box: Box
    yaw: int = 0
    group: int  # objects of one piece share it; they may enclose each other
    child_of: int | None = None  # index of the object whose id it carries on
    parent: int | None = None  # index of its receptacle
    part: FurniturePart | None = None  # None for what is not furniture


class LocalFrame(NamedTuple):
    """Local coordinates: u to the right and v forward of a point, turned by yaw."""

    x: float
    z: float
    yaw: int

    def box(self, u: tuple[float, float], y: tuple[float, float], v: tuple[float, float]) -> Box:
        """Return a local box in world coordinates."""
        xs, zs = zip(*(self.point(a, b) for a in u for b in v), strict=True)
        corner = (min(xs), y[0], min(zs), max(xs), y[1], max(zs))
        return Box(*(round(value, 4) + 0.0 for value in corner))

    def point(self, u: float, v: float) -> tuple[float, float]:
        """Return a local point as (x, z)."""
        cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[self.yaw // 90 % 4]
        return self.x + u * cos + v * sin, self.z - u * sin + v * cos

    @classmethod
    def of(cls, box: Box, yaw: int) -> "LocalFrame":
        """Return the frame at the left end of the back of a box that faces `yaw`."""
        x = box.x0 if yaw in (0, 90) else box.x1
        z = box.z0 if yaw in (0, 270) else box.z1
        return cls(x, z, yaw)


def extent(box: Box, yaw: int) -> tuple[float, float]:
    """Return a box's width and depth as seen from its own front."""
    x, _, z = box.size
    return (x, z) if yaw % 180 == 0 else (z, x)


class RoomInMaking:
    """A room being furnished; `placed` grows, nothing in it is moved again."""

    def __init__(self, kind: Kind, table: RoomTable, rng: np.random.Generator) -> None:
        self.kind, self.table, self.rng = kind, table, rng
        self.width, self.depth = (self._quarter(kind.width), self._quarter(kind.depth))
        x, z = self.width / 2, self.depth / 2
        self.room = Box(-x, 0.0, -z, x, kind.height, z)
        floor = FurniturePart(type=FLOOR, y=(-0.1, 0.0), v=(0.0, self.depth))
        self.placed = [Placed(type=FLOOR, box=Box(-x, -0.1, -z, x, 0.0, z), group=0, part=floor)]
        self.zones: list[Box] = []
        self.groups = 1

    def furnish(self) -> None:
        """Place the whole list of the room's furniture.

        Raises:
            NoRoomError: something that the room must have does not fit.
        """
        if self.kind.runs:
            self._place_runs(self.kind.runs[self.rng.integers(len(self.kind.runs))])
        for entry in self.kind.furniture:
            if entry.at == "on":
                continue  # with the contents
            least, most = entry.count
            for number in range(int(self.rng.integers(least, most + 1))):
                if not self._place(entry) and number < least and self._wanted(entry):
                    raise NoRoomError(entry.piece)

    def draw(self, between: tuple[float, float]) -> float:
        """Return a length from a range, in whole centimetres."""
        return round(float(self.rng.uniform(*between)), 2)

    def find(self, type_name: str) -> Placed | None:
        """Return the first object of a type."""
        return next((one for one in self.placed if one.type == type_name), None)

    def _quarter(self, between: tuple[float, float]) -> float:
        return round(float(self.rng.uniform(*between)) * 4) / 4

    def _wanted(self, entry: Furnishing) -> bool:
        return not entry.of or self.find(entry.of) is not None

    def _place(self, entry: Furnishing) -> bool:
        names = (entry.piece, *entry.alternatives)
        piece = self.table.piece(names[self.rng.integers(len(names))])
        way = {
            "wall": self._at_wall,
            "hung": self._hung,
            "middle": self._in_middle,
            "around": self._facing,
            "front": self._facing,
        }[entry.at]
        return any(way(piece, entry) for _ in range(TRIES))

    # ------------------------------------------------------------- the ways to stand

    def _at_wall(self, piece: Piece, entry: Furnishing) -> bool:
        width, yaw = self.draw(piece.width), self._yaw()
        u = self.draw((0.02, self._wall(yaw) - width - 0.02))
        boxes = self._boxes(piece, self._wall_frame(yaw, u), width)
        return self._stand(piece, boxes, yaw, gap=entry.gap, front=FRONT_M)

    def _hung(self, piece: Piece, entry: Furnishing) -> bool:
        width, yaw, y = self.draw(piece.width), self._yaw(), self.draw(entry.y)
        u = self.draw((0.1, self._wall(yaw) - width - 0.1))
        frame = self._wall_frame(yaw, u)
        below = frame.box((0, width), (y - entry.below, y), (0, piece.depth))
        if entry.below and not self._free(below, gap=0.02):
            return False
        boxes = self._boxes(piece, frame, width, y)
        return self._stand(piece, boxes, yaw, gap=0.05, front=0.0)

    def _in_middle(self, piece: Piece, entry: Furnishing) -> bool:
        width, yaw = self.draw(piece.width), self._yaw()
        reach = max(width, piece.depth) / 2 + WALK_M
        x = self.draw((self.room.x0 + reach, max(self.room.x0 + reach, self.room.x1 - reach)))
        z = self.draw((self.room.z0 + reach, max(self.room.z0 + reach, self.room.z1 - reach)))
        corner = LocalFrame(x, z, yaw).point(-width / 2, -piece.depth / 2)
        boxes = self._boxes(piece, LocalFrame(*corner, yaw), width)
        return self._stand(piece, boxes, yaw, gap=WALK_M, front=0.0)

    def _facing(self, piece: Piece, entry: Furnishing) -> bool:
        """Stand at some side of another piece, or at its front, turned to it."""
        of, around = self.find(entry.of), entry.at == "around"
        if of is None:
            return False
        width, yaw = self.draw(piece.width), self._yaw() if around else (of.yaw + 180) % 360
        across, deep = extent(of.box, yaw)
        slack = across - width
        u = self.draw(
            (0.02, max(0.02, slack - 0.02)) if around else (slack * 0.2, max(slack * 0.6, 0.0))
        )
        side = LocalFrame.of(of.box, (yaw + 180) % 360)
        corner = side.point(u + width, deep + entry.gap + piece.depth)
        boxes = self._boxes(piece, LocalFrame(*corner, yaw), width)
        return self._stand(piece, boxes, yaw, gap=0.05, front=0.0, zones=False)

    def _place_runs(self, runs: Sequence[Sequence[str]]) -> None:
        for run in runs:
            pieces = [self.table.piece(name) for name in run]
            if not any(self._run(pieces) for _ in range(TRIES)):
                raise NoRoomError("run")

    def _run(self, pieces: Sequence[Piece]) -> bool:
        widths, yaw = [self.draw(piece.width) for piece in pieces], self._yaw()
        slack = self._wall(yaw) - sum(widths)
        if slack < 0:
            return False
        u = float(self.rng.choice([0.0, slack, self.draw((0.0, slack))]))
        kept = len(self.placed), len(self.zones)
        for piece, width in zip(pieces, widths, strict=True):
            boxes = self._boxes(piece, self._wall_frame(yaw, u), width)
            if not self._stand(piece, boxes, yaw, gap=0.0, front=FRONT_M):
                del self.placed[kept[0] :], self.zones[kept[1] :]
                return False
            u += width
        return True

    # ------------------------------------------------------------- geometry

    def _yaw(self) -> int:
        return int(self.rng.integers(4)) * 90

    def _wall(self, yaw: int) -> float:
        return self.width if yaw % 180 == 0 else self.depth

    def _wall_frame(self, yaw: int, u: float) -> LocalFrame:
        along, off = self._wall(yaw) / 2, self._wall(yaw + 90) / 2
        return LocalFrame(*LocalFrame(0.0, 0.0, yaw).point(u - along, -off), yaw)

    def _boxes(self, piece: Piece, frame: LocalFrame, width: float, y: float = 0.0) -> list[Box]:
        return [
            frame.box(
                (part.u[0] * width, part.u[1] * width), (y + part.y[0], y + part.y[1]), part.v
            )
            for part in piece.parts
        ]

    def _free(self, box: Box, gap: float) -> bool:
        wide = box.grown(gap, 0.0, gap)
        inside = self.room.grown(1e-4, 1e-4, 1e-4)
        return (
            inside.x0 <= box.x0 and inside.y0 <= box.y0 and inside.z0 <= box.z0
            and box.x1 <= inside.x1 and box.y1 <= inside.y1 and box.z1 <= inside.z1
            and not any(wide.overlaps(other.box) for other in self.placed)
        )  # fmt: skip

    def _stand(
        self, piece: Piece, boxes: list[Box], yaw: int, *, gap: float, front: float,
        zones: bool = True,
    ) -> bool:  # fmt: skip
        """Place a piece if it fits: its boxes free, nobody's front blocked."""
        if not all(self._free(box, gap) for box in boxes):
            return False
        low = [box for box in boxes if box.y0 < 1.0]
        if zones and any(box.overlaps(zone) for box in low for zone in self.zones):
            return False
        if front:
            zone = _front(low, yaw, front)
            if any(zone.overlaps(other.box) for other in self.placed):
                return False
            self.zones.append(zone)
        self._add(piece, boxes, yaw)
        return True

    def _add(self, piece: Piece, boxes: list[Box], yaw: int) -> None:
        first = len(self.placed)
        for part, box in zip(piece.parts, boxes, strict=True):
            if part.chance < 1.0 and self.rng.random() >= part.chance:
                continue
            child_of = len(self.placed) - 1 if part.child else None
            self.placed.append(
                Placed(type=part.type, box=box, yaw=yaw, group=self.groups, child_of=child_of,
                       parent=self._support(part, box, first), part=part)
            )  # fmt: skip
        self.groups += 1

    def _support(self, part: FurniturePart, box: Box, first: int) -> int | None:
        """Return what a part stands on: the floor, or another part of its piece."""
        if not object_type(part.type).can("moveable") and part.type != FRIDGE:
            return None
        if box.y0 == 0.0:
            return 0
        below = box._replace(y0=box.y0 - 0.02)
        found = (i for i in range(first, len(self.placed)) if below.overlaps(self.placed[i].box))
        return next(found, None)


def _front(boxes: Sequence[Box], yaw: int, depth: float) -> Box:
    """Return the space before a piece, from just above the floor to head height."""
    hull = Box.hull(boxes)
    width, deep = extent(hull, yaw)
    return LocalFrame.of(hull, yaw).box((0.0, width), (0.05, 1.6), (deep, deep + depth))


# ------------------------------------------------------------- cells to stand on


def reachable_cells(room: Box, obstacles: Iterable[Box]) -> tuple[Cell, ...]:
    """Return the largest part of the free floor, sorted; () when there is none.

    The room's y0 is the floor; of obstacles those that begin below the agent's head block cells.
    """
    free = set(_grid(room.grown(-AGENT_RADIUS_M, 0.0, -AGENT_RADIUS_M)))
    for box in obstacles:
        if box.y0 - room.y0 <= AGENT_HEIGHT_M:
            near = _grid(box.grown(NEAR_M, 0.0, NEAR_M))
            free.difference_update(
                (i, j) for i, j in near if box.distance(i * GRID_M, box.y0, j * GRID_M) < NEAR_M
            )
    return tuple((i * GRID_M, j * GRID_M) for i, j in max(parts(free), key=len, default=()))


def _grid(box: Box) -> Iterator[Key]:
    for i in range(ceil(box.x0 / GRID_M), floor(box.x1 / GRID_M) + 1):
        for j in range(ceil(box.z0 / GRID_M), floor(box.z1 / GRID_M) + 1):
            yield i, j
