"""A home's furniture as its robot knows it: where it is, and where to stand to look at it.

It is the robot's own map, made once per home, and all that its skills know from the start.
"""

from collections.abc import Mapping

from karma.bench.suites.lived.look_spots import look_poses
from karma.contracts import Area, Known, Pose
from karma.memory.lived.setting import KnownPlace
from karma.world.core.scene import Scene
from karma.world.core.state import Settings, begin
from karma.world.houses import room_name
from karma.world.residents import resting_places


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
        for place_id, place in resting_places(scene).items():
            thing = state.objects[place_id]
            if poses := look_poses(state, thing):
                self.places[place_id] = KnownPlace(
                    place_id=place_id, place_type=thing.type, room=place.room,
                    room_kind=place.kind, openable="openable" in thing.capabilities,
                )  # fmt: skip
                self.spots[place_id] = tuple(poses)
                self._known[place_id] = Known(
                    object_id=place_id, object_type=thing.type, position_m=thing.center,
                    source="graph", box_center_m=thing.center, box_size_m=thing.size,
                )  # fmt: skip

    def where(self, name: str) -> Known | None:
        """Return where a piece of furniture is, None of what else there is."""
        return self._known.get(name)

    def areas(self) -> tuple[Area, ...]:
        """Return nothing: furniture is looked at, not areas."""
        return ()

    def room_at(self, x: float, z: float) -> str:
        """Return the room of a place, metres."""
        return room_name(self._scene, x, z)

    def in_rooms(self) -> Mapping[str, tuple[str, ...]]:
        """Return the ids of the places of each room."""
        found: dict[str, list[str]] = {}
        for place_id, place in self.places.items():
            found.setdefault(place.room, []).append(place_id)
        return {room: tuple(ids) for room, ids in found.items()}
