"""Draw the room itself: floor, walls and ceiling of its bounds, seen from inside only.

A ray meets the shell where it leaves the bounds, so that walls between an outside camera and the
room hide nothing, and a camera above looks in through the ceiling. Faces are painted once.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.household.places import FLOOR
from karma.household.types import RoomType
from karma.household.uses import BURNER, FRIDGE, SHOWER_HEAD
from karma.types.space import Vec3
from karma.world.core.ground import outside
from karma.world.core.hiding import inert_rows
from karma.world.core.objects import Objects
from karma.world.core.state import Room
from karma.world.render.form import Walls, rgb, walls
from karma.world.render.mesh import Floats, packed

TEXEL_M = 0.025
SHADOW_M = 0.3  # how far furniture darkens the floor around it
_LOW_M = 0.35  # what begins lower throws a shadow on the floor
_TELLING: tuple[tuple[str, RoomType], ...] = (
    ("Toilet", "Bathroom"), ("Bathtub", "Bathroom"), (SHOWER_HEAD, "Bathroom"),
    (BURNER, "Kitchen"), (FRIDGE, "Kitchen"), ("Bed", "Bedroom"),
)  # fmt: skip
FLOOR_FACE, CEILING_FACE = 2, 3  # faces: -x, +x, -y, +y, -z, +z
_NORMALS = np.array(
    [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0, 0, 0)],
    dtype=np.float32,
)


class Shell(NamedTuple):
    """The bounds and their painted faces."""

    low: Floats  # (3,)
    high: Floats  # (3,)
    last: NDArray[np.int32]  # (3,): highest texel along each axis
    texels: NDArray[np.uint32]  # of all faces, packed colours
    starts: NDArray[np.int32]  # (7,): first texel of each face, 0 for none
    strides: NDArray[np.int32]  # (3, 7): texels that a step along an axis moves on each face


class Exits(NamedTuple):
    """Where rays leave the bounds."""

    along: Floats  # (n,), in lengths of the ray's direction; infinite when they miss the room
    face: NDArray[np.int8]  # (n,); -1 = none
    texel: NDArray[np.int32]  # (n,)


def kind(objects: Objects) -> RoomType:
    """Return which room this is, by what stands in it."""
    return next((room for name, room in _TELLING if name in objects.by_type), "LivingRoom")


def footprints(objects: Objects, floor_y: float) -> NDArray[np.float64]:
    """Return (x0, z0, x1, z1) of what stands low and is not to be carried, shape (n, 4)."""
    carried = np.array(["pickupable" in thing.capabilities for thing in objects.values()], bool)
    floors = np.array([thing.type == FLOOR for thing in objects.values()], bool)
    boxes = objects.boxes
    low = boxes.low[:, 1] < floor_y + _LOW_M
    rows = np.flatnonzero(low & ~carried & ~floors & ~inert_rows(objects))
    return np.concatenate([boxes.low[rows][:, [0, 2]], boxes.high[rows][:, [0, 2]]], axis=1)


def around(room: Room, objects: Objects) -> Shell:
    """Return the shell of a room, painted for what stands in it."""
    shadows = footprints(objects, room.floor_y)
    return _painted(
        room.bounds_center, room.bounds_size, room.floor_y, kind(objects), shadows.tobytes()
    )


@lru_cache(maxsize=8)  # about a megabyte each
def _painted(
    center: Vec3, size: Vec3, floor_y: float, room_type: RoomType, footprint: bytes
) -> Shell:  # fmt: skip
    shadows = np.frombuffer(footprint).reshape(-1, 4)
    low = np.array(center) - np.array(size) / 2
    high = low + np.array(size)
    low[1] = min(floor_y, high[1] - 0.1)
    look = walls(room_type)
    faces = [_face(face, low, high, look, shadows) for face in range(6)]
    sizes = [face.shape[0] * face.shape[1] for face in faces]
    strides = np.zeros((3, 7), dtype=np.int32)
    for number, face in enumerate(faces):
        across, up = _uv(number)
        if number != CEILING_FACE:  # which is one texel
            strides[across, number], strides[up, number] = 1, face.shape[1]
    return Shell(
        low.astype(np.float32),
        high.astype(np.float32),
        np.array([_count(high[axis] - low[axis]) - 1 for axis in range(3)], dtype=np.int32),
        np.concatenate([packed(face.reshape(-1, 3)) for face in faces]),
        np.array([*np.cumsum([0, *sizes[:-1]]), 0], dtype=np.int32),
        strides,
    )


def _count(length: float) -> int:
    return max(1, int(np.ceil(length / TEXEL_M)))


def _uv(face: int) -> tuple[int, int]:
    """Return the axes along a face's columns and rows."""
    return ((2, 1), (0, 2), (0, 1))[face // 2]


def _face(
    face: int, low: NDArray[np.float64], high: NDArray[np.float64], look: Walls,
    shadows: NDArray[np.float64],
) -> NDArray[np.uint8]:  # fmt: skip
    """Return one face's texels, shape (rows, columns, 3)."""
    if face == CEILING_FACE:
        return np.array([[rgb(look.ceiling)]], dtype=np.uint8)
    across, up = _uv(face)
    u, v = ((np.arange(_count(high[axis] - low[axis])) + 0.5) * TEXEL_M for axis in (across, up))
    u, v = np.meshgrid(u, v)
    if face == FLOOR_FACE:
        bright = _floor_pattern(u, v, look.floor_pattern)
        colour = np.array(rgb(look.floor)) * (
            bright * _shaded(u + low[0], v + low[2], shadows)
        )[..., None]  # fmt: skip
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
        places = np.stack([x[part], z[part]], axis=-1)
        near = np.clip(1 - outside((x0, z0), (x1, z1), places) / SHADOW_M, 0, 1)
        light[part] = np.minimum(light[part], 1 - 0.4 * near**1.5)
    return light


def exits(shell: Shell, eye: Floats, steps: Floats) -> Exits:
    """Return where rays from an eye, shape (3,), leave the room; steps have shape (3, n)."""
    low, high = (shell.low - eye)[:, None], (shell.high - eye)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        scales = np.float32(1.0) / steps
        ends = [(low[axis] * scales[axis], high[axis] * scales[axis]) for axis in range(3)]
    outs = [np.fmax(*pair) for pair in ends]
    along = np.minimum(np.minimum(outs[0], outs[1]), outs[2])
    ahead = steps > 0
    face = np.where(
        along == outs[0], ahead[0], np.where(along == outs[1], ahead[1] + 2, ahead[2] + 4)
    ).astype(np.int8)
    if not (low <= 0).all() or not (high >= 0).all():
        enters = [np.fmin(*pair) for pair in ends]
        enter = np.maximum(np.maximum(enters[0], enters[1]), enters[2])
        face[(enter > along) | (along <= 0)] = -1
        along[face < 0] = np.inf
    return Exits(along, face, _texels(shell, face, -low, steps, along))


def _texels(
    shell: Shell, face: NDArray[np.int8], starts: Floats, steps: Floats, along: Floats
) -> NDArray[np.int32]:
    """Return the texel in which each ray leaves; `starts` count from the room's low corner."""
    found = shell.starts[face]
    reach = np.where(face < 0, np.float32(0.0), along) * np.float32(1 / TEXEL_M)
    for axis in range(3):
        place = starts[axis] * np.float32(1 / TEXEL_M) + steps[axis] * reach
        cell = np.minimum(np.maximum(place, np.float32(0.0)), np.float32(shell.last[axis]))
        found += cell.astype(np.int32) * shell.strides[axis][face]
    return found


def normals(face: NDArray[np.int8]) -> Floats:
    """Return the inward normals of faces, zero for no face; shape (n, 3)."""
    found: Floats = _NORMALS[face]
    return found
