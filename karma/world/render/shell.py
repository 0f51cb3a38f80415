"""The room itself: floor, walls and ceiling of its bounds, seen from inside only.

A ray meets the shell where it leaves the bounds, so that walls between an outside camera and the
room hide nothing, and a camera above looks in through the ceiling. Faces are painted once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.world.objects import Objects
from karma.world.render.looks import Walls, rgb, walls
from karma.world.render.mesh import Floats
from karma.world.scene import RoomType
from karma.world.state import Room

TEXEL_M = 0.025
SHADOW_M = 0.3  # how far furniture darkens the floor around it
_LOW_M = 0.35  # what begins lower throws a shadow on the floor
_TELLING: tuple[tuple[str, RoomType], ...] = (
    ("Toilet", "Bathroom"), ("Bathtub", "Bathroom"), ("ShowerHead", "Bathroom"),
    ("StoveBurner", "Kitchen"), ("Fridge", "Kitchen"), ("Bed", "Bedroom"),
)  # fmt: skip
FLOOR_FACE, CEILING_FACE = 2, 3  # faces: -x, +x, -y, +y, -z, +z
_NORMALS = np.array(
    [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], dtype=np.float32
)


class Shell(NamedTuple):
    """The bounds and their painted faces."""

    low: Floats  # (3,)
    high: Floats  # (3,)
    texels: NDArray[np.uint8]  # (all faces' texels, 3)
    starts: NDArray[np.int32]  # (6,): of each face in texels
    widths: NDArray[np.int32]  # (6,): texels of a face's row


class Exits(NamedTuple):
    """Where rays leave the bounds."""

    along: Floats  # (n,), in lengths of the ray's direction
    face: NDArray[np.int64]  # (n,); -1 = the ray misses the room


def kind(objects: Objects) -> RoomType:
    """Return which room this is, by what stands in it."""
    return next((room for name, room in _TELLING if name in objects.by_type), "LivingRoom")


def footprints(objects: Objects, floor_y: float) -> NDArray[np.float64]:
    """Return (x0, z0, x1, z1) of what stands low and is not to be carried, shape (n, 4)."""
    carried = np.array(["pickupable" in thing.capabilities for thing in objects.values()], bool)
    floors = np.array([thing.type == "Floor" for thing in objects.values()], bool)
    low = objects.low[:, 1] < floor_y + _LOW_M
    rows = np.flatnonzero(low & ~carried & ~floors & ~objects.inert)
    return np.concatenate([objects.low[rows][:, [0, 2]], objects.high[rows][:, [0, 2]]], axis=1)


def paint(room: Room, room_type: RoomType, shadows: NDArray[np.float64]) -> Shell:
    """Return the shell of a room.

    Args:
        room: with its bounds.
        room_type: says how it is painted.
        shadows: of `footprints`.
    """
    middle, size = np.array(room.bounds_center), np.array(room.bounds_size)
    low, high = (middle - size / 2), (middle + size / 2)
    low[1] = min(room.floor_y, high[1] - 0.1)
    look = walls(room_type)
    faces = [_face(face, low, high, look, shadows) for face in range(6)]
    starts = np.cumsum([0, *(face.shape[0] * face.shape[1] for face in faces[:-1])])
    return Shell(
        low.astype(np.float32),
        high.astype(np.float32),
        np.concatenate([face.reshape(-1, 3) for face in faces]),
        starts.astype(np.int32),
        np.array([face.shape[1] for face in faces], dtype=np.int32),
    )


def _uv(face: int) -> tuple[int, int]:
    """Return the axes along a face's columns and rows."""
    return ((2, 1), (0, 2), (0, 1))[face // 2]


def _face(
    face: int, low: NDArray[np.float64], high: NDArray[np.float64], look: Walls,
    shadows: NDArray[np.float64],
) -> NDArray[np.uint8]:  # fmt: skip
    """Return one face's texels, shape (rows, columns, 3)."""
    across, up = _uv(face)
    u, v = (
        (np.arange(max(1, int(np.ceil((high[axis] - low[axis]) / TEXEL_M)))) + 0.5) * TEXEL_M
        for axis in (across, up)
    )
    u, v = np.meshgrid(u, v)
    if face == FLOOR_FACE:
        bright = _floor_pattern(u, v, look.floor_pattern)
        colour = np.array(rgb(look.floor)) * (
            bright * _shaded(u + low[0], v + low[2], shadows)
        )[..., None]  # fmt: skip
    elif face == CEILING_FACE:
        colour = np.broadcast_to(np.array(rgb(look.ceiling)), (*u.shape, 3))
    else:
        colour = _wall(u, v, look) * (0.93, 1.0, 1.0, 1.0, 0.97, 0.9)[face]
    return np.clip(np.rint(colour), 0, 255).astype(np.uint8)


def _floor_pattern(
    u: NDArray[np.float64], v: NDArray[np.float64], name: str
) -> NDArray[np.float64]:
    if name == "planks":
        board = np.floor(v / 0.15)
        shift = (board * 0.37) % 1.0
        end = ((u / 1.2 + shift) % 1.0) < TEXEL_M / 1.2
        seam = (v / 0.15) % 1.0 < TEXEL_M / 0.15
        tone = 1.0 + 0.07 * np.sin(board * 12.9898 + np.floor(u / 1.2 + shift) * 4.1)
        return np.where(seam | end, 0.8, tone)
    tile = (np.floor(u / 0.5) + np.floor(v / 0.5)) % 2
    grout = ((u % 0.5) < TEXEL_M) | ((v % 0.5) < TEXEL_M)
    return np.where(grout, 0.82, 0.97 + 0.06 * tile)


def _wall(u: NDArray[np.float64], v: NDArray[np.float64], look: Walls) -> NDArray[np.float64]:
    colour = np.array(rgb(look.wall)) * (0.9 + 0.08 * v / max(v.max(), 1e-6))[..., None]
    if look.tiled_to_m:
        tiles = (v < look.tiled_to_m)[..., None]
        grout = ((u % 0.2) < TEXEL_M) | ((v % 0.2) < TEXEL_M)
        tiled = np.array([196.0, 216.0, 222.0]) * np.where(grout, 0.88, 1.0)[..., None]
        colour = np.where(tiles, tiled, colour)
        colour = np.where(
            (np.abs(v - look.tiled_to_m) < 0.03)[..., None], [90.0, 130.0, 150.0], colour
        )
    skirting = (v < 0.08)[..., None]
    return np.where(skirting, np.array(rgb(look.wall)) * 0.7, colour)


def _shaded(
    x: NDArray[np.float64], z: NDArray[np.float64], shadows: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how bright the floor is, darker under and beside furniture."""
    light = np.ones(x.shape)
    for x0, z0, x1, z1 in shadows:
        columns = np.flatnonzero((x[0] > x0 - SHADOW_M) & (x[0] < x1 + SHADOW_M))
        rows = np.flatnonzero((z[:, 0] > z0 - SHADOW_M) & (z[:, 0] < z1 + SHADOW_M))
        if not len(columns) or not len(rows):
            continue
        part = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
        gap_x = np.maximum(np.maximum(x0 - x[part], x[part] - x1), 0.0)
        gap_z = np.maximum(np.maximum(z0 - z[part], z[part] - z1), 0.0)
        near = np.clip(1 - np.hypot(gap_x, gap_z) / SHADOW_M, 0, 1)
        light[part] = np.minimum(light[part], 1 - 0.4 * near**1.5)
    return light


def exits(shell: Shell, origins: Floats, rays: Floats) -> Exits:
    """Return where rays leave the room.

    Args:
        shell: of the room.
        origins: shape (n, 3), or (1, 3) when shared.
        rays: directions, shape (n, 3).
    """
    steep = np.where(np.abs(rays) < 1e-12, np.float32(1e-12), rays)
    ahead = steep > 0
    out = (np.where(ahead, shell.high, shell.low) - origins) / steep
    axis = np.argmin(out, axis=1)
    pick_one = np.arange(len(rays))
    along = out[pick_one, axis]
    face = 2 * axis + ahead[pick_one, axis]
    inside = np.all((origins >= shell.low) & (origins <= shell.high))
    if not inside:
        enter = ((np.where(ahead, shell.low, shell.high) - origins) / steep).max(axis=1)
        face = np.where((enter > along) | (along <= 0), -1, face)
    return Exits(along.astype(np.float32), face)


def colours(shell: Shell, face: NDArray[np.int64], points: Floats) -> NDArray[np.uint8]:
    """Return the paint at points of faces, shape (n, 3)."""
    scaled = ((points - shell.low) * np.float32(1 / TEXEL_M)).astype(np.int32)
    limit = np.ceil((shell.high - shell.low) / TEXEL_M).astype(np.int32) - 1
    scaled = np.minimum(np.maximum(scaled, 0), np.maximum(limit, 0))
    axes = np.array([_uv(number) for number in range(6)])
    order = np.arange(len(face))
    column, row = scaled[order, axes[face, 0]], scaled[order, axes[face, 1]]
    return shell.texels[shell.starts[face] + row * shell.widths[face] + column]


def normals(face: NDArray[np.int64]) -> Floats:
    """Return the inward normals of faces, shape (n, 3)."""
    return _NORMALS[face]
