"""Read what each type looks like (`looks.toml`): a builder, its colours and measures."""

from collections.abc import Mapping
from functools import cache
from hashlib import blake2b
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import msgspec

from karma.errors import FileError
from karma.files import read_toml
from karma.household.types import RoomType, object_types
from karma.world.render.mesh import Colour

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


class _LooksTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    rooms: dict[RoomType, Walls]
    types: dict[str, Look]


@cache
def looks() -> Mapping[str, Look]:
    """Return all looks by type, read once from `looks.toml`; errors as in `read_looks`."""
    return read_looks(TABLE)


@cache
def _table(path: Path) -> _LooksTable:
    return read_toml(path, _LooksTable)


def read_looks(path: Path) -> Mapping[str, Look]:
    """Read a table of looks.

    Raises:
        FileError: the table is damaged, or its types are not those of types.toml.
    """
    found = _table(path).types
    for name in sorted(found.keys() ^ object_types().keys()):
        fault = "not a type" if name in found else "missing"
        raise FileError(path, f"types.{name}: {fault}")
    return MappingProxyType(found)


def walls(room: RoomType) -> Walls:
    """Return how rooms of a type are painted."""
    return _table(TABLE).rooms[room]


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
