"""Hold one moment of the world, frozen; every action makes the next one."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from karma.household.places import FLOOR
from karma.household.types import RULES
from karma.types.space import Pose, Vec3
from karma.world.core.hiding import walked_in
from karma.world.core.metadata import box
from karma.world.core.objects import Derived, Objects
from karma.world.core.rays import RoomShell
from karma.world.core.rules import rules
from karma.world.core.scene import Scene, SceneObject
from karma.world.core.thing import bottom, gaps, heading, is_inert, top
from karma.world.core.view import InView, camera, sight

HAND_M: Vec3 = (0.0, -0.16, 0.38)  # right, up, forward from the camera

BODY_M = 0.2  # the agent's radius
SILL_M = 0.05  # what is lower does not stop the agent
_ON_FLOOR_M = 0.15  # what begins lower stands on the floor

Cell = tuple[int, int]  # column (x), row (z) on the scene's grid
Point = tuple[float, float]  # x, z, metres


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """One camera; angles as Unity gives them: pitch (down positive), yaw (0 = +z), roll."""

    position_m: Vec3
    rotation_deg: Vec3 = (0.0, 0.0, 0.0)
    fov_deg: float = 90.0  # vertical
    near_m: float = 0.01
    far_m: float = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Images:
    """Which pictures an event has."""

    rgb: bool = True
    depth: bool = False
    instances: bool = False
    classes: bool = False
    normals: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """What AI2-THOR's Initialize sets."""

    grid_m: float = 0.25
    visibility_m: float = 1.5
    fov_deg: float = 90.0
    width: int = 300
    height: int = 300
    rotate_deg: float = 90.0
    snap: bool = True
    near_m: float = 0.01  # planes of the agent's camera
    far_m: float = 20.0
    fast_emit: bool = True  # questions are answered without the objects (player only)
    images: Images = Images()

    @property
    def aspect(self) -> float:
        """Width over height of the picture."""
        return self.width / self.height


# holds the cells to stand on once a room has worked them out
_cells_kept: Derived[list[Mapping[Cell, Point]]] = Derived(
    lambda objects: [], "place", "parents", "inert", "held"
)


class Room:
    """What never changes in a scene: its name, bounds and the cells to stand on."""

    def __init__(self, scene: Scene) -> None:
        self.name, self.rules = scene.name, scene.rules or RULES
        self.floor_y = scene.floor_y
        self.grid_m = scene.grid_m
        self.scene_name = scene_name(scene.name)
        self.bounds_center, self.bounds_size = scene.bounds_center, scene.bounds_size
        self.bounds = box(scene.bounds_center, scene.bounds_size)  # as metadata gives it
        self._origin = min(scene.reachable, default=(0.0, 0.0))
        self.cells: dict[Cell, Point] = {}
        for x, z in scene.reachable:
            self.cells.setdefault(self.key(x, z), (x, z))
        self._home = {thing.id: thing for thing in scene.objects}
        self.shell = RoomShell(
            np.array([wall.low for wall in scene.walls or ()]).reshape(-1, 3),
            np.array([wall.high for wall in scene.walls or ()]).reshape(-1, 3),
            walked_in(scene.objects, scene.reachable),
        )

    def key(self, x: float, z: float) -> Cell:
        """Return the cell that a place belongs to, whether or not one can stand there."""
        return (
            round((x - self._origin[0]) / self.grid_m),
            round((z - self._origin[1]) / self.grid_m),
        )

    def open_cells(self, objects: Objects, in_hand: frozenset[str]) -> Mapping[Cell, Point]:
        """Return the cells to stand on: not those beside what has come to lie on the floor."""
        kept = _cells_kept(objects)
        if not kept:
            kept.append(self._open_cells(objects, in_hand))
        return kept[0]

    def _open_cells(self, objects: Objects, in_hand: frozenset[str]) -> Mapping[Cell, Point]:
        found: Mapping[Cell, Point] = self.cells
        for thing in objects.values():
            home = self._home.get(thing.id)
            if (home is not None and home.center == thing.center) or thing.id in in_hand:
                continue
            if is_inert(thing) or any(objects[parent].type != FLOOR for parent in thing.parents):
                continue
            if self._on_floor(thing) and top(thing) > self.floor_y + SILL_M:
                room_m = self._clearance(home)
                found = {k: at for k, at in found.items() if not _beside(thing, at, room_m)}
        return found

    def _on_floor(self, thing: SceneObject) -> bool:
        return bottom(thing) < self.floor_y + _ON_FLOOR_M

    def _clearance(self, home: SceneObject | None) -> float:
        """Return how near the agent may come to a thing's box: at most its own radius.

        Boxes are wider than dog beds and chairs: where the thing stood at first, cells say how near
        one gets, and that holds wherever it is pushed.
        """
        if home is None or not self._on_floor(home):
            return BODY_M
        return min((math.hypot(*gaps(home, *at)) for at in self.cells.values()), default=BODY_M)

    def stands(self, x: float, z: float) -> bool:
        """Return whether the agent's body can be over a place: nothing rests there but on floor."""
        column, row = self.key(x, z)
        for key in ((column + i, row + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
            if key in self.cells:
                cell_x, cell_z = self.cells[key]
                if (cell_x - x) ** 2 + (cell_z - z) ** 2 <= BODY_M**2:
                    return True
        return False


def _beside(thing: SceneObject, place: Point, room_m: float) -> bool:
    """Return whether the agent's body, which takes so much room, would touch a thing."""
    return math.hypot(*gaps(thing, *place)) < min(room_m, BODY_M) - 1e-6


def scene_name(name: str) -> str:
    """Return a scene's name as metadata gives it.

    >>> scene_name("FloorPlan1"), scene_name("kitchen_1")
    ('FloorPlan1_physics', 'kitchen_1')
    """
    return f"{name}_physics" if name.startswith("FloorPlan") and "_" not in name else name


@dataclass(frozen=True, kw_only=True)
class WorldState:
    """One moment: the objects, the agent, what it holds, and the time."""

    room: Room
    settings: Settings
    objects: Objects
    pose: Pose
    held: str | None = None
    time_s: float = 0.0
    until_s: Mapping[str, float] = field(default_factory=dict)  # when heat or cold runs out
    falling: frozenset[str] = frozenset()  # ids of what fell from the start on, and still does
    cameras: tuple[Camera, ...] = ()  # third-party cameras, by their number
    shown: frozenset[str] | None = None  # ids that metadata lists (SetObjectFilter); None = all
    hand_m: Vec3 = HAND_M  # right, up, forward from the camera
    hand_turn_deg: Vec3 = (0.0, 0.0, 0.0)  # the held object's own turn: pitch, yaw, roll
    seed: int = 0  # of what actions draw by lot (SetRandomSeed)

    @cached_property
    def in_hand(self) -> frozenset[str]:
        """The held object and what lies in it."""
        if self.held is None:
            return frozenset()
        return frozenset((self.held, *self.objects.carried(self.held)))

    @cached_property
    def cells(self) -> Mapping[Cell, Point]:
        """The cells to stand on now, with their places."""
        return self.room.open_cells(self.objects, self.in_hand)

    @cached_property
    def sight(self) -> InView:
        """What is in view; computed once, when first asked for."""
        return self.sight_from(self.pose, visibility_m=self.settings.visibility_m)

    def sight_from(
        self, pose: Pose, *, visibility_m: float, fov_deg: float | None = None
    ) -> InView:
        """Return what is in view from a pose; without an angle, with the agent's camera."""
        return sight(
            self.objects,
            pose,
            held=self.in_hand,
            visibility_m=visibility_m,
            fov_deg=self.settings.fov_deg if fov_deg is None else fov_deg,
            aspect=self.settings.aspect,
            shell=self.room.shell,
        )

    @property
    def hand(self) -> Vec3:
        """Where a held object hangs."""
        right, up, ahead = self.hand_m
        sine, cosine = heading(self.pose.yaw_deg)
        dip_sine, dip_cosine = heading(self.pose.horizon_deg)
        x, y, z = camera(self.pose)
        level = up * dip_sine + ahead * dip_cosine
        return (
            round(x + right * cosine + level * sine, 6),
            round(y + up * dip_cosine - ahead * dip_sine, 6),
            round(z - right * sine + level * cosine, 6),
        )


def begin(scene: Scene, settings: Settings) -> WorldState:
    """Return the first moment of a scene, before any effect."""
    until = {t.id: t.heat_left_s for t in scene.objects if t.heat_left_s > 0}
    held = [thing.id for thing in scene.objects if thing.is_picked_up]
    pose = Pose(
        position_m=scene.agent.position, yaw_deg=scene.agent.yaw, horizon_deg=scene.agent.horizon
    )
    return WorldState(
        room=Room(scene),
        settings=settings,
        objects=Objects({thing.id: thing for thing in scene.objects}),
        pose=pose,
        held=held[0] if held else None,
        until_s=until,
        falling=frozenset(thing.id for thing in scene.objects if thing.is_falling),
    )


def ahead(pose: Pose, metres: float) -> tuple[float, float]:
    """Return (x, z) of the place straight ahead."""
    x, z = heading(pose.yaw_deg)
    return (pose.position_m[0] + x * metres, pose.position_m[2] + z * metres)


@dataclass(frozen=True, slots=True)
class Performed:
    """An action that happened: the next moment, what it returns, and how long it took."""

    state: WorldState
    value: Any = None
    seconds: float = field(default_factory=lambda: rules().time.action_s)


@dataclass(frozen=True, slots=True)
class Refusal:
    """An action that did not happen, and why."""

    message: str
    code: str = "Undefined"


Result = Performed | Refusal


def refuse(kind: str, message: str) -> Refusal:
    """Return a refusal worded as an exception that AI2-THOR's player throws inside an action."""
    return Refusal(f"{kind}: {message}", "UnhandledException")
