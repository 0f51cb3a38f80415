"""Turn the objects of a house of ProcTHOR's form into objects of a scene."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from karma.errors import FileError
from karma.household.ids import root_type, type_of
from karma.household.places import FLOOR
from karma.household.types import Capability, ObjectType, object_types
from karma.household.uses import BASIN_OF, BURNER, FRIDGE, KNOB
from karma.plugins.thor_tools.importing.dump import Xyz
from karma.plugins.thor_tools.importing.house_floor import HouseShell, off
from karma.plugins.thor_tools.importing.house_record import FIX, HouseRecord, HouseThing
from karma.types.space import Vec3
from karma.world.core.boxes import Box, rounded
from karma.world.core.posing import rotation_matrix
from karma.world.core.scene import LARGEST_M, SceneObject
from karma.world.core.thing import box_of

_WORD = re.compile(r"RoboTHOR|[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_TELLING = 4  # letters of a type that tell it inside of a name
_OUT_M = 0.5  # so far outside every room a thing may be: what hangs on walls reaches into them
_STANDS_M = 0.05  # what begins lower stands on the floor
_SOME = 5  # names in a message
_FLOOR_M = 0.1  # thickness of a floor's box


class HouseAsset(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """What a database of assets tells of one: its type, and its box at yaw 0, metres."""

    bounding_box: Xyz
    object_type: str | None = None


@dataclass(slots=True)
class _Placed:
    """A thing with its place among the others."""

    item: HouseThing
    key: str
    kind: ObjectType
    parent: int | None
    room: int


@dataclass(slots=True)
class HouseThings:
    """The objects of a house, and what was done to them on the way."""

    record: HouseRecord
    shell: HouseShell
    assets: Mapping[str, HouseAsset]  # others have their type's size
    name: str  # for errors
    left_out: Counter[str] = field(default_factory=Counter)  # by a type that we do not have
    lay_on: int = 0  # things that lay in or on what was left out
    usual: int = 0  # things with their type's size

    def objects(self) -> tuple[SceneObject, ...]:
        """Return the floors, then the things in the order they are written.

        Raises:
            FileError: a thing lies outside the house, its asset has no size, or of most things
                the type cannot be told.
        """
        placed = list(self._placed())
        gone = self.left_out.total() + self.lay_on
        if gone > len(placed):
            some = ", ".join(sorted(self.left_out)[:_SOME])
            every = gone + len(placed)
            reason = f"objects: of {gone} of {every} the type cannot be told, e.g. {some}"
            raise FileError(self.name, reason, fix="--assets asset-database.json, of ProcTHOR")
        found = list(self._floors())
        taken = {one.id for one in found}
        first = len(found)
        for one in placed:
            found.append(self._object(one, found, first, taken))
            taken.add(found[-1].id)
        return tuple(_with_controls(found, placed, first))

    def _placed(self) -> Iterator[_Placed]:
        """Yield the things of known types, each after what it lies in."""
        numbers: dict[str, int] = {}
        gone: set[str] = set()
        for key, item in self.record.every_thing():
            above = key.rpartition(".children")[0]
            type_name = self._type(item)
            if above in gone or type_name not in object_types():
                gone.add(key)
                if above in gone:
                    self.lay_on += 1
                else:
                    self.left_out[type_name] += 1
                continue
            room = self._room(key, item)
            numbers[key] = len(numbers)
            yield _Placed(item, key, object_types()[type_name], numbers.get(above), room)

    def _type(self, item: HouseThing) -> str:
        """Return a thing's type: its asset's, else that its id or its asset's name begins with."""
        asset, named = self.assets.get(item.asset_id), root_type(item.id)
        if asset and asset.object_type:
            return asset.object_type
        if named in object_types():
            return named
        return type_in(item.asset_id) or type_in(named) or item.asset_id or named

    def _room(self, key: str, item: HouseThing) -> int:
        """Return the number of the room that a thing is in, or nearest to."""
        x, y, z = item.position.tuple
        far = [off(corners, x, z) for corners in self.shell.floors]
        nearest = int(np.argmin(far))
        level = self.shell.floor_y - _OUT_M <= y <= self.shell.ceiling_y + _OUT_M
        if far[nearest] > _OUT_M or not level:
            reason = f"{key}.position: {item.id!r} lies outside the house"
            raise FileError(self.name, reason, fix=FIX)
        return nearest

    def _floors(self) -> Iterator[SceneObject]:
        kind, taken = object_types()[FLOOR], set[str]()
        for index, corners in enumerate(self.shell.floors):
            xs, zs = [x for x, _ in corners], [z for _, z in corners]
            x, z = (min(xs) + max(xs)) / 2, (min(zs) + max(zs)) / 2
            middle = rounded((x, self.shell.floor_y - _FLOOR_M / 2, z))
            place = rounded((x, self.shell.floor_y, z))
            identity = _free(_identity(FLOOR, place), taken)
            taken.add(identity)
            yield SceneObject(
                id=identity,
                type=FLOOR,
                name=self.record.rooms[index].id,
                position=place,
                center=middle,
                size=rounded((max(xs) - min(xs), _FLOOR_M, max(zs) - min(zs))),
                capabilities=kind.capabilities,
            )

    def _object(
        self, one: _Placed, found: Sequence[SceneObject], first: int, taken: set[str]
    ) -> SceneObject:
        item, kind = one.item, one.kind
        center, place = item.position.tuple, rounded(item.position.tuple)
        size, corners = _turned(self._size(one), item.rotation.tuple, center)
        can = self._capabilities(item, kind)
        movable = "pickupable" in can or "moveable" in can
        above = None if one.parent is None else found[first + one.parent]
        low = center[1] - size[1] / 2
        stands = movable or kind.name == FRIDGE
        if above is None and stands and low < self.shell.floor_y + _STANDS_M:
            above = found[one.room]  # built-in furniture is no thing that lies on the floor
        basin = above is not None and BASIN_OF.get(above.type) == kind.name
        held = above is not None and "receptacle" in above.capabilities and not basin
        identity = f"{above.id}|{kind.name}" if above and basin else _identity(kind.name, place)
        kept = not basin and type_of(item.id) == kind.name and item.id not in taken
        return SceneObject(
            id=item.id if kept else _free(identity, taken),
            type=kind.name,
            name=item.id,
            asset=item.asset_id,
            position=place,
            rotation=rounded(item.rotation.tuple),
            center=place,
            size=rounded(size),
            corners=corners,
            capabilities=can,
            mass_kg=kind.mass_kg if movable else 0.0,
            materials=kind.materials if movable else None,
            parents=(above.id,) if above is not None and held else (),
            **_state(item, kind, above),
        )

    def _capabilities(self, item: HouseThing, kind: ObjectType) -> tuple[Capability, ...]:
        """Return what a thing can do: its type's, less what this one cannot."""
        without = set()
        if item.kinematic and "pickupable" not in kind.capabilities:
            without.add("moveable")
        if BASIN_OF.get(kind.name) in {self._type(child) for child in item.children}:
            without.add("receptacle")  # things lie in the basin
        return tuple(one for one in kind.capabilities if one not in without)

    def _size(self, one: _Placed) -> Vec3:
        asset = self.assets.get(one.item.asset_id)
        if asset is None:
            self.usual += 1
            return one.kind.size_m
        size = asset.bounding_box.tuple
        if not all(0 < side <= LARGEST_M for side in size):
            reason = f"asset {one.item.asset_id!r}: boundingBox {size} is no size"
            raise FileError(self.name, reason, fix="give it another database of assets")
        return size


def type_in(name: str) -> str:
    """Return the type that an asset's name begins with, or else holds; "" for none.

    >>> type_in("coffee_machine_25"), type_in("Countertop_I_4"), type_in("bedside_lamp_2")
    ('CoffeeMachine', 'CounterTop', '')
    >>> type_in("RoboTHORdresseraspelund"), type_in("Wall_Decor_Painting_1V"), type_in("Pencil_3")
    ('Dresser', 'Painting', 'Pencil')
    """
    known = {kind.lower(): kind for kind in object_types()}
    words = [one.lower() for one in _WORD.findall(name.replace("RoboTHOR", "RoboTHOR_"))]
    words = words[1:] if words[:1] == ["robothor"] else words
    ends = range(len(words), 0, -1)
    spans = [(0, end) for end in ends]
    spans += [(start, end) for end in ends for start in range(1, end)]
    for start, end in spans:
        one = "".join(words[start:end])
        if one in known and (not start or len(one) >= _TELLING):
            return known[one]
    if "RoboTHOR" not in name:
        return ""
    run = "".join(words)  # those names run together
    return known.get(max(filter(run.startswith, known), key=len, default=""), "")


def obstacles(objects: Sequence[SceneObject]) -> Iterator[Box]:
    """Yield the boxes that an agent walks round: furniture, and what stands on the floor."""
    floors = {one.id for one in objects if one.type == FLOOR}
    for one in objects:
        loose = "pickupable" in one.capabilities and floors.isdisjoint(one.parents)
        if one.id not in floors and not loose:
            yield box_of(one)


def _state(item: HouseThing, kind: ObjectType, above: SceneObject | None) -> dict[str, Any]:
    """Return the fields in which a thing differs from rest."""
    openness = float(kind.starts_open) if item.openness is None else item.openness
    state: dict[str, Any] = {}
    if "openable" in kind.capabilities and openness > 0:
        state["openness"] = min(openness, 1.0)
    if "toggleable" in kind.capabilities:
        state["is_toggled"] = kind.starts_on if item.is_on is None else item.is_on
    if "dirtyable" in kind.capabilities and item.is_dirty:
        state["is_dirty"] = True
    if above is not None and "isColdSource" in above.capabilities:
        state["temperature"] = "Cold"
    return state


def _with_controls(
    objects: Sequence[SceneObject], placed: Sequence[_Placed], first: int
) -> Iterator[SceneObject]:
    """Yield the objects; a room's knobs control its burners, the first the first, and so on."""
    burner_of: dict[str, str] = {}
    for room in dict.fromkeys(one.room for one in placed):
        mine = [obj for obj, one in zip(objects[first:], placed, strict=True) if one.room == room]
        knobs, burners = ([one.id for one in mine if one.type == of] for of in (KNOB, BURNER))
        if len(knobs) == len(burners):
            burner_of |= dict(zip(knobs, burners, strict=True))
    for one in objects:
        mate = burner_of.get(one.id)
        yield one if mate is None else msgspec.structs.replace(one, controls=(mate,))


def _turned(size: Vec3, rotation: Vec3, center: Vec3) -> tuple[Vec3, tuple[Vec3, ...] | None]:
    """Return the sides of the upright box round a turned one, and its corners where it slants."""
    if all(abs(angle) % 180 < 1e-3 for angle in (rotation[0], rotation[2])):
        if rotation[1] % 180 < 1e-3 or rotation[1] % 180 > 180 - 1e-3:
            return size, None
        if abs(rotation[1] % 180 - 90) < 1e-3:
            return (size[2], size[1], size[0]), None
    ground = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    signs = np.array([(x, y, z) for y in (-1, 1) for x, z in ground])
    corners = (signs * np.array(size) / 2) @ rotation_matrix(rotation).T
    sides = corners.max(axis=0) - corners.min(axis=0)
    there = tuple(rounded(tuple(corner)) for corner in corners + np.array(center))
    return (float(sides[0]), float(sides[1]), float(sides[2])), there


def _identity(type_name: str, place: Vec3) -> str:
    return "|".join([type_name, *(f"{round(value, 2) + 0.0:+06.2f}" for value in place)])


def _free(identity: str, taken: set[str]) -> str:
    """Return an id that is still free: of equal things in one place, the later have a mark."""
    found, number = identity, 1
    while found in taken:
        number += 1
        found = f"{identity}_{number}"
    return found
