"""A home's furniture as its robot knows it: where it is, and where to stand to look at it.

It is the robot's own map, made once per home, and all that its skills know from the start.
"""

from collections.abc import Mapping

from karma.contracts import Area, Known, Pose
from karma.household.places import FLOOR
from karma.memory.lived.setting import KnownPlace
from karma.methods.lived.look_spots import look_poses
from karma.world.core.scene import Scene, SceneObject
from karma.world.core.state import Settings, begin
from karma.world.houses import room_at


class HomeMap:
    """Furniture with poses to look at it from; see `Knowledge`.

    Args:
        scene: of the home, at its start.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.places: dict[str, KnownPlace] = {}
        self.spots: dict[str, tuple[Pose, ...]] = {}
        self._known: dict[str, Known] = {}
        state = begin(scene, Settings(grid_m=scene.grid_m))
        for thing in filter(_is_place, scene.objects):
            if poses := look_poses(state, thing):
                self.places[thing.id] = self._place(thing)
                self.spots[thing.id] = tuple(poses)
                self._known[thing.id] = _known(thing)

    def where(self, name: str) -> Known | None:
        """Return where a piece of furniture is, None of what else there is."""
        return self._known.get(name)

    def areas(self) -> tuple[Area, ...]:
        """Return nothing: furniture is looked at, not areas."""
        return ()

    def room_at(self, x: float, z: float) -> str:
        """Return the room of a place, metres."""
        room = room_at(self._scene, x, z)
        return room.name if room is not None else self._scene.name

    def in_rooms(self) -> Mapping[str, tuple[str, ...]]:
        """Return the ids of the places of each room."""
        found: dict[str, list[str]] = {}
        for place_id, place in self.places.items():
            found.setdefault(place.room, []).append(place_id)
        return {room: tuple(ids) for room, ids in found.items()}

    def _place(self, thing: SceneObject) -> KnownPlace:
        room = self.room_at(thing.center[0], thing.center[2])
        return KnownPlace(
            place_id=thing.id,
            place_type=thing.type,
            room=room,
            room_kind=room.rpartition("_")[0],
            openable="openable" in thing.capabilities,
        )


def _is_place(thing: SceneObject) -> bool:
    """Return whether things are looked for in or on something: furniture, not what is carried."""
    can = thing.capabilities
    return "receptacle" in can and "pickupable" not in can and thing.type != FLOOR


def _known(thing: SceneObject) -> Known:
    return Known(
        object_id=thing.id,
        object_type=thing.type,
        position_m=thing.center,
        source="graph",
        box_center_m=thing.center,
        box_size_m=thing.size,
    )
