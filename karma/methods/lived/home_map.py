"""Where the robot stands to look at each place of a home, and what it costs to get there.

It is the robot's own map of furniture, made once per home. Costs are world actions: steps ahead,
quarter turns and tilts of the head, by the shortest way over the cells of the floor.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from karma.contracts import Pose
from karma.household.places import FLOOR
from karma.memory.lived.setting import KnownPlace
from karma.methods.lived.look_spots import look_poses
from karma.world.core.scene import Scene, SceneObject
from karma.world.core.state import Settings, WorldState, begin
from karma.world.houses import room_at

_AHEAD = ((0, 1), (1, 0), (0, -1), (-1, 0))  # of yaw 0, 90, 180, 270


@dataclass(frozen=True, slots=True, kw_only=True)
class LookSpot:
    """One way to stand and look at a place."""

    number: int  # of its row in the table of costs
    pose: Pose
    room: str


class HomeMap:
    """Furniture with spots to look at it from.

    Args:
        scene: of the home, at its start.
    """

    def __init__(self, scene: Scene) -> None:
        state = begin(scene, Settings(grid_m=scene.grid_m))
        self._cells = state.cells
        self.places: dict[str, KnownPlace] = {}
        self.spots: dict[str, tuple[LookSpot, ...]] = {}
        self._poses: list[Pose] = [state.pose]
        for thing in scene.objects:
            if not _is_place(thing):
                continue
            poses = look_poses(state, thing)
            if poses:
                self.places[thing.id] = _known(scene, thing)
                self.spots[thing.id] = tuple(
                    LookSpot(number=number, pose=pose, room=_room(scene, pose))
                    for number, pose in enumerate(poses, len(self._poses))
                )
                self._poses += poses
        self.start = LookSpot(number=0, pose=state.pose, room=_room(scene, state.pose))
        self._costs = self._all_costs(state)

    def cost(self, start: LookSpot, end: LookSpot) -> int:
        """Return how many world actions the shortest way from one spot to another takes."""
        return int(self._costs[start.number, end.number])

    def in_rooms(self) -> Mapping[str, tuple[str, ...]]:
        """Return the ids of the places of each room."""
        found: dict[str, list[str]] = {}
        for place_id, place in self.places.items():
            found.setdefault(place.room, []).append(place_id)
        return {room: tuple(ids) for room, ids in found.items()}

    # ------------------------------------------------------------- costs

    def _all_costs(self, state: WorldState) -> NDArray[np.int32]:
        """Return the table of costs between all spots, shape (spots, spots)."""
        numbers = {cell: number for number, cell in enumerate(sorted(self._cells))}
        starts: list[int] = []
        ends: list[int] = []
        for cell, number in numbers.items():
            for heading, (dx, dz) in enumerate(_AHEAD):
                node = 4 * number + heading
                for turned in ((heading + 1) % 4, (heading - 1) % 4):
                    starts.append(node)
                    ends.append(4 * number + turned)
                ahead = numbers.get((cell[0] + dx, cell[1] + dz))
                if ahead is not None:
                    starts.append(node)
                    ends.append(4 * ahead + heading)
        size = 4 * len(numbers)
        graph = csr_matrix((np.ones(len(starts)), (starts, ends)), shape=(size, size))
        nodes = [
            4 * numbers[state.room.key(pose.position_m[0], pose.position_m[2])]
            + round(pose.yaw_deg / 90.0) % 4
            for pose in self._poses
        ]
        steps = dijkstra(graph, unweighted=True, indices=nodes)[:, nodes]
        tilt = np.array([pose.horizon_deg for pose in self._poses])
        tilts = np.abs(tilt[:, None] - tilt[None]) / 30.0
        total = np.where(np.isfinite(steps), steps, 1e6) + np.round(tilts)
        costs: NDArray[np.int32] = total.astype(np.int32)
        return costs


def _is_place(thing: SceneObject) -> bool:
    """Return whether things are looked for in or on something: furniture, not what is carried."""
    can = thing.capabilities
    return "receptacle" in can and "pickupable" not in can and thing.type != FLOOR


def _known(scene: Scene, thing: SceneObject) -> KnownPlace:
    room = room_at(scene, thing.center[0], thing.center[2])
    kind = room.name.rpartition("_")[0] if room is not None else ""
    return KnownPlace(
        place_id=thing.id,
        place_type=thing.type,
        room=room.name if room is not None else scene.name,
        room_kind=kind or scene.name.rpartition("_")[0],
        openable="openable" in thing.capabilities,
    )


def _room(scene: Scene, pose: Pose) -> str:
    room = room_at(scene, pose.position_m[0], pose.position_m[2])
    return room.name if room is not None else scene.name
