"""Draw a home: rooms by the generator of rooms, laid side by side, as one scene."""

from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from karma.errors import KarmaError
from karma.household.ids import root_id
from karma.seeds import stream
from karma.world.core.boxes import Box, rounded
from karma.world.core.ground import nearest_to_centre
from karma.world.core.scene import AgentPose, Scene, SceneObject, SceneRoom
from karma.world.core.thing import moved
from karma.world.generation.generate import EYE_M, build_scene, object_id
from karma.world.houses.joining import Doorway, LaidRoom, lay, walls_of
from karma.world.houses.stocking import stocked

MOST_ROOMS = 12
ATTEMPTS = 40
_USUAL = ("kitchen", "living", "bedroom", "bathroom", "bedroom", "living")  # then drawn
_MORE = ("bedroom", "living", "bathroom", "bedroom", "kitchen")


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
            return stocked(scene, things, rng)
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


def _joined(laid: Sequence[LaidRoom], doorways: Sequence[Doorway], name: str, seed: int) -> Scene:
    cells = {(round(x + room.x, 4), round(z + room.z, 4)) for room in laid
             for x, z in room.scene.reachable}  # fmt: skip
    cells |= {cell for door in doorways for cell in door.cells}
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
