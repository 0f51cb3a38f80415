"""Draw a home of several rooms as one scene: rooms by the generator, joined by doorways.

It has as many movable things as are wanted: more of what its rooms have, or fewer.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b

import msgspec
import numpy as np

from karma.errors import KarmaError
from karma.household.ids import root_id
from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.plugins.rooms.generate import EYE_M, build_scene, object_id
from karma.seeds import stream
from karma.world.core.boxes import Box, rounded
from karma.world.core.ground import GRID_M, Cell, inside, nearest_to_centre, walk
from karma.world.core.placement import find_place
from karma.world.core.scene import AgentPose, Scene, SceneObject, SceneRoom, Wall
from karma.world.core.state import Settings, WorldState, begin
from karma.world.core.thing import box_of, difference, moved

WALL_M = 0.05  # thickness on either side of a wall's middle
LEAST_GAP_M = 0.1  # between the insides of two rooms
DOOR_M = 0.9  # wide
_FREE_M = 0.1  # things so near to a wall stand in the way of a doorway
_BODY_M = 0.2
_ALONG = (-GRID_M, 0.0, GRID_M)  # cells side by side in a doorway
SIDES = ("x0", "x1", "z0", "z1")
OPPOSITE = {"x0": "x1", "x1": "x0", "z0": "z1", "z1": "z0"}


@dataclass(slots=True)
class LaidRoom:
    """One drawn room with its place in the home; `doors` grows as others are joined to it."""

    scene: Scene
    name: str
    x: float = 0.0  # by how much it was moved, whole multiples of the grid
    z: float = 0.0
    doors: dict[str, list[float]] = field(default_factory=dict)  # side -> middles, home's metres

    @property
    def inside(self) -> Box:
        """The room between its walls, in the home."""
        box = Box.around(self.scene.bounds_center, self.scene.bounds_size)
        return box.shifted(self.x, self.z)

    def openings(self, side: str) -> list[float]:
        """Return where along a side a doorway may be, in the room's own metres."""
        box = Box.around(self.scene.bounds_center, self.scene.bounds_size)
        cells = {_key(x, z) for x, z in self.scene.reachable}
        edge = _edge_column(box, side)
        low, high = (box.z0, box.z1) if side[0] == "x" else (box.x0, box.x1)
        first, last = int(np.ceil(low / GRID_M)), int(np.floor(high / GRID_M))
        found = []
        for number in range(first, last + 1):
            along = number * GRID_M
            beside = [_key(*_point(side, edge, along + step)) for step in _ALONG]
            if all(key in cells for key in beside) and not self._taken(side, box, along):
                found.append(along)
        return found

    def _taken(self, side: str, box: Box, along: float) -> bool:
        """Return whether something stands or hangs at the wall where a doorway would be."""
        half = DOOR_M / 2
        wall = getattr(box, side)
        reach = (wall - _FREE_M, wall + _FREE_M)
        span = (along - half, along + half)
        xs, zs = (reach, span) if side[0] == "x" else (span, reach)
        gate = Box(xs[0], box.y0 + 0.05, zs[0], xs[1], box.y1, zs[1])
        return any(gate.overlaps(box_of(thing)) for thing in self.scene.objects)


def lay(rooms: Sequence[LaidRoom], rng: np.random.Generator) -> list[list[Cell]] | None:
    """Move rooms beside one another and return the cells of each doorway; None where one has none.

    Each room but the first is put where the home stays most compact; of equals, a drawn one.
    """
    doorways = []
    for number, room in enumerate(rooms[1:], start=1):
        choices = list(_choices(rooms[:number], room))
        if not choices:
            return None
        sizes = np.array([choice[0] for choice in choices])
        best = np.flatnonzero(sizes <= sizes.min() * 1.15)
        _, host, side, along, x, z = choices[int(rng.choice(best))]
        room.x, room.z = x, z
        host.doors.setdefault(side, []).append(along)
        room.doors.setdefault(OPPOSITE[side], []).append(along)
        doorways.append(_doorway(host, room, side, along))
    return doorways


_Choice = tuple[float, LaidRoom, str, float, float, float]


def _choices(there: Sequence[LaidRoom], room: LaidRoom) -> Iterator[_Choice]:
    """Yield the ways to join a room: size of the home then, host, side, door, and the shift."""
    own = Box.around(room.scene.bounds_center, room.scene.bounds_size)
    for host in there:
        for side in SIDES:
            taken, by = host.doors.get(side, []), host.z if side[0] == "x" else host.x
            theirs = [along + by for along in host.openings(side)]
            free = [one for one in theirs if all(abs(one - other) > DOOR_M for other in taken)]
            for home_along in free[::2]:
                for mine in room.openings(OPPOSITE[side])[::2]:
                    x, z = _shift(host, own, side, home_along - mine)
                    box = own.shifted(x, z)
                    if any(_too_near(box, other.inside) for other in there):
                        continue
                    size = _extent([*(one.inside for one in there), box])
                    yield (size, host, side, home_along, x, z)


def _shift(host: LaidRoom, own: Box, side: str, along: float) -> tuple[float, float]:
    """Return by how much a room is moved to lie at a side of its host."""
    wall = getattr(host.inside, side)
    facing = getattr(own, OPPOSITE[side])
    if side in ("x1", "z1"):
        across = np.ceil((wall + LEAST_GAP_M - facing) / GRID_M - 1e-9) * GRID_M
    else:
        across = np.floor((wall - LEAST_GAP_M - facing) / GRID_M + 1e-9) * GRID_M
    across, along = round(float(across), 4), round(along, 4)
    return (across, along) if side[0] == "x" else (along, across)


def _too_near(box: Box, other: Box) -> bool:
    by = LEAST_GAP_M / 2 - 1e-6
    return box.grown(by, 0.0, by).overlaps(other.grown(by, 0.0, by))


def _extent(boxes: Sequence[Box]) -> float:
    """Return the longer side of the ground that boxes take up, and a little of the shorter."""
    x, _, z = Box.hull(boxes).size
    return max(x, z) + 0.3 * min(x, z)


def _doorway(host: LaidRoom, room: LaidRoom, side: str, along: float) -> list[Cell]:
    """Return the cells that lead through a doorway."""
    start = _edge_column(host.inside, side)
    end = _edge_column(room.inside, OPPOSITE[side])
    low, high = sorted((round(start / GRID_M), round(end / GRID_M)))
    return [
        _point(side, number * GRID_M, along + step)
        for number in range(low, high + 1)
        for step in _ALONG
    ]


def _edge_column(box: Box, side: str) -> float:
    """Return where the cells nearest to a wall lie, across it."""
    if side in ("x1", "z1"):
        return float(np.floor((getattr(box, side) - _BODY_M) / GRID_M + 1e-6) * GRID_M)
    return float(np.ceil((getattr(box, side) + _BODY_M) / GRID_M - 1e-6) * GRID_M)


def _point(side: str, across: float, along: float) -> tuple[float, float]:
    point = (across, along) if side[0] == "x" else (along, across)
    return (round(point[0], 4) + 0.0, round(point[1], 4) + 0.0)


def _key(x: float, z: float) -> tuple[int, int]:
    return (round(x / GRID_M), round(z / GRID_M))


def walls_of(room: LaidRoom) -> Iterator[Wall]:
    """Yield the boxes round a room, with gaps where doorways are."""
    box = room.inside
    for side in SIDES:
        wall = getattr(box, side)
        out = (wall, wall + WALL_M) if side in ("x1", "z1") else (wall - WALL_M, wall)
        low, high = (box.z0, box.z1) if side[0] == "x" else (box.x0, box.x1)
        start = low - WALL_M
        for middle in [*sorted(room.doors.get(side, [])), None]:
            end = high + WALL_M if middle is None else middle - DOOR_M / 2
            if end - start > 1e-6:
                xs, zs = (out, (start, end)) if side[0] == "x" else ((start, end), out)
                yield Wall(
                    low=rounded((xs[0], box.y0, zs[0])), high=rounded((xs[1], box.y1, zs[1]))
                )
            start = end if middle is None else middle + DOOR_M / 2


MOST_ROOMS = 12
ATTEMPTS = 40
_USUAL = ("kitchen", "living", "bedroom", "bathroom", "bedroom", "living")  # then drawn
_MORE = ("bedroom", "living", "bathroom", "bedroom", "kitchen")
_IN_VAIN = 40  # draws that find no room before a home counts as full


def build_home(rooms: int, seed: int, *, name: str = "home_1", things: int | None = None) -> Scene:
    """Return a home of 1 to 12 rooms; equal arguments give equal homes on every machine.

    It has so many movable `things` as find room; None: what its rooms are drawn with.

    Raises:
        KarmaError: no such number of rooms, or no draw worked out.
    """
    if not 1 <= rooms <= MOST_ROOMS:
        raise KarmaError(f"a home has 1 to {MOST_ROOMS} rooms, not {rooms}\n  To fix: --rooms N")
    for attempt in range(ATTEMPTS):
        rng = stream(seed, "houses", str(rooms), str(attempt))
        laid = [_room(kind, number, seed, attempt) for number, kind in _kinds(rooms, rng)]
        doorways = lay(laid, rng)
        if doorways is None:
            continue
        scene = _joined(laid, doorways, name, seed)
        if len({thing.id for thing in scene.objects}) == len(scene.objects):
            return _stocked(scene, things, rng)
    raise KarmaError(f"no home of {rooms} rooms with seed {seed} in {ATTEMPTS} draws")


def _kinds(rooms: int, rng: np.random.Generator) -> Iterator[tuple[int, str]]:
    """Yield the rooms' kinds with their numbers among those of a kind."""
    counts: dict[str, int] = {}
    for place in range(rooms):
        kind = _USUAL[place] if place < len(_USUAL) else _MORE[int(rng.integers(len(_MORE)))]
        counts[kind] = counts.get(kind, 0) + 1
        yield counts[kind], kind


def _room(kind: str, number: int, seed: int, attempt: int) -> LaidRoom:
    scene = build_scene(kind, number, seed * ATTEMPTS + attempt)
    return LaidRoom(scene=scene, name=f"{kind}_{number}")


def _joined(laid: Sequence[LaidRoom], doorways: list[list[Cell]], name: str, seed: int) -> Scene:
    cells = {(round(x + room.x, 4), round(z + room.z, 4)) for room in laid
             for x, z in room.scene.reachable}  # fmt: skip
    cells |= {cell for door in doorways for cell in door}
    reachable = tuple(sorted((x + 0.0, z + 0.0) for x, z in cells))
    bounds = Box.hull(room.inside for room in laid)
    x, z = nearest_to_centre(reachable)
    return Scene(
        name=name,
        room=laid[0].scene.room,
        source=f"karma.plugins.homes.houses seed {seed}",
        agent=AgentPose(position=(x, EYE_M, z), yaw=0.0),
        reachable=reachable,
        bounds_center=rounded(bounds.center),
        bounds_size=rounded(bounds.size),
        objects=tuple(thing for room in laid for thing in _moved(room)),
        rooms=tuple(_scene_room(room) for room in laid),
        walls=tuple(wall for room in laid for wall in walls_of(room)),
    )


def _scene_room(room: LaidRoom) -> SceneRoom:
    box = room.inside
    corners = ((box.x0, box.z0), (box.x1, box.z0), (box.x1, box.z1), (box.x0, box.z1))
    return SceneRoom(name=room.name, room=room.scene.room, corners=corners)


def _moved(room: LaidRoom) -> Iterator[SceneObject]:
    """Yield a room's things where they are in the home, with the ids that belong there."""
    by = (room.x, 0.0, room.z)
    things = [moved(thing, by) for thing in room.scene.objects]
    whole = {
        root_id(thing.id): object_id(thing.type, rounded(there.position))
        for thing, there in zip(room.scene.objects, things, strict=True)
        if root_id(thing.id) == thing.id
    }

    def renamed(old: str) -> str:
        return whole[root_id(old)] + old[len(root_id(old)) :]

    for thing, there in zip(room.scene.objects, things, strict=True):
        yield msgspec.structs.replace(
            there,
            id=renamed(thing.id),
            name=f"{thing.name}_{room.name}",
            position=rounded(there.position),
            center=rounded(there.center),
            parents=tuple(map(renamed, thing.parents)),
            controls=tuple(map(renamed, thing.controls)),
        )


# ----------------------------------------------------------------- its things


def _stocked(scene: Scene, things: int | None, rng: np.random.Generator) -> Scene:
    """Return the scene with that many movable things, or as many as find room."""
    loose = [one for one in scene.objects if "pickupable" in one.capabilities]
    if things is None or things == len(loose):
        return scene
    if things < len(loose):
        return _fewer(scene, loose, len(loose) - things, rng)
    return _more(scene, loose, things - len(loose), rng)


def _fewer(scene: Scene, loose: list[SceneObject], number: int, rng: np.random.Generator) -> Scene:
    held = {parent for thing in scene.objects for parent in thing.parents}
    free = [thing.id for thing in loose if thing.id not in held]
    gone = {free[int(i)] for i in rng.permutation(len(free))[:number]}
    return msgspec.structs.replace(
        scene, objects=tuple(thing for thing in scene.objects if thing.id not in gone)
    )


def _more(scene: Scene, loose: list[SceneObject], number: int, rng: np.random.Generator) -> Scene:
    """Copy things that the home has, each onto or into furniture that takes it."""
    types = object_types()
    state = begin(scene, Settings(grid_m=scene.grid_m))
    places = [
        one for one in scene.objects
        if "receptacle" in one.capabilities and "pickupable" not in one.capabilities
        and "openable" not in one.capabilities and one.type != FLOOR
    ]  # fmt: skip
    names = {thing.name for thing in scene.objects}
    added: list[SceneObject] = []
    vain = 0
    while len(added) < number and vain < _IN_VAIN:
        model = loose[int(rng.integers(len(loose)))]
        fitting = [one for one in places if types[model.type].fits(types[one.type])]
        if fitting:
            place = fitting[int(rng.integers(len(fitting)))]
            copy = _copied(state, model, place, names)
            if copy is not None:
                added.append(copy)
                names.add(copy.name)
                state = replace(state, objects=state.objects.changed({copy.id: copy}))
                vain = 0
                continue
        vain += 1
    return msgspec.structs.replace(scene, objects=(*scene.objects, *added))


def _copied(
    state: WorldState, model: SceneObject, place: SceneObject, names: set[str]
) -> SceneObject | None:
    middle = find_place(state, model, place)
    if middle is None:
        return None
    there = moved(model, difference(middle, model.center))
    position = rounded(there.position)
    identity = object_id(model.type, position)
    if identity in state.objects:
        return None
    digest = blake2b(identity.encode(), digest_size=4).hexdigest()
    name = f"{model.type}_{digest}"
    if name in names:
        return None
    return msgspec.structs.replace(
        there, id=identity, name=name, position=position, center=rounded(there.center),
        parents=(place.id,),
    )  # fmt: skip


# ----------------------------------------------------------------- its rooms, once built


def room_at(scene: Scene, x: float, z: float) -> SceneRoom | None:
    """Return the room whose floor a point is on; None outside, or where a scene is one room."""
    for room in scene.rooms or ():
        if inside(room.corners, x, z):
            return room
    return None


def room_name(scene: Scene, x: float, z: float) -> str:
    """Return the name of the room that a point is in; of the scene where it is in none."""
    room = room_at(scene, x, z)
    return room.name if room is not None else scene.name


def rooms_reached(scene: Scene) -> frozenset[str]:
    """Return the names of the rooms that steps over the cells lead to from the agent's start."""
    grid = scene.grid_m
    cells = {(round(x / grid), round(z / grid)): (x, z) for x, z in scene.reachable}
    start_x, _, start_z = scene.agent.position
    start = (round(start_x / grid), round(start_z / grid))
    reached = walk(cells, start) if start in cells else {}
    rooms = (room_at(scene, *cells[cell]) for cell in reached)
    return frozenset(room.name for room in rooms if room is not None)
