"""Draw a room from one seed: furniture, then contents, then a check.

`scripts/make_scenes.py` writes the sixteen that ship; training draws hundreds more.
"""

from collections.abc import Iterator, Sequence
from hashlib import blake2b
from typing import Any

import numpy as np

from karma.errors import KarmaError, UnknownNameError
from karma.household.places import FLOOR
from karma.household.types import object_type
from karma.household.uses import BURNER, KNOB
from karma.plugins.rooms.furnish import (
    LocalFrame,
    NoRoomError,
    Placed,
    RoomInMaking,
    extent,
    reachable_cells,
)
from karma.plugins.rooms.rooms import Furnishing, Rest, RoomTable, Wares, rooms
from karma.seeds import stream
from karma.types.space import Vec3
from karma.world.core.boxes import Box, rounded
from karma.world.core.ground import Cell, distances, nearest_to_centre
from karma.world.core.scene import AgentPose, Scene, SceneObject

ATTEMPTS = 200
REACH_M = 1.4  # an agent's reach is 1.5; a little less, so that it can also see
OBJECTS = {"kitchen": (40, 80), "living": (25, 50), "bedroom": (25, 50), "bathroom": (25, 50)}
EYE_M = 0.9  # the agent's origin above the floor
LAMPS_ON, BEDS_UNMADE = 0.85, 0.6  # shares at reset


def build_scene(kind: str, number: int, seed: int) -> Scene:
    """Return a room of a kind, named by its number; equal arguments give equal rooms everywhere.

    Raises:
        UnknownNameError: there is no such kind.
        KarmaError: no draw worked out (not seen in thousands).
    """
    table = rooms()
    if kind not in table.kinds:
        raise UnknownNameError(f"no kind of room named {kind!r}. There are: {sorted(table.kinds)}")
    name = f"{kind}_{number}"
    for attempt in range(ATTEMPTS):
        rng = stream(seed, "scenes", name, str(attempt))
        try:
            return _draw(kind, name, seed, table, rng)
        except NoRoomError:
            continue
    raise KarmaError(f"no room {name} with seed {seed} in {ATTEMPTS} draws: loosen rooms.toml")


def object_id(type_name: str, position: Vec3) -> str:
    """Return AI2-THOR's id of an object that starts at this position.

    Two decimals with a sign; what rounds to zero from below has none. Halves go to even here, not
    away from zero as in alfred/trial.py: another rule would rename things in the rooms that ship.

    >>> object_id("Apple", (-0.465, 1.15, -0.001))
    'Apple|-00.47|+01.15|00.00'
    """
    return "|".join([type_name, *map(_id_number, position)])


def _id_number(value: float) -> str:
    digits = f"{abs(value):05.2f}"
    if value >= 0:
        return f"+{digits}"
    return digits if digits == "00.00" else f"-{digits}"


def _draw(kind: str, name: str, seed: int, table: RoomTable, rng: np.random.Generator) -> Scene:
    layout = RoomInMaking(table.kinds[kind], table, rng)
    layout.furnish()
    contents = _Contents(layout)
    contents.fill()
    objects = tuple(_objects(layout, contents.things, f"{name}/{seed}"))
    least, most = OBJECTS[kind]
    if not least <= len(objects) <= most or len({one.id for one in objects}) < len(objects):
        raise NoRoomError("count")
    cells = _cells(layout)
    x, z = nearest_to_centre(cells)
    return Scene(
        name=name,
        room=table.kinds[kind].room,
        source=f"scripts/make_scenes.py seed {seed}",
        agent=AgentPose(position=(x, EYE_M, z), yaw=float(rng.integers(4) * 90)),
        reachable=cells,
        bounds_center=layout.room.center,
        bounds_size=layout.room.size,
        objects=objects,
    )


def _cells(layout: RoomInMaking) -> tuple[Cell, ...]:
    """Return the cells to stand on, from which everything to be used is in reach."""
    cells = reachable_cells(layout.room, (one.box for one in _obstacles(layout.placed)))
    used = [
        one.box
        for one in layout.placed[1:]
        if {"receptacle", "pickupable", "toggleable", "openable"}
        & set(object_type(one.type).capabilities)
    ]
    if len(cells) < 12 or distances(cells, used).max() > REACH_M:
        raise NoRoomError("reach")
    return cells


def _obstacles(placed: Sequence[Placed]) -> Iterator[Placed]:
    for one in placed[1:]:
        if one.part is not None or one.parent == 0:
            yield one


# ----------------------------------------------------------------- contents


class _Contents:
    """What lies in and on the furniture of a room."""

    def __init__(self, layout: RoomInMaking) -> None:
        self.layout, self.rng = layout, layout.rng
        self.things: dict[int, tuple[Wares, int]] = {}  # index -> its row, and which copy it is

    def fill(self) -> None:
        """Place appliances, then things.

        Raises:
            NoRoomError: something that the room must have finds no place.
        """
        kind = self.layout.kind
        for entry in kind.furniture:
            if entry.at == "on":
                self._appliance(entry)
        for name, thing in kind.things.items():
            least, most = thing.count
            for copy in range(int(self.rng.integers(least, most + 1))):
                if self._thing(name, thing):
                    self.things[len(self.layout.placed) - 1] = (thing, copy)
                elif copy < least:
                    raise NoRoomError(name)

    def _appliance(self, entry: Furnishing) -> None:
        piece = self.layout.table.piece(entry.piece)
        part = piece.parts[0]
        places = [i for name in entry.on for i in self._places(name)]
        for _ in range(60 if places else 0):
            place = int(self.rng.choice(places))
            on = self.layout.placed[place]
            across, deep = extent(on.box, on.yaw)
            if across < piece.width[0] + 0.1 or deep < piece.depth:
                continue
            u = self.layout.draw((0.04, across - piece.width[0] - 0.04))
            v = (0.02, 0.02 + piece.depth)
            y = (on.box.y1, on.box.y1 + part.y[1])
            box = LocalFrame.of(on.box, on.yaw).box((u, u + piece.width[0]), y, v)
            if self._add(part.type, box, on.yaw, place, gap=0.02):
                return
        raise NoRoomError(entry.piece)

    def _thing(self, name: str, thing: Wares) -> bool:
        weights = {place: odds for place, odds in thing.places.items() if self._places(place)}
        if not weights:
            return False
        odds = np.array(list(weights.values())) / sum(weights.values())
        for place in self.rng.choice(list(weights), size=10, p=odds):
            index = int(self.rng.choice(self._places(str(place))))
            if any(self._rest(name, index) for _ in range(6)):
                return True
        return False

    def _places(self, type_name: str) -> list[int]:
        return [i for i, one in enumerate(self.layout.placed) if one.type == type_name]

    def _rest(self, name: str, place: int) -> bool:
        """Put a thing down at a random spot of a receptacle, if it fits there."""
        on = self.layout.placed[place]
        rest = self.layout.table.rest(on.type)
        x, height, z = object_type(name).size_m
        turn = 0 if rest.single else int(self.rng.integers(4)) * 90
        across, deep = (x, z) if turn % 180 == 0 else (z, x)
        if rest.single:
            spot = self._attach(on, place, rest, across, deep)
        else:
            spot = self._spot(on, rest, across, deep)
        y = self._level(on.box, rest, height)
        if spot is None or y is None:
            return False
        u, v = spot
        box = LocalFrame.of(on.box, on.yaw).box((u, u + across), (y, y + height), (v, v + deep))
        return self._add(name, box, (on.yaw + turn) % 360, place, gap=0.005)

    def _spot(
        self, on: Placed, rest: Rest, across: float, deep: float
    ) -> tuple[float, float] | None:
        width, depth = extent(on.box, on.yaw)
        low = depth * (1 - rest.front) + rest.inset
        sides = max(rest.sides, rest.inset)
        free_u = width - 2 * sides - across
        free_v = depth * rest.back - rest.inset - low - deep
        if free_u < 0 or free_v < 0:
            return None
        u, v = self.rng.random(2)
        return sides + float(u) * free_u, low + float(v) * free_v

    def _attach(
        self, on: Placed, place: int, rest: Rest, across: float, deep: float
    ) -> tuple[float, float] | None:
        if any(one.parent == place for one in self.layout.placed):
            return None
        width, depth = extent(on.box, on.yaw)
        v = (depth * (2 - rest.front) - deep) / 2
        # what hangs keeps clear of the wall, whatever is thicker than its holder
        return (width - across) / 2, max(v, 0.01) if rest.hang else v

    def _level(self, box: Box, rest: Rest, height: float) -> float | None:
        """Return where the thing's lower side comes to, or None where it does not fit."""
        if rest.hang:
            return round(box.y1 - height, 4)
        tops = [*rest.levels[1:], 1.0]
        which = int(self.rng.integers(len(rest.levels)))
        tall = box.y1 - box.y0
        if rest.inside and height > (tops[which] - rest.levels[which]) * tall - 0.01:
            return None
        return round(box.y0 + rest.levels[which] * tall, 4)

    def _add(self, name: str, box: Box, yaw: int, place: int, gap: float) -> bool:
        layout, on = self.layout, self.layout.placed[place]
        wide = box.grown(gap, 0.0, gap)
        room = layout.room
        if box.x0 < room.x0 or box.x1 > room.x1 or box.z0 < room.z0 or box.z1 > room.z1:
            return False
        for other in layout.placed:
            shell = other.part is not None and other.box.overlaps(on.box)
            if other is not on and not shell and wide.overlaps(other.box):
                return False
        layout.groups += 1
        layout.placed.append(Placed(type=name, box=box, yaw=yaw, group=layout.groups, parent=place))
        return True


# ----------------------------------------------------------------- records


def _objects(
    layout: RoomInMaking, things: dict[int, tuple[Wares, int]], salt: str
) -> Iterator[SceneObject]:
    ids = _ids(layout.placed)
    stove = _knobs(layout.placed)
    for index, one in enumerate(layout.placed):
        kind = object_type(one.type)
        without = one.part.without if one.part else ()
        movable = kind.can("pickupable") or kind.can("moveable")
        digest = blake2b(f"{salt}/{index}".encode(), digest_size=4).hexdigest()
        yield SceneObject(
            id=ids[index],
            type=one.type,
            name=f"{one.type}_{digest}",
            position=_position(one),
            rotation=(0.0, float(one.yaw), 0.0),
            center=rounded(one.box.center),
            size=rounded(one.box.size),
            capabilities=tuple(c for c in kind.capabilities if c not in without),
            mass_kg=kind.mass_kg if movable else 0.0,
            materials=kind.materials if movable else None,
            parents=() if one.parent is None else (ids[one.parent],),
            controls=(ids[stove[index]],) if index in stove else (),
            **_state(layout, one, things.get(index)),
        )


def _ids(placed: Sequence[Placed]) -> list[str]:
    ids: list[str] = []
    for one in placed:
        if one.child_of is not None:
            ids.append(f"{ids[one.child_of]}|{one.type}")
        else:
            ids.append(object_id(one.type, _position(one)))
    return ids


def _position(one: Placed) -> Vec3:
    """Return the origin: on the floor for what stands there, else the middle."""
    if one.type == FLOOR:
        return (0.0, 0.0, 0.0)
    x, y, z = one.box.center
    return rounded((x, 0.0 if one.box.y0 == 0.0 else y, z))


def _knobs(placed: Sequence[Placed]) -> dict[int, int]:
    """Return which burner each knob controls: the first the first, and so on."""
    knobs = [i for i, one in enumerate(placed) if one.type == KNOB]
    burners = [i for i, one in enumerate(placed) if one.type == BURNER]
    return dict(zip(knobs, burners, strict=True))


def _state(layout: RoomInMaking, one: Placed, row: tuple[Wares, int] | None) -> dict[str, Any]:
    """Return the fields in which an object differs from rest at reset."""
    kind, rng = object_type(one.type), layout.rng
    state: dict[str, Any] = {}
    if kind.starts_open or (one.part is not None and one.part.open):
        state["openness"] = 1.0
    if kind.starts_on and (one.type == "LightSwitch" or rng.random() < LAMPS_ON):
        state["is_toggled"] = True
    if one.type == "Bed" and rng.random() < BEDS_UNMADE:
        state["is_dirty"] = True
    if one.parent is not None and object_type(layout.placed[one.parent].type).can("isColdSource"):
        state["temperature"] = "Cold"
    if row is not None:
        thing, copy = row
        dirty, filled, on = rng.random(3)
        # of several copies every second one is dirty, so that they can be told apart
        if kind.can("dirtyable") and thing.dirty and (copy % 2 or dirty < thing.dirty):
            state["is_dirty"] = True
        if filled < thing.filled:
            state |= {"is_filled": True, "liquid": thing.liquid}
        if on < thing.on:
            state["is_toggled"] = True
    return state
