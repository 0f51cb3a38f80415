"""Decode one house of ProcTHOR's form strictly; an error names the key and what is wrong there.

The form is that of ProcTHOR-10k (schema 0.0.1 and 1.0.0): `rooms`, `walls`, `doors`, `objects`
with nested `children`, `metadata`. What has no meaning for boxes (materials, lights, windows) is
not looked at.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from math import dist, hypot
from typing import Any

import msgspec

from karma.errors import FileError
from karma.household.types import RoomType
from karma.plugins.thor_tools.importing.dump import Coordinate, Xyz
from karma.world.core.ground import edges

FIX = "take a house as ProcTHOR wrote it; eval/lived/houses shows the form"
SCHEMAS = ("0.0.1", "1.0.0")
OUTSIDE = "exterior"  # stands in ids of walls and rooms that are no room's
_LEAST_AREA_M2 = 0.1
_LEVEL_M = 0.01  # floors closer than this lie at one height

Point = tuple[float, float]  # x, z


class _Part(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    pass


class HouseRoom(_Part, frozen=True, kw_only=True):
    """A room by its floor."""

    id: str
    room_type: RoomType
    floor_polygon: tuple[Xyz, ...]

    @property
    def corners(self) -> tuple[Point, ...]:
        """The floor's corners in order."""
        return tuple((point.x, point.z) for point in self.floor_polygon)


class HouseWall(_Part, frozen=True, kw_only=True):
    """One side of a wall; an empty one is not built, and joins two rooms."""

    id: str
    polygon: tuple[Xyz, ...]
    room_id: str | None = None
    empty: bool = False

    @property
    def ends(self) -> tuple[Point, Point]:
        """Where it starts on the ground, and its other end; holes are measured from the start."""
        first = self.polygon[0]
        last = max(self.polygon, key=lambda point: hypot(point.x - first.x, point.z - first.z))
        return (first.x, first.z), (last.x, last.z)


class _Span(_Part, frozen=True, kw_only=True):
    min: Xyz
    max: Xyz


class HouseDoor(_Part, frozen=True, kw_only=True):
    """A hole in two walls, measured along the first: x from its start, y from the floor."""

    id: str
    room0: str
    room1: str
    wall0: str
    wall1: str
    hole_polygon: tuple[Xyz, ...] | None = None  # schema 1.0.0
    bounding_box: _Span | None = None  # schema 0.0.1
    openable: bool = False
    openness: float | None = None

    @property
    def hole(self) -> tuple[float, float]:
        """Where the hole begins and ends along its wall, metres."""
        box = self.bounding_box
        points = self.hole_polygon or ((box.min, box.max) if box else ())
        along = [point.x for point in points]
        return min(along, default=0.0), max(along, default=0.0)

    @property
    def leads_out(self) -> bool:
        """Whether it is a door of the house, not between two rooms."""
        ids = (self.room0, self.room1, self.wall0, self.wall1)
        return self.room0 == self.room1 or any(OUTSIDE in one for one in ids)


class HouseThing(_Part, frozen=True, kw_only=True):
    """An object: the middle of its box, and what lies in or on it."""

    id: str
    asset_id: str = ""
    position: Xyz
    rotation: Xyz = Xyz(0.0, 0.0, 0.0)
    kinematic: bool = False  # it cannot be pushed
    children: tuple["HouseThing", ...] = ()
    openness: float | None = None
    is_on: bool | None = None
    is_dirty: bool | None = None


class HouseAgent(_Part, frozen=True, kw_only=True):
    """Where the agent starts."""

    position: Xyz
    rotation: Xyz = Xyz(0.0, 0.0, 0.0)
    horizon: Coordinate = 0.0


class HouseMetadata(_Part, frozen=True, kw_only=True):
    """What the house says of itself."""

    agent: HouseAgent | None = None
    schema: str | None = None


class HouseRecord(_Part, frozen=True, kw_only=True):
    """A house as it is written."""

    rooms: tuple[HouseRoom, ...]
    walls: tuple[HouseWall, ...]
    doors: tuple[HouseDoor, ...]
    objects: tuple[HouseThing, ...]
    metadata: HouseMetadata = HouseMetadata()

    @property
    def floor_y(self) -> float:
        """The height of all floors."""
        return self.rooms[0].floor_polygon[0].y

    def every_thing(self) -> Iterator[tuple[str, HouseThing]]:
        """Yield all objects with their keys, what lies in one after it."""
        stack = [(f"objects[{i}]", one) for i, one in enumerate(self.objects)][::-1]
        while stack:
            key, thing = stack.pop()
            yield key, thing
            inside = [(f"{key}.children[{i}]", one) for i, one in enumerate(thing.children)]
            stack.extend(inside[::-1])


def read_record(house: Mapping[str, Any], name: str) -> HouseRecord:
    """Decode and check a house.

    Raises:
        FileError: a key is missing or of the wrong form, a number is none, an id stands twice, a
            door leads nowhere; the path is the house's name, and the reason begins with the key.
    """
    try:
        record = msgspec.convert(house, HouseRecord)
    except (msgspec.ValidationError, RecursionError) as error:
        raise FileError(name, str(error), fix=FIX) from error
    if wrong := _senseless(record):
        raise FileError(name, wrong, fix=FIX)
    return record


def _senseless(record: HouseRecord) -> str:
    """Return the first thing that no house has; "" if there is none."""
    schema = record.metadata.schema
    if schema is not None and schema not in SCHEMAS:
        return f"metadata.schema: {schema!r} is not known, only {' and '.join(SCHEMAS)}"
    if not record.rooms:
        return "rooms: there are none"
    for key, ids in (
        ("rooms", [room.id for room in record.rooms]),
        ("doors", [door.id for door in record.doors]),
        ("objects", [thing.id for _, thing in record.every_thing()]),
    ):
        again = next((one for one, count in Counter(ids).items() if count > 1), None)
        if again is not None:
            return f"{key}: id {again!r} stands twice"
    return _odd_floor(record) or _odd_wall(record) or _odd_door(record)


def _odd_floor(record: HouseRecord) -> str:
    for index, room in enumerate(record.rooms):
        key = f"rooms[{index}].floorPolygon"
        if len(set(room.corners)) < 3 or area(room.corners) < _LEAST_AREA_M2:
            return f"{key}: the floor's area is less than {_LEAST_AREA_M2} m²"
        if any(abs(point.y - record.floor_y) > _LEVEL_M for point in room.floor_polygon):
            return f"{key}: not level with the first room's; houses of one floor are read"
    return ""


def area(corners: tuple[Point, ...]) -> float:
    """Return the area of a polygon, square metres."""
    return abs(sum(x0 * z1 - x1 * z0 for (x0, z0), (x1, z1) in edges(corners))) / 2


def _odd_wall(record: HouseRecord) -> str:
    rooms = {room.id for room in record.rooms}
    for index, wall in enumerate(record.walls):
        if len(wall.polygon) < 3 or wall.ends[0] == wall.ends[1]:
            return f"walls[{index}].polygon: the wall has no length or height"
        room_id = wall.room_id
        if room_id is not None and room_id not in rooms and OUTSIDE not in room_id + wall.id:
            return f"walls[{index}].roomId: no room {room_id!r}"
    return ""


def _odd_door(record: HouseRecord) -> str:
    rooms = {room.id for room in record.rooms}
    walls = {wall.id: wall for wall in record.walls}
    for index, door in enumerate(record.doors):
        key = f"doors[{index}]"
        for end, known in (("room0", rooms), ("room1", rooms), ("wall0", walls), ("wall1", walls)):
            end_id: str = getattr(door, end)
            if end_id not in known and OUTSIDE not in end_id:
                return f"{key}.{end}: no {end[:4]} {end_id!r}"
        if door.hole_polygon is None and door.bounding_box is None:
            return f"{key}: neither holePolygon nor boundingBox"
        low, high = door.hole
        if high <= low:
            return f"{key}: the hole has no width"
        if door.wall0 in walls and (high <= 0 or low >= dist(*walls[door.wall0].ends)):
            return f"{key}: the hole lies outside its wall {door.wall0!r}"
    return ""
