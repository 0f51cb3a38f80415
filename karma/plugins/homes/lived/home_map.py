"""A home's furniture as its robot knows it: where it is, and from where all of it is seen.

It is the robot's own map, made once per home, and all that its skills know from the start.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from karma.plugins.homes.houses import room_name
from karma.plugins.homes.memory.setting import KnownPlace
from karma.plugins.homes.residents import kind_of_room, resting_places
from karma.types.memory import Area, Known
from karma.types.space import Pose
from karma.world.core.boxes import Flags, Floats
from karma.world.core.hiding import blocking
from karma.world.core.navigate import interactable_poses
from karma.world.core.rays import stopped
from karma.world.core.scene import Scene, SceneObject
from karma.world.core.state import Cell, Settings, WorldState, begin
from karma.world.core.thing import gaps
from karma.world.core.view import camera, camera_axes, in_picture, occluders


class HomeMap:
    """Furniture with poses to look at it from; see `Knowledge`."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.places: dict[str, KnownPlace] = {}
        self.spots: dict[str, tuple[Pose, ...]] = {}
        self._known: dict[str, Known] = {}
        state = begin(scene, Settings(grid_m=scene.grid_m))
        for place_id, room in resting_places(scene).items():
            thing = state.objects[place_id]
            if poses := look_poses(state, thing):
                self.places[place_id] = KnownPlace(
                    place_id=place_id, place_type=thing.type, room=room,
                    room_kind=kind_of_room(room), openable="openable" in thing.capabilities,
                )  # fmt: skip
                self.spots[place_id] = tuple(poses)
                self._known[place_id] = Known(
                    object_id=place_id, object_type=thing.type, position_m=thing.center,
                    box_center_m=thing.center, box_size_m=thing.size,
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


REACH_M = 1.25  # of the cells that a place is looked at from, to its box
_CELLS = 8  # tried at once for each stretch of a place
_ROUNDS = 3  # of such cells, before a place is given up
_SPAN_M = 0.9  # of a stretch
_GRID_M = 0.25  # between the points of a place that looks are to show
_CLEAR_M = 1.15  # within which small things are seen behind others
_HORIZONS = (30.0, 0.0, 60.0, -30.0)
_MOST = 3  # looks at one place
_ENOUGH = 0.95  # of the points
_GAIN = 0.08  # of the points, that another look has to add
_OFF = 0.0006  # of the points, that a look straight on is worth a degree


def look_poses(state: WorldState, thing: SceneObject) -> list[Pose]:
    """Return poses that together show what lies in or on a place; [] where it cannot be seen."""
    points, poses = _points(thing), _candidates(state, thing)
    if not poses:
        return []
    shown = _shown(state, thing, poses, points)
    off = np.array([_off(pose, thing) for pose in poses])
    left = np.ones(len(points), dtype=bool)
    found: list[Pose] = []
    while len(found) < _MOST and left.mean() > 1.0 - _ENOUGH:
        gains = (shown & left).mean(axis=1)
        best = int(np.argmax(gains - _OFF * off))
        if found and gains[best] < _GAIN:
            break
        found.append(poses[best])
        left &= ~shown[best]
    return found


def _candidates(state: WorldState, thing: SceneObject) -> list[Pose]:
    """Return poses near each stretch of a place that have it in view."""
    cells = state.room.cells
    near = [cell for cell, at in cells.items() if math.hypot(*gaps(thing, *at)) <= REACH_M]
    for number in range(_ROUNDS):
        tried: dict[Cell, None] = {}
        for middle in _stretches(thing):
            order = sorted(near, key=lambda cell: (_odds(cells[cell], thing, middle), cell))
            tried |= dict.fromkeys(order[number * _CELLS : (number + 1) * _CELLS])
        poses = interactable_poses(
            state, thing.id, cells=list(tried), horizons=_HORIZONS, standings=(True,)
        )
        if poses:
            return poses
    return []


def _shown(state: WorldState, thing: SceneObject, poses: Sequence[Pose], points: Floats) -> Flags:
    """Return which points are near, in the picture, and not behind furniture or a wall."""
    settings, objects = state.settings, state.objects
    fixed = np.array(["pickupable" not in one.capabilities for one in objects.values()])
    hiding, glass = occluders(objects, state.in_hand)
    hiding &= fixed & ~glass & blocking(objects, [objects.rows[thing.id]])[0]
    rows = np.flatnonzero(hiding)
    clear: dict[tuple[float, float, float], Flags] = {}
    found = np.zeros((len(poses), len(points)), dtype=bool)
    for number, pose in enumerate(poses):
        eye = np.array(camera(pose))
        if pose.position_m not in clear:
            away = np.hypot(*(points - np.array(pose.position_m))[:, [0, 2]].T)
            open_to = away <= min(_CLEAR_M, settings.visibility_m)
            ray, _ = stopped(objects, eye, points, rows, open_to[:, None], state.room.shell)
            open_to[ray] = False
            open_to &= ~state.room.shell.hides(eye, points)
            clear[pose.position_m] = open_to
        axes = camera_axes(pose.yaw_deg, pose.horizon_deg)
        inside = in_picture(points - eye, axes, settings.fov_deg, settings.aspect)
        found[number] = inside & clear[pose.position_m]
    return found


def _points(thing: SceneObject) -> Floats:
    """Return points of a place, shape (n, 3): over its ground, and where it opens, its height."""
    (x, y, z), (width, height, depth) = thing.center, thing.size
    up = tuple(_spread(height)) if "openable" in thing.capabilities else (height / 4,)
    return np.array(
        [(x + i, y + k, z + j) for i in _spread(width) for k in up for j in _spread(depth)]
    )


def _spread(metres: float) -> Iterator[float]:
    number = max(2, round(metres / _GRID_M))
    return (((i + 0.5) / number - 0.5) * metres for i in range(number))


def _off(pose: Pose, thing: SceneObject) -> float:
    """Return how far a pose is from looking straight at the top of a place, degrees and more."""
    x, _, z = pose.position_m
    eye = camera(pose)[1]
    top = min(thing.center[1] + thing.size[1] / 2, eye)
    dx, dz = thing.center[0] - x, thing.center[2] - z
    far = max(math.hypot(dx, dz), 0.1)
    turn = (math.degrees(math.atan2(dx, dz)) - pose.yaw_deg + 180) % 360 - 180
    down = math.degrees(math.atan2(eye - top, far))
    near = 40.0 * max(0.35 - math.hypot(*gaps(thing, x, z)), 0.0)
    return abs(turn) + abs(down - pose.horizon_deg) + near


def _odds(at: tuple[float, float], thing: SceneObject, middle: tuple[float, float]) -> float:
    return math.dist(at, middle) + 2.0 * max(0.3 - math.hypot(*gaps(thing, *at)), 0.0)


def _stretches(thing: SceneObject) -> list[tuple[float, float]]:
    """Return the middles (x, z) of the stretches of a place."""
    (x, _, z), (width, _, depth) = thing.center, thing.size
    along, across = max(1, math.ceil(width / _SPAN_M)), max(1, math.ceil(depth / _SPAN_M))
    return [
        (x + ((i + 0.5) / along - 0.5) * width, z + ((j + 0.5) / across - 0.5) * depth)
        for i in range(along)
        for j in range(across)
    ]
