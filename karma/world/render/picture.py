"""A moment seen by a camera: colours, depth and which object each pixel shows."""

from functools import lru_cache
from math import radians, tan
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from karma.world.camera import Camera
from karma.world.objects import Objects, heading
from karma.world.render import shell as rooms
from karma.world.render.drawn import Task, drawn, tasks
from karma.world.render.layer import Hits, Layer
from karma.world.render.looks import rgb
from karma.world.render.mesh import GHOST, GLASS, SOLID, Floats, Mesh
from karma.world.render.shell import Shell
from karma.world.state import Room, WorldState
from karma.world.view import camera, camera_axes

NOTHING, WALL, CEILING, FLOOR = -1, -2, -3, -4  # rows of what is no object of the scene
SKY = (158.0, 190.0, 222.0)
SKIES = {
    "white": (255.0,) * 3,
    "black": (0.0,) * 3,
    "gray": (128.0,) * 3,
    "grey": (128.0,) * 3,
    "red": (255.0, 0.0, 0.0),
    "green": (0.0, 255.0, 0.0),
    "blue": (0.0, 0.0, 255.0),
}
OUTLINE = 0.72  # how bright the edge between two objects is
SEE_THROUGH = {GLASS: 0.35, GHOST: 0.3}  # share of the clear thing's own colour
_PANES = 6  # clear faces that one ray passes at most
_STEP_M = 1e-3  # beyond a clear face
_SUNK_M = 0.004  # what lies deeper under the floor is not seen
DARK = 0.55  # the light that is left when all light switches are off


class Picture(NamedTuple):
    """What a camera takes in, the top row first.

    Attributes:
        rgb: uint8 (H, W, 3).
        depth_m: float32 (H, W), metres along the camera's forward axis, far_m where nothing is.
        rows: int32 (H, W), row of the object in `state.objects`, or one of NOTHING, WALL,
            CEILING, FLOOR.
        normals: float32 (H, W, 3), in the world's axes, towards the camera; None unless asked for.
    """

    rgb: NDArray[np.uint8]
    depth_m: Floats
    rows: NDArray[np.int32]
    normals: Floats | None = None


def agent_camera(state: WorldState) -> Camera:
    """Return the agent's own camera."""
    return Camera(
        position_m=camera(state.pose),
        rotation_deg=(state.pose.horizon_deg, state.pose.yaw_deg, 0.0),
        fov_deg=state.settings.fov_deg,
        near_m=state.settings.near_m,
        far_m=state.settings.far_m,
    )


def render(
    state: WorldState, camera: Camera, width: int, height: int, *, normals: bool = False
) -> Picture:
    """Return the picture of a moment; equal moments and cameras give equal bytes.

    Args:
        state: the moment. What is built for it is kept as long as its room lives, and used
            again until something changes.
        camera: with a perspective or an orthographic view.
        width: pixels.
        height: pixels.
        normals: whether to return them.

    Raises:
        ValueError: the picture has no pixels.
    """
    if width < 1 or height < 1:
        raise ValueError(f"a picture of {width} x {height} pixels")
    built = _built(state)
    origins, rays, axes = _rays(camera, width, height)
    view = _View(state.objects, built, origins, rays, camera, axes)
    layers = [built.still, *([built.held] if built.held is not None else [])]
    found = _look(layers, view, _table(layers, view), normals)
    found.depth_m[:] += np.float32(camera.near_m)
    _finish(found, camera, _light(state.objects))
    _outline(found, width, height)
    return Picture(
        found.rgb.reshape(height, width, 3),
        found.depth_m.reshape(height, width),
        found.rows.reshape(height, width),
        None if found.normals is None else found.normals.reshape(height, width, 3),
    )


# ------------------------------------------------------------------ what is kept for a room


class _Built:
    """The triangles of the last moment of a room, for the next picture of it."""

    def __init__(self, room: Room) -> None:
        self.cells = np.array(list(room.cells.values()), dtype=float).reshape(-1, 2)
        self.objects: Objects | None = None
        self.in_hand: frozenset[str] = frozenset()
        self.tasks: list[Task] = []
        self.held_tasks: list[Task] = []
        self.meshes: dict[str, tuple[Task, Mesh]] = {}
        self.still = Layer((), ())
        self.held: Layer | None = None
        self.shell: Shell | None = None
        self.painted: tuple[str, bytes] = ("", b"")

    def structure(self, objects: Objects) -> NDArray[np.int32]:
        """Return the row that each face of the room stands for, and last that of no face."""
        floors = objects.by_type.get("Floor", ())
        floor = objects.rows[floors[0]] if floors else FLOOR
        return np.array([WALL, WALL, floor, CEILING, WALL, WALL, NOTHING], dtype=np.int32)


_KEPT: WeakKeyDictionary[Room, _Built] = WeakKeyDictionary()


def _built(state: WorldState) -> _Built:
    """Return the layers of this moment, made anew only where something looks different."""
    built = _KEPT.get(state.room)
    if built is None:
        built = _KEPT[state.room] = _Built(state.room)
    if built.objects is state.objects and built.in_hand == state.in_hand:
        return built
    wanted = list(tasks(state.objects, built.cells))
    still = [task for task in wanted if task.thing.id not in state.in_hand]
    held = [task for task in wanted if task.thing.id in state.in_hand]
    if not _same(still, built.tasks) or built.shell is None:
        built.meshes = {
            task.thing.id: (task, _mesh(task, built, state.room.name)) for task in still
        }
        built.tasks = still
        built.still = Layer(
            [task.thing.id for task in still], [m for _, m in built.meshes.values()]
        )
        _paint(built, state)
    if not _same(held, built.held_tasks):
        meshes = [drawn(task, built.cells, state.room.name) for task in held]
        built.held = Layer([task.thing.id for task in held], meshes) if held else None
        built.held_tasks = held
    built.objects, built.in_hand = state.objects, state.in_hand
    return built


def _same(tasks: list[Task], others: list[Task]) -> bool:
    return len(tasks) == len(others) and all(map(Task.same, tasks, others))


def _mesh(task: Task, built: _Built, room_name: str) -> Mesh:
    kept = built.meshes.get(task.thing.id)
    if kept is not None and kept[0].same(task):
        return kept[1]
    return drawn(task, built.cells, room_name)


def _paint(built: _Built, state: WorldState) -> None:
    shadows = rooms.footprints(state.objects, state.room.floor_y)
    room_type = rooms.kind(state.objects)
    painted = (room_type, shadows.tobytes())
    if painted != built.painted or built.shell is None:
        built.shell = rooms.paint(state.room, room_type, shadows)
        built.painted = painted


# ------------------------------------------------------------------ rays


@lru_cache(maxsize=8)
def _plane(width: int, height: int, reach: float) -> Floats:
    """Return each pixel's (right, up, 1), shape (H * W, 3); up reaches to `reach`."""
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * reach * (width / height)
    y = (1 - (np.arange(height) + 0.5) / height * 2) * reach
    plane = np.empty((height, width, 3), dtype=np.float32)
    plane[..., 0], plane[..., 1], plane[..., 2] = x[None], y[:, None], 1.0
    return plane.reshape(-1, 3)


def _rays(view: Camera, width: int, height: int) -> tuple[Floats, Floats, Floats]:
    """Return origins (n, 3), rays (n, 3) of length 1 along the view, and the camera's axes."""
    pitch, yaw, roll = view.rotation_deg
    axes = camera_axes(yaw, pitch)
    if roll % 360:
        sine, cosine = heading(roll)
        axes = np.stack(
            [cosine * axes[0] + sine * axes[1], cosine * axes[1] - sine * axes[0], axes[2]]
        )
    axes = axes.astype(np.float32)
    eye = np.array(view.position_m, dtype=np.float32)
    if view.orthographic:
        plane = _plane(width, height, view.orthographic_size_m)
        rays = np.empty_like(plane)
        rays[:] = axes[2]
        return eye + plane[:, :2] @ axes[:2] + axes[2] * np.float32(view.near_m), rays, axes
    rays = _plane(width, height, tan(radians(view.fov_deg) / 2)) @ axes
    return eye + rays * np.float32(view.near_m), rays, axes


class _View(NamedTuple):
    objects: Objects
    built: _Built
    origins: Floats
    rays: Floats
    camera: Camera
    axes: Floats

    @property
    def eye(self) -> Floats | None:
        """The camera's place; None when its rays are parallel."""
        if self.camera.orthographic:
            return None
        return np.array(self.camera.position_m, dtype=np.float32)


def _nearest(layers: list[Layer], view: _View) -> Hits:
    """Return what all rays meet first."""
    along, triangle = layers[0].shot(view.origins, view.rays)
    if len(layers) > 1:
        pixels = _around(layers[1], view)
        if len(pixels):
            near, which = layers[1].shot(view.origins[pixels], view.rays[pixels])
            closer = near < along[pixels]
            along[pixels[closer]] = near[closer]
            triangle[pixels[closer]] = which[closer] + len(layers[0])
    return Hits(along, triangle)


def _around(layer: Layer, view: _View) -> NDArray[np.intp]:
    """Return the pixels in whose direction a small layer can lie."""
    if not len(layer) or layer.low is None or layer.high is None:
        return np.zeros(0, dtype=np.intp)
    middle, half = (layer.low + layer.high) / 2, (layer.high - layer.low) / 2
    radius = float(np.linalg.norm(half)) + 1e-4
    gap = middle - view.origins
    across = np.cross(gap, view.rays)
    reach = np.einsum("ij,ij->i", view.rays, view.rays) * np.float32(radius**2)
    return np.flatnonzero(np.einsum("ij,ij->i", across, across) <= reach)


# ------------------------------------------------------------------ from hits to pixels


class _Table(NamedTuple):
    """The triangles of all layers."""

    rgb: NDArray[np.uint8]
    rows: NDArray[np.int32]
    clear: NDArray[np.uint8]
    normals: Floats


def _table(layers: list[Layer], view: _View) -> _Table:
    at = view.objects.rows
    shades = [layer.shaded(view.eye, view.axes[2]) for layer in layers]
    rows = [np.array([at[i] for i in layer.ids], np.int32)[layer.owner] for layer in layers]
    if len(layers) == 1:
        return _Table(shades[0], rows[0], layers[0].clear, layers[0].normals)
    return _Table(
        np.concatenate(shades),
        np.concatenate(rows),
        np.concatenate([layer.clear for layer in layers]),
        np.concatenate([layer.normals for layer in layers]),
    )


def _look(
    layers: list[Layer], view: _View, table: _Table, normals: bool, panes: int = _PANES
) -> Picture:
    """Return flat pixels; what is clear is blended with what the ray meets behind it."""
    hits = _nearest(layers, view)
    seen = _solid(table, view, hits, normals)
    if not panes or not any(layer.any_clear for layer in layers):
        return seen
    pixels = np.flatnonzero((hits.triangle >= 0) & (table.clear[hits.triangle] != SOLID))
    if len(pixels):
        far = hits.along[pixels] + np.float32(_STEP_M)
        rays = view.rays[pixels]
        beyond = view._replace(origins=view.origins[pixels] + rays * far[:, None], rays=rays)
        behind = _look(layers, beyond, table, normals, panes - 1)
        _blend(seen, behind, pixels, table.clear[hits.triangle[pixels]], far)
    return seen


def _blend(
    seen: Picture, behind: Picture, pixels: NDArray[np.intp], clear: NDArray[np.uint8], far: Floats
) -> None:
    """Mix clear pixels with what is behind them; a ghost leaves depth and row to that."""
    share = np.where(clear == GLASS, SEE_THROUGH[GLASS], SEE_THROUGH[GHOST])[:, None]
    mixed = seen.rgb[pixels] * share + behind.rgb * (1 - share)
    seen.rgb[pixels] = mixed.astype(np.uint8)
    ghosts = clear == GHOST
    seen.rows[pixels[ghosts]] = behind.rows[ghosts]
    seen.depth_m[pixels[ghosts]] = behind.depth_m[ghosts] + far[ghosts]
    if seen.normals is not None and behind.normals is not None:
        seen.normals[pixels[ghosts]] = behind.normals[ghosts]


def _solid(table: _Table, view: _View, hits: Hits, normals: bool) -> Picture:
    """Return flat pixels as if everything were solid."""
    shell = view.built.shell
    assert shell is not None  # painted with the first layer
    level = view.origins[:, 1] + hits.along * view.rays[:, 1]
    hit = (hits.triangle >= 0) & (level > shell.low[1] - _SUNK_M)
    missed = np.flatnonzero(~hit)
    if len(table.rows):
        colours = table.rgb[hits.triangle]
        rows = table.rows[hits.triangle]
    else:
        colours = np.zeros((len(hit), 3), dtype=np.uint8)
        rows = np.zeros(len(hit), dtype=np.int32)
    depth = hits.along.copy()
    out = rooms.exits(shell, view.origins[missed], view.rays[missed])
    points = view.origins[missed] + view.rays[missed] * out.along[:, None]
    colours[missed] = rooms.colours(shell, out.face, points)
    rows[missed] = view.built.structure(view.objects)[out.face]
    depth[missed] = out.along
    sky = missed[out.face < 0]
    colours[sky] = _sky(view.camera.sky)
    depth[sky] = np.float32(np.inf)
    return Picture(
        colours, depth, rows, _normals(table, view, hits, out, missed) if normals else None
    )


def _normals(
    table: _Table, view: _View, hits: Hits, out: rooms.Exits, missed: NDArray[np.intp]
) -> Floats:
    """Return flat normals towards the camera; zero where there is nothing."""
    found = np.zeros((len(hits.triangle), 3), dtype=np.float32)
    if len(table.rows):
        found = table.normals[hits.triangle]
        away = np.einsum("ij,ij->i", found, view.rays) > 0
        found[away] *= -1
    found[missed] = rooms.normals(out.face)
    found[missed[out.face < 0]] = 0.0
    return found


def _sky(name: str) -> tuple[float, float, float]:
    if name.startswith("#") and len(name) >= 7:
        return rgb(name[:7])
    return SKIES.get(name.lower(), SKY)


def _finish(found: Picture, view: Camera, light: float) -> None:
    """Cut at the far plane, and darken the room when its lights are out."""
    beyond = found.depth_m >= np.float32(view.far_m)
    if beyond.any():
        found.rgb[beyond] = _sky(view.sky)
        found.rows[beyond] = NOTHING
        found.depth_m[beyond] = view.far_m
        if found.normals is not None:
            found.normals[beyond] = 0.0
    if light < 1:
        np.multiply(found.rgb, light, out=found.rgb, casting="unsafe")


def _light(objects: Objects) -> float:
    """Return how bright the room is: dark when it has light switches and all are off."""
    switches = objects.by_type.get("LightSwitch", ())
    if not switches or any(objects[one].is_toggled for one in switches):
        return 1.0
    lamps = [one for kind in ("DeskLamp", "FloorLamp") for one in objects.by_type.get(kind, ())]
    return min(1.0, DARK + 0.15 * sum(objects[one].is_toggled for one in lamps))


def _outline(found: Picture, width: int, height: int) -> None:
    """Darken the pixels where one thing ends and another begins."""
    rows, colours = found.rows.reshape(height, width), found.rgb.reshape(height, width, 3)
    edge = np.zeros(rows.shape, dtype=bool)
    edge[:, :-1] |= rows[:, :-1] != rows[:, 1:]
    edge[:-1] |= rows[:-1] != rows[1:]
    colours[edge] = (colours[edge] * np.float32(OUTLINE)).astype(np.uint8)
