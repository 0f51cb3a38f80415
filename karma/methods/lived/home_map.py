"""Where the robot stands to look at each place of a home, and what it costs to get there.

It is the robot's own map of furniture, made once per home. Costs are world actions: steps ahead,
quarter turns and tilts of the head, by the shortest way over the cells of the floor.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from karma.contracts import Pose
from karma.household.places import FLOOR
from karma.memory.lived.setting import KnownPlace
from karma.world.core.navigate import interactable_poses
from karma.world.core.scene import Scene, SceneObject
from karma.world.core.state import Cell, Settings, WorldState, begin
from karma.world.houses import room_at

REACH_M = 1.25  # of the cells that a place is looked at from, to its box
_CELLS = 6  # tried for one look
_TRIED = 24  # cells thought of for one place
_SPAN_M = 1.6  # of a place, that one look takes in
_HORIZONS = (30.0, 0.0, 60.0, -30.0)
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
            spots = tuple(self._spots_of(state, scene, thing))
            if spots:
                self.spots[thing.id] = spots
                self.places[thing.id] = _known(scene, thing)
        self.start = LookSpot(number=0, pose=state.pose, room=_room(scene, state.pose))
        self._costs = self._all_costs(state)

    def cost(self, start: LookSpot, end: LookSpot) -> int:
        """Return how many world actions the shortest way from one spot to another takes."""
        return int(self._costs[start.number, end.number])

    def costs_from(self, start: LookSpot) -> NDArray[np.int32]:
        """Return the costs to all spots, by their numbers."""
        row: NDArray[np.int32] = self._costs[start.number]
        return row

    def in_rooms(self) -> Mapping[str, tuple[str, ...]]:
        """Return the ids of the places of each room."""
        found: dict[str, list[str]] = {}
        for place_id, place in self.places.items():
            found.setdefault(place.room, []).append(place_id)
        return {room: tuple(ids) for room, ids in found.items()}

    def round_trip(self, place_ids: Sequence[str]) -> tuple[LookSpot, ...]:
        """Return the spots of some places in the order of a walk: the nearest next one first."""
        left = [spot for place_id in place_ids for spot in self.spots[place_id]]
        here, order = self.start, []
        while left:
            costs = self.costs_from(here)
            here = min(left, key=lambda spot: (costs[spot.number], spot.number))
            left.remove(here)
            order.append(here)
        return tuple(order)

    # ------------------------------------------------------------- spots

    def _spots_of(self, state: WorldState, scene: Scene, thing: SceneObject) -> list[LookSpot]:
        """Return one spot for each stretch of a place that one look takes in."""
        found: list[LookSpot] = []
        for middle in _stretches(thing):
            near = sorted(
                (cell for cell in self._cells if self._gap(cell, thing) <= REACH_M),
                key=lambda cell: (self._odds(cell, thing, middle), cell),
            )[:_TRIED]
            for first in range(0, len(near), _CELLS):
                poses = interactable_poses(
                    state,
                    thing.id,
                    cells=near[first : first + _CELLS],
                    horizons=_HORIZONS,
                    standings=(True,),
                )
                pose = self._best(poses, thing, middle)
                if pose is not None:
                    room = _room(scene, pose)
                    found.append(LookSpot(number=len(self._poses), pose=pose, room=room))
                    self._poses.append(pose)
                    break
        return found

    def _best(
        self, poses: Sequence[Pose], thing: SceneObject, middle: tuple[float, float]
    ) -> Pose | None:
        """Return the pose that looks straightest at the top of a place."""
        top = thing.center[1] + thing.size[1] / 2

        def off(pose: Pose) -> tuple[float, float, float, float]:
            x, y, z = pose.position_m
            dx, dz = middle[0] - x, middle[1] - z
            far = max(math.hypot(dx, dz), 0.1)
            turn = (math.degrees(math.atan2(dx, dz)) - pose.yaw_deg + 180) % 360 - 180
            down = math.degrees(math.atan2(y + 0.675 - min(top, y + 0.675), far))
            near = 40.0 * max(0.35 - self._gap_at(x, z, thing), 0.0) + 20.0 * max(far - 0.9, 0.0)
            return (abs(turn) + abs(down - pose.horizon_deg) + near, pose.horizon_deg, x, z)

        return min(poses, key=off, default=None)

    def _odds(self, cell: Cell, thing: SceneObject, middle: tuple[float, float]) -> float:
        x, z = self._cells[cell]
        return math.dist((x, z), middle) + 2.0 * max(0.3 - self._gap_at(x, z, thing), 0.0)

    def _gap(self, cell: Cell, thing: SceneObject) -> float:
        return self._gap_at(*self._cells[cell], thing)

    @staticmethod
    def _gap_at(x: float, z: float, thing: SceneObject) -> float:
        dx = max(abs(x - thing.center[0]) - thing.size[0] / 2, 0.0)
        dz = max(abs(z - thing.center[2]) - thing.size[2] / 2, 0.0)
        return math.hypot(dx, dz)

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


def _stretches(thing: SceneObject) -> list[tuple[float, float]]:
    """Return the middles (x, z) of the stretches that a long place is looked at in."""
    (x, _, z), (width, _, depth) = thing.center, thing.size
    along, across = max(1, math.ceil(width / _SPAN_M)), max(1, math.ceil(depth / _SPAN_M))
    return [
        (x + ((i + 0.5) / along - 0.5) * width, z + ((j + 0.5) / across - 0.5) * depth)
        for i in range(along)
        for j in range(across)
    ]
