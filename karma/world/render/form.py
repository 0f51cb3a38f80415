"""Describe one object to its builder: its looks (`looks.toml`), measures and state; draw parts.

A part is placed by shares of the object: (1, 1, 1) is its upper, right, front corner, (0, 0, 0) the
middle of its lower side. Solids by metres are in `mesh`.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from hashlib import blake2b
from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

from karma.errors import FileError
from karma.files import read_toml
from karma.household.types import RoomType, object_types
from karma.world.render import mesh
from karma.world.render.mesh import Colour, Mesh, Point

Front = Literal["turn", "room", "thin", "long"]
TABLE = Path(__file__).parent / "looks.toml"


class Look(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How objects of a type are drawn; colours as "#rrggbb"."""

    shape: str  # a builder of shapes.py
    colours: tuple[str, ...]  # one is drawn by lot, the same for an object each time
    second: str = "#4a4a4a"  # of handles, legs, rims
    third: str = "#e8e4da"  # of insides, labels, lights
    front: Front = "turn"
    laid: bool = False  # the longest side is the depth, whatever its axes
    alike: bool = False  # one colour for all of a room
    style: str = ""  # what the builder makes of it


class Walls(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The room itself."""

    floor: str
    floor_pattern: str  # planks, tiles or carpet
    wall: str
    tiled_to_m: float = 0.0  # height of wall tiles
    ceiling: str = "#f3f1ec"


class LooksTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of `looks.toml`."""

    rooms: dict[RoomType, Walls]
    types: dict[str, Look]


@cache
def looks_table() -> LooksTable:
    """Return the table, read once.

    Raises:
        FileError: it is damaged, or its types are not those of types.toml.
    """
    table = read_toml(TABLE, LooksTable)
    for name in sorted(table.types.keys() ^ object_types().keys()):
        fault = "not a type" if name in table.types else "missing"
        raise FileError(TABLE, f"types.{name}: {fault}")
    return table


def looks() -> Mapping[str, Look]:
    """Return all looks by type."""
    return looks_table().types


def walls(room: RoomType) -> Walls:
    """Return how rooms of a type are painted."""
    return looks_table().rooms[room]


def rgb(text: str) -> Colour:
    """Return the three parts of "#rrggbb".

    >>> rgb("#ff8000")
    (255.0, 128.0, 0.0)
    """
    red, green, blue = bytes.fromhex(text.removeprefix("#"))
    return (float(red), float(green), float(blue))


def pick(count: int, name: str) -> int:
    """Return a number below `count` that depends on the name alone."""
    return blake2b(name.encode(), digest_size=2).digest()[0] % count


Rectangle = tuple[float, float, float, float]  # x0, z0, x1, z1
Pair = tuple[float, float]

WATER: Colour = (70.0, 140.0, 230.0)
COFFEE: Colour = (52.0, 28.0, 12.0)
WINE: Colour = (120.0, 10.0, 40.0)
LIQUIDS = {"water": WATER, "coffee": COFFEE, "wine": WINE}
CRACK: Colour = (12.0, 12.0, 14.0)
SIDES = (-1, 1)


class Form(NamedTuple):
    """One object in its own frame: width along x, height along y from 0, depth along z (front)."""

    style: str
    width: float
    height: float
    depth: float
    main: Colour
    second: Colour
    third: Colour
    openness: float = 0.0
    on: bool = False
    broken: bool = False
    filled: bool = False
    liquid: Colour = WATER
    dirty: bool = False
    used_up: bool = False
    cooked: bool = False
    filled_parts: tuple[Rectangle, ...] = ()  # of the ground; () = all of it

    @property
    def half(self) -> Point:
        """Half the width and depth with the height between them."""
        return self.width / 2, self.height, self.depth / 2

    @property
    def opened(self) -> bool:
        """Whether it stands open."""
        return self.openness > 0

    @property
    def along_x(self) -> bool:
        """Whether it is at least as wide as deep."""
        return self.width >= self.depth

    def at_least(self, height: float) -> "Form":
        """Return the form with some height; things of none would not be seen."""
        return self._replace(height=max(self.height, height))

    def at(self, x: float, y: float, z: float) -> Point:
        """Return a point given in shares, metres."""
        a, b, c = self.half
        return a * x, b * y, c * z

    def box(self, low: Point, high: Point, colour: Colour) -> Mesh:
        """Return a box between two corners given in shares."""
        return mesh.box(self.at(*low), self.at(*high), colour)

    def frame(self, edge: float) -> list[Mesh]:
        """Return a border all round the front, as deep as the object; `edge` in metres."""
        x, y, z = self.half
        return [
            mesh.box((-x, 0, -z), (-x + edge, y, z), self.main),
            mesh.box((x - edge, 0, -z), (x, y, z), self.main),
            mesh.box((-x, 0, -z), (x, edge, z), self.main),
            mesh.box((-x, y - edge, -z), (x, y, z), self.main),
        ]

    def ball(self, middle: Point, half: Point, colour: Colour, *, sides: int, rings: int) -> Mesh:
        """Return an ellipsoid by its middle and half its sides in shares."""
        return mesh.ball(self.at(*middle), self.at(*half), colour, sides=sides, rings=rings)

    def lathe(
        self, profile: Sequence[Pair], colour: Colour | Sequence[Colour], *, sides: int = 14
    ) -> Mesh:  # fmt: skip
        """Return a turned profile in shares of half the width and of the height."""
        x, y, z = self.half
        return mesh.lathe([(x * a, y * b) for a, b in profile], colour, sides=sides, depth=z / x)


Builder = Callable[[Form], list[Mesh]]


def dial(
    radius: float, z0: float, z1: float, y: float, colour: Colour, *, sides: int = 14
) -> Mesh:  # fmt: skip
    """Return a round plate that faces the front, between two depths, its middle at a height."""
    lying = mesh.drum(radius, z0, z1, colour, sides=sides)
    return mesh.shifted(mesh.turned(lying, 90, axis=0), 0, y, 0)


def shade(colour: Colour, by: float) -> Colour:
    """Return a darker (below 1) or lighter (above 1) colour."""
    red, green, blue = (min(255.0, part * by) for part in colour)
    return (red, green, blue)


def mix(one: Colour, other: Colour, share: float) -> Colour:
    """Return the colour between two, `share` of the way to the other."""
    red, green, blue = (a + (b - a) * share for a, b in zip(one, other, strict=True))
    return (red, green, blue)
