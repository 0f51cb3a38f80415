"""Read what our rooms are made of: furniture, where things rest, odds (`rooms.toml`)."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec

from karma.errors import FileError
from karma.files import read_toml
from karma.household.types import Capability, RoomType, object_types

TABLE = Path(__file__).parent / "rooms.toml"
Range = tuple[float, float]


class _Strict(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    pass


class FurniturePart(_Strict, frozen=True, kw_only=True):
    """One object of a piece of furniture; u as share of the width, y and v in metres."""

    type: str
    u: Range = (0.0, 1.0)
    y: Range
    v: Range
    chance: float = 1.0
    child: bool = False  # its id is that of the part before it, and its type
    open: bool = False
    without: tuple[Capability, ...] = ()


class Piece(_Strict, frozen=True, kw_only=True):
    """Furniture with its parts, its back at v = 0."""

    width: Range
    depth: float
    parts: tuple[FurniturePart, ...]


class Furnishing(_Strict, frozen=True, kw_only=True):
    """One line of a room's list of furniture."""

    piece: str
    alternatives: tuple[str, ...] = msgspec.field(default=(), name="or")
    at: Literal["wall", "hung", "middle", "around", "front", "on"]
    count: tuple[int, int] = (1, 1)
    y: Range = (0.0, 0.0)  # of the lower edge, when hung
    below: float = 0.0  # kept free under it, when hung
    of: str = ""  # the type that it stands around or in front of
    on: tuple[str, ...] = ()
    gap: float = 0.08


class Rest(_Strict, frozen=True, kw_only=True):
    """Where things rest in or on a receptacle type."""

    levels: tuple[float, ...] = (1.0,)  # shares of the height
    inside: bool = False
    inset: float = 0.02
    sides: float = 0.0  # at least so much on the left and right
    front: float = 1.0
    back: float = 1.0
    single: bool = False
    hang: bool = False


class Wares(_Strict, frozen=True, kw_only=True):
    """How many of a type a room has, where, and in what state."""

    count: tuple[int, int] = (1, 1)
    places: dict[str, float] = msgspec.field(name="in")  # receptacle type -> weight
    dirty: float = 0.0
    on: float = 0.0
    filled: float = 0.0
    liquid: str | None = None


class Kind(_Strict, frozen=True, kw_only=True):
    """A kind of room."""

    room: RoomType
    width: Range
    depth: Range
    height: float
    runs: tuple[tuple[tuple[str, ...], ...], ...] = ()
    furniture: tuple[Furnishing, ...]
    things: dict[str, Wares]


class RoomTable(_Strict, frozen=True, kw_only=True):
    """All of `rooms.toml`."""

    pieces: dict[str, Piece]
    rests: dict[str, Rest]
    kinds: dict[str, Kind]

    def piece(self, name: str) -> Piece:
        """Return a piece by its name, or a single box for the name of a type."""
        if name in self.pieces:
            return self.pieces[name]
        x, y, z = object_types()[name].size_m
        return Piece(
            width=(x, x), depth=z, parts=(FurniturePart(type=name, y=(0.0, y), v=(0.0, z)),)
        )

    def rest(self, type_name: str) -> Rest:
        """Return where things rest in a receptacle of this type."""
        return self.rests.get(type_name, Rest())


@cache
def rooms() -> RoomTable:
    """Return the table, read once.

    Raises:
        FileError: it is damaged, or names a type, piece or placement that there is not.
    """
    table = read_toml(TABLE, RoomTable)
    for place, name in _names(table):
        if name not in object_types() and not (name in table.pieces and "furniture" in place):
            raise FileError(TABLE, f"{place}: names {name!r}, which is not a type or piece")
    for kind, room in table.kinds.items():
        for name, thing in room.things.items():
            for place in thing.places:
                if not object_types()[name].fits(object_types()[place]):
                    raise FileError(TABLE, f"kinds.{kind}.things.{name}: cannot go in {place}")
    return table


def _names(table: RoomTable) -> Iterator[tuple[str, str]]:
    for name, piece in table.pieces.items():
        yield from ((f"pieces.{name}", part.type) for part in piece.parts)
    yield from (("rests", name) for name in table.rests)
    for name, kind in table.kinds.items():
        place = f"kinds.{name}"
        for entry in kind.furniture:
            yield from ((f"{place}.furniture", n) for n in (entry.piece, *entry.alternatives))
            yield from ((f"{place}.on", n) for n in (*entry.on, *filter(None, [entry.of])))
        runs = (piece for layout in kind.runs for run in layout for piece in run)
        yield from ((f"{place}.runs.furniture", piece) for piece in runs)
        for thing, row in kind.things.items():
            yield from ((f"{place}.things.{thing}", n) for n in (thing, *row.places))
