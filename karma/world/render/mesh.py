"""Build coloured triangles, and the few solids that everything is made of.

All lengths in metres; y up, z to the front, x to the right of who looks at the front. Faces wind
so that their normals point out, with x, y and z as the axes of a right hand.
"""

import itertools
from collections.abc import Iterable, Sequence
from functools import cache
from math import cos, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Colour = tuple[float, float, float]  # 0-255 each
Point = tuple[float, float, float]
Packed = NDArray[np.uint32]  # red, green, blue, 0 in the order of bytes

SOLID, GLASS, GHOST = 0, 1, 2  # GHOST: seen in the picture, but not in depth and masks


class Mesh(NamedTuple):
    """Triangles: vertices float32 (n, 3), faces int32 (m, 3), and per face what it looks like."""

    vertices: Floats
    faces: NDArray[np.int32]
    colours: Floats  # (m, 3), 0-255
    glow: NDArray[np.bool_]  # (m,): shines by itself
    clear: NDArray[np.uint8]  # (m,): SOLID, GLASS or GHOST

    @property
    def low(self) -> Floats:
        """Lower corner of the box around it, shape (3,)."""
        found: Floats = self.vertices.min(axis=0)
        return found

    @property
    def high(self) -> Floats:
        """Upper corner of the box around it, shape (3,)."""
        found: Floats = self.vertices.max(axis=0)
        return found


def packed(colours: NDArray[np.uint8]) -> Packed:
    """Return colours (n, 3) as one number each, shape (n,)."""
    found = np.zeros((len(colours), 4), dtype=np.uint8)
    found[:, :3] = colours
    return found.view(np.uint32)[:, 0]


def mesh(
    vertices: Sequence[Point] | Floats, faces: Sequence[tuple[int, int, int]] | NDArray[np.int32],
    colour: Colour | Floats, *, glow: bool = False, clear: int = SOLID,
) -> Mesh:  # fmt: skip
    """Return a mesh of one colour, or of one per face."""
    points = np.asarray(vertices, dtype=np.float32).reshape(-1, 3)
    corners = np.asarray(faces, dtype=np.int32).reshape(-1, 3)
    count = len(corners)
    shades = np.broadcast_to(np.asarray(colour, dtype=np.float32), (count, 3))
    return Mesh(
        points, corners, shades, np.full(count, glow), np.full(count, clear, dtype=np.uint8)
    )


def joined(parts: Iterable[Mesh]) -> Mesh:
    """Return all parts as one; an empty mesh when there are none."""
    listed = list(parts)
    if not listed:
        return mesh([], [], (0, 0, 0))
    starts = np.cumsum([0, *(len(part.vertices) for part in listed[:-1])], dtype=np.int32)
    return Mesh(
        np.concatenate([part.vertices for part in listed]),
        np.concatenate([p.faces + start for p, start in zip(listed, starts, strict=True)]),
        np.concatenate([part.colours for part in listed]),
        np.concatenate([part.glow for part in listed]),
        np.concatenate([part.clear for part in listed]),
    )


def shifted(part: Mesh, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Mesh:
    """Return the part moved."""
    return part._replace(vertices=part.vertices + np.array([x, y, z], dtype=np.float32))


def turned(part: Mesh, degrees: float, axis: int = 1, about: Point = (0.0, 0.0, 0.0)) -> Mesh:
    """Return the part turned round an axis (0 x, 1 y, 2 z) through a point, from z towards x."""
    angle = degrees * pi / 180
    first, second = [(1, 2), (2, 0), (0, 1)][axis]
    turn = np.eye(3, dtype=np.float32)
    turn[first, first] = turn[second, second] = cos(angle)
    turn[first, second], turn[second, first] = -sin(angle), sin(angle)
    middle = np.array(about, dtype=np.float32)
    return part._replace(
        vertices=np.add((part.vertices - middle) @ turn.T, middle, dtype=np.float32)
    )


def mirrored(whole: Mesh) -> Mesh:
    """Return the mesh with left and right exchanged, its faces still outwards."""
    flip = np.array([-1.0, 1.0, 1.0], dtype=np.float32)
    return whole._replace(vertices=whole.vertices * flip, faces=whole.faces[:, ::-1].copy())


def finer(whole: Mesh) -> Mesh:
    """Return the mesh with each face cut in four."""
    a, b, c = whole.vertices[whole.faces].swapaxes(0, 1)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    quarters = [a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca]
    points: Floats = np.stack(quarters, axis=1).reshape(-1, 3)
    return Mesh(
        points,
        np.arange(len(points), dtype=np.int32).reshape(-1, 3),
        np.repeat(whole.colours, 4, axis=0),
        np.repeat(whole.glow, 4),
        np.repeat(whole.clear, 4),
    )


# ------------------------------------------------------------------ flat solids

_BOX_FACES = np.array(
    [(0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6),
     (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5)],
    dtype=np.int32,
)  # fmt: skip
_BOX_CORNERS = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)


def box(low: Point, high: Point, colour: Colour, *, glow: bool = False, clear: int = SOLID) -> Mesh:
    """Return a box between two corners."""
    start, end = np.array(low, dtype=np.float32), np.array(high, dtype=np.float32)
    return mesh(
        start + _BOX_CORNERS * (end - start), _BOX_FACES, colour, glow=glow, clear=clear
    )  # fmt: skip


def sheet(
    origin: Point, across: Point, along: Point, colour: Colour, *, cells: tuple[int, int] = (1, 1),
    bump: float = 0.0,
) -> Mesh:  # fmt: skip
    """Return a parallelogram in cells, its normal across x along; `bump` rumples it."""
    columns, rows = cells
    start, u, v = (np.array(one, dtype=np.float32) for one in (origin, across, along))
    grid_u, grid_v = np.meshgrid(
        np.linspace(0, 1, columns + 1, dtype=np.float32),
        np.linspace(0, 1, rows + 1, dtype=np.float32),
    )
    points = start + grid_u[..., None] * u + grid_v[..., None] * v
    if bump:
        normal = np.cross(u, v)
        normal /= np.linalg.norm(normal)
        wave = np.sin(grid_u * 17 + grid_v * 5) * np.cos(grid_v * 13 - grid_u * 7)
        points = points + (wave * bump)[..., None] * normal
    return mesh(points.reshape(-1, 3).astype(np.float32), _cells(columns, rows), colour)


@cache
def _cells(columns: int, rows: int) -> NDArray[np.int32]:
    found = []
    for row in range(rows):
        for column in range(columns):
            a = row * (columns + 1) + column
            b, c = a + 1, a + columns + 1
            found += [(a, b, c + 1), (a, c + 1, c)]
    return np.array(found, dtype=np.int32)


# ------------------------------------------------------------------ round solids


def lathe(
    profile: Sequence[tuple[float, float]], colour: Colour | Sequence[Colour], *, sides: int = 14,
    depth: float = 1.0, glow: bool = False, clear: int = SOLID,
) -> Mesh:  # fmt: skip
    """Return a profile of (radius, y) turned round the y axis, normals outwards if it runs upwards.

    `colour` may be one for each band between two points; `depth` is z as a share of x.
    """
    rings = np.array(profile, dtype=np.float32)
    angles = np.arange(sides, dtype=np.float32) * np.float32(2 * pi / sides)
    circle = np.stack([np.sin(angles), np.cos(angles) * depth], axis=1).astype(np.float32)
    points = np.empty((len(rings), sides, 3), dtype=np.float32)
    points[:, :, [0, 2]] = rings[:, 0, None, None] * circle
    points[:, :, 1] = rings[:, 1, None]
    bands = np.asarray(colour, dtype=np.float32)
    if bands.ndim == 2:
        bands = np.repeat(bands, 2 * sides, axis=0)
    whole = mesh(points.reshape(-1, 3), _bands(len(rings), sides), bands, glow=glow, clear=clear)
    return _without_slivers(whole)


@cache
def _bands(rings: int, sides: int) -> NDArray[np.int32]:
    found = []
    for ring in range(rings - 1):
        for side in range(sides):
            a, b = ring * sides + side, ring * sides + (side + 1) % sides
            found += [(a, b, b + sides), (a, b + sides, a + sides)]
    return np.array(found, dtype=np.int32)


def _without_slivers(whole: Mesh) -> Mesh:
    """Return the mesh without the faces of no area at poles."""
    a, b, c = (whole.vertices[whole.faces[:, corner]] for corner in range(3))
    keep = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-9
    return Mesh(whole.vertices, *(part[keep] for part in whole[1:]))


def drum(
    radius: float, y0: float, y1: float, colour: Colour, *, sides: int = 14, depth: float = 1.0,
    glow: bool = False,
) -> Mesh:  # fmt: skip
    """Return a closed upright cylinder."""
    profile = [(0.0, y0), (radius, y0), (radius, y1), (0.0, y1)]
    return lathe(profile, colour, sides=sides, depth=depth, glow=glow)


def ball(
    middle: Point, half: Point, colour: Colour, *, sides: int = 12, rings: int = 7,
    glow: bool = False, clear: int = SOLID,
) -> Mesh:  # fmt: skip
    """Return an ellipsoid."""
    turn = [pi * ring / (rings - 1) for ring in range(rings)]
    profile = [(sin(angle), -cos(angle)) for angle in turn]
    round_one = lathe(profile, colour, sides=sides, glow=glow, clear=clear)
    points = round_one.vertices * np.array(half, np.float32) + np.array(middle, np.float32)
    return round_one._replace(vertices=points)


def rod(
    start: Point, end: Point, radius: float, colour: Colour, *, sides: int = 8,
    thin: float | None = None, clear: int = SOLID,
) -> Mesh:  # fmt: skip
    """Return a cylinder between two points; `thin` = the radius at its end."""
    a, b = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    tip = radius if thin is None else thin
    profile = [(0.0, 0.0), (radius, 0.0), (tip, length), (0.0, length)]
    upright = lathe(profile, colour, sides=sides, clear=clear)
    up = (b - a) / max(length, 1e-9)
    side = np.cross(up, (0.0, 0.0, 1.0) if abs(up[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    axes = np.stack([side, up, np.cross(side, up)]).astype(np.float32)
    return upright._replace(vertices=upright.vertices @ axes + a.astype(np.float32))


def bent(points: Sequence[Point], radius: float, colour: Colour) -> list[Mesh]:
    """Return rods from point to point."""
    return [rod(a, b, radius, colour, sides=6) for a, b in itertools.pairwise(points)]


def ring(
    middle: Point, radius: float, thick: float, colour: Colour, *, axis: int = 1, sides: int = 12,
    glow: bool = False,
) -> Mesh:  # fmt: skip
    """Return a ring round an axis through its middle, with a square section."""
    half = thick / 2
    profile = [
        (radius - half, -half), (radius + half, -half), (radius + half, half),
        (radius - half, half), (radius - half, -half),
    ]  # fmt: skip
    flat = lathe(profile, colour, sides=sides, glow=glow)
    if axis != 1:
        flat = turned(flat, 90, axis=2 if axis == 0 else 0)
    return shifted(flat, *middle)
