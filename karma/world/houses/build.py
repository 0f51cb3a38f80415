"""Draw a home: rooms by the generator of rooms, laid side by side, as one scene.

It has as many movable things as are wanted: more of what its rooms have, or fewer.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from hashlib import blake2b

import msgspec
import numpy as np

from karma.errors import KarmaError
from karma.household.ids import root_id
from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.seeds import stream
from karma.world.core.boxes import Box, rounded
from karma.world.core.ground import Cell, inside, nearest_to_centre, walk
from karma.world.core.placement import find_place
from karma.world.core.scene import AgentPose, Scene, SceneObject, SceneRoom
from karma.world.core.state import Settings, WorldState, begin
from karma.world.core.thing import difference, moved
from karma.world.generation.generate import EYE_M, build_scene, object_id
from karma.world.houses.joining import LaidRoom, lay, walls_of

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
        source=f"karma.world.houses seed {seed}",
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
