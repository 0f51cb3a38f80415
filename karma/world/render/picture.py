"""Draw a moment as a camera sees it: colours, depth and which object each pixel shows."""

from functools import lru_cache
from math import atan2, degrees
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from karma.household.uses import LAMPS
from karma.types.space import Pose
from karma.world.core.boxes import Box
from karma.world.core.objects import Objects
from karma.world.core.state import Camera, Room, WorldState
from karma.world.core.thing import heading
from karma.world.core.view import camera as eye
from karma.world.render import shell
from karma.world.render.drawn import DrawingTask, drawn, support, supports, tasks
from karma.world.render.layer import Layer, rays
from karma.world.render.mesh import Colour, Floats, Mesh, Packed, ball, box, joined, lathe, packed
from karma.world.render.pixels import AGENT, NOTHING, STAND, Pixels, look, scenery

SKY: Colour = (158.0, 190.0, 222.0)
DARK = 0.55  # the light that is left when all light switches are off
LAMP = 0.15  # what each lamp that is lit then adds
RADIUS_M = 0.19
INSIDE_M = 0.3  # cameras this near to the agent's axis see through it
ABOVE_M = 40.0  # of the camera that looks down on a whole room
FEET_M = 0.9  # the agent's origin is this far above the floor


class Picture(NamedTuple):
    """What a camera takes in, shape (H, W) or (H, W, 3), the top row first.

    Rows are those of the objects in `state.objects`, or one of NOTHING, WALL, CEILING, FLOOR (of a
    scene without a Floor object), PIECES (of what broke), AGENT, and STAND (a stove's body, a
    worktop's legs).
    """

    rgb: NDArray[np.uint8]
    depth_m: Floats  # along the camera's forward axis, far_m where nothing is
    rows: NDArray[np.int32]
    normals: Floats | None = None  # in the world's axes, towards the camera; None unless asked for


def agent_camera(state: WorldState) -> Camera:
    """Return the agent's own camera."""
    return Camera(
        position_m=eye(state.pose),
        rotation_deg=(state.pose.horizon_deg, state.pose.yaw_deg, 0.0),
        fov_deg=state.settings.fov_deg,
        near_m=state.settings.near_m,
        far_m=state.settings.far_m,
    )


def camera_above(state: WorldState) -> Camera:
    """Return a camera high over the room that takes in all of it."""
    (x, y, z), (width, height, depth) = state.room.bounds_center, state.room.bounds_size
    return Camera(
        position_m=(x, y + height / 2 + ABOVE_M, z),
        rotation_deg=(90.0, 0.0, 0.0),
        fov_deg=2 * degrees(atan2(max(width, depth) / 2, ABOVE_M)),
        far_m=2 * ABOVE_M,
    )


def render(
    state: WorldState, camera: Camera, width: int, height: int, *, normals: bool = False
) -> Picture:
    """Return the picture of a moment, sides in pixels; equal arguments give equal bytes.

    What is built for a moment is kept as long as its room lives, until something looks different.

    Raises:
        ValueError: the picture has no pixels.
    """
    if width < 1 or height < 1:
        raise ValueError(f"a picture of {width} x {height} pixels")
    kept = built(state)
    view = rays(camera, width, height)
    layers = [*kept.layers, *([body(state.pose)] if sees_body(camera, state.pose) else [])]
    seen = scenery(layers, kept.shell, state.objects, view)
    sky = packed(np.array([SKY], dtype=np.uint8))
    found = look(seen, view, sky, normals=normals)
    found.depth[:] += np.float32(camera.near_m)
    _cut(found, camera.far_m, sky)
    _outline(found.colours.reshape(height, width), found.rows.reshape(height, width))
    return Picture(
        _lit(found, _light(state.objects)).reshape(height, width, 3),
        found.depth.reshape(height, width),
        found.rows.reshape(height, width),
        None if found.normals is None else found.normals.reshape(height, width, 3),
    )


def _cut(found: Pixels, far_m: float, sky: Packed) -> None:
    """Leave out what is beyond the far plane."""
    beyond = found.depth >= np.float32(far_m)
    if beyond.any():
        found.colours[beyond] = sky
        found.rows[beyond] = NOTHING
        found.depth[beyond] = far_m
        if found.normals is not None:
            found.normals[beyond] = 0.0


def _outline(colours: Packed, rows: NDArray[np.int32]) -> None:
    """Darken by a quarter the pixels where one thing ends and another begins."""
    edge = np.zeros(rows.shape, dtype=bool)
    np.not_equal(rows[:, :-1], rows[:, 1:], out=edge[:, :-1])
    edge[:-1] |= rows[:-1] != rows[1:]
    bright = colours[edge]
    half, quarter = np.uint32(0x7F7F7F7F), np.uint32(0x3F3F3F3F)
    colours[edge] = ((bright >> np.uint32(1)) & half) + ((bright >> np.uint32(2)) & quarter)


def _light(objects: Objects) -> float:
    """Return how bright the room is: dark when it has light switches and all are off."""
    switches = objects.of_types("LightSwitch")
    if not switches or any(one.is_toggled for one in switches):
        return 1.0
    return min(1.0, DARK + LAMP * sum(one.is_toggled for one in objects.of_types(*LAMPS)))


def _lit(found: Pixels, light: float) -> NDArray[np.uint8]:
    """Return the colours, shape (n, 3), under some light."""
    colours = np.ascontiguousarray(found.parts[:, :3])
    if light >= 1:
        return colours
    table = (np.arange(256) * light).astype(np.uint8)
    dark: NDArray[np.uint8] = table[colours]
    return dark


_WHITE, _DARK, _BLUE = (226.0, 230.0, 234.0), (38.0, 42.0, 48.0), (60.0, 140.0, 220.0)


def sees_body(view: Camera, pose: Pose) -> bool:
    """Return whether a camera is far enough from the agent not to look out of it."""
    x, _, z = pose.position_m
    return (view.position_m[0] - x) ** 2 + (view.position_m[2] - z) ** 2 > INSIDE_M**2


@lru_cache(maxsize=4)
def body(pose: Pose) -> Layer:
    """Return the agent's body, which is no object of the scene."""
    x, y, z = pose.position_m
    top = eye(pose)[1]
    low, r = y - FEET_M, RADIUS_M
    post = lathe(
        [(0.0, low), (r, low), (r, low + 0.2), (r * 0.6, low + 0.3), (r * 0.6, top - 0.25),
         (r, top - 0.15), (0.0, top - 0.15)],
        [_DARK, _DARK, _DARK, _WHITE, _WHITE, _WHITE],
    )  # fmt: skip
    head = ball((0.0, top, 0.0), (r * 0.8, 0.12, r * 0.8), _WHITE)
    face = box((-r * 0.6, top - 0.05, r * 0.5), (r * 0.6, top + 0.05, r * 0.86), _BLUE)
    whole = joined([post, head, face])
    sine, cosine = heading(pose.yaw_deg)
    axes = np.array([(cosine, 0, -sine), (0, 1, 0), (sine, 0, cosine)], dtype=np.float32)
    place = np.array([x, 0.0, z], dtype=np.float32)
    return Layer((AGENT,), [whole._replace(vertices=whole.vertices @ axes + place)])


# ------------------------------------------------------------------ what is built for a room


class BuiltRoom:
    """The triangles of the last moment of one room.

    Attributes:
        layers: what stands still, then what is in the hand, if anything is.
        shell: the room itself.
    """

    def __init__(self, state: WorldState) -> None:
        self._cells = np.array(list(state.room.cells.values()), dtype=float).reshape(-1, 2)
        self._objects = state.objects
        self._in_hand = state.in_hand
        self._still: list[DrawingTask] = []
        self._held: list[DrawingTask] = []
        self._stands: tuple[Box, ...] = ()
        self.layers = [Layer((), ())]
        self._build(state)

    def update(self, state: WorldState) -> None:
        """Build anew what looks different now."""
        if self._objects is not state.objects or self._in_hand != state.in_hand:
            self._build(state)
            self._objects, self._in_hand = state.objects, state.in_hand

    def _build(self, state: WorldState) -> None:
        wanted = list(tasks(state.objects, self._cells, state.room.shell.walked))
        still = [task for task in wanted if task.thing.id not in state.in_hand]
        held = [task for task in wanted if task.thing.id in state.in_hand]
        self.shell = shell.around(state.room, state.objects)
        stands = supports(state.objects, state.room.floor_y)
        if not _same(still, self._still) or stands != self._stands:
            self.layers[0] = Layer(
                [*(task.owner for task in still), STAND],
                [*self._drawn(still, state.room), support(stands)],
                self.layers[0],
            )
            self._still, self._stands = still, stands
        if not _same(held, self._held):
            owners = [task.owner for task in held]
            self.layers[1:] = [Layer(owners, self._drawn(held, state.room))] if held else []
            self._held = held

    def _drawn(self, some: list[DrawingTask], room: Room) -> list[Mesh]:
        return [drawn(task, self._cells, room.name) for task in some]


_ROOMS: WeakKeyDictionary[Room, BuiltRoom] = WeakKeyDictionary()  # the longest unused first
_AT_ONCE = 16  # rooms of which something is kept; Embree dies of some thousand scenes at once


def built(state: WorldState) -> BuiltRoom:
    """Return the layers and the shell of a moment."""
    found = _ROOMS.pop(state.room, None)
    if found is None:
        for room in list(_ROOMS)[: max(0, len(_ROOMS) - _AT_ONCE + 1)]:
            del _ROOMS[room]
        found = BuiltRoom(state)
    _ROOMS[state.room] = found
    found.update(state)
    return found


def _same(some: list[DrawingTask], others: list[DrawingTask]) -> bool:
    return len(some) == len(others) and all(map(DrawingTask.same, some, others))
