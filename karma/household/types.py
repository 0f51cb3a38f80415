"""What every object type can do, where it may be put and how big it is (`types.toml`)."""

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import msgspec

from karma.errors import FileError, UnknownNameError
from karma.files import read_toml
from karma.types.space import Vec3

Capability = Literal[
    "receptacle", "pickupable", "moveable", "openable", "toggleable", "breakable",
    "canFillWithLiquid", "dirtyable", "canBeUsedUp", "cookable", "sliceable",
    "isHeatSource", "isColdSource",
]  # AI2-THOR's flag names  # fmt: skip
RoomType = Literal["Kitchen", "LivingRoom", "Bedroom", "Bathroom"]

RuleSet = Literal["thor-5.0.0", "thor-2.1.0"]  # whose table says what goes into what
RULES: RuleSet = "thor-5.0.0"
WIDEST: RuleSet = "thor-2.1.0"  # lets all that 5.0.0 does, and more

TABLE = Path(__file__).parent / "types.toml"
_RENAMED = {  # types that AI2-THOR renamed after 2.1.0, as ALFRED's records name them
    "Cart": "ShelvingUnit", "Glassbottle": "Bottle", "PaperTowel": "PaperTowelRoll",
    "ToiletPaperRoll": "ToiletPaper",
}  # fmt: skip


class _Facts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    rooms: tuple[RoomType, ...]
    capabilities: tuple[Capability, ...] = ()
    goes_in: tuple[str, ...] | None = None  # receptacle types it may be put into; None = any
    accepts_only: tuple[str, ...] = ()  # types that this receptacle takes; () = any that go in it
    must_be_open: bool = False  # before something is put into it
    upright: bool = False  # always put down standing
    slices_into: str | None = None
    slice_count: int = 0
    made_by_slicing: bool = False  # never there at reset
    starts_open: bool = False
    starts_on: bool = False
    size_m: Vec3  # typical box at yaw 0
    mass_kg: float = 0.0
    materials: tuple[str, ...] | None = None


class _Row(_Facts, frozen=True, kw_only=True, forbid_unknown_fields=True):
    also_in: tuple[str, ...] = ()


class ObjectType(_Facts, frozen=True, kw_only=True):
    """One of the 125 types of AI2-THOR 5.0.0."""

    name: str
    more_in: Mapping[RuleSet, tuple[str, ...]] = MappingProxyType({})  # beyond it, by rule set

    def can(self, capability: Capability) -> bool:
        """Return whether objects of this type have the capability."""
        return capability in self.capabilities

    def fits(self, receptacle: "ObjectType", rules: RuleSet = RULES) -> bool:
        """Return whether the types allow putting this into that receptacle.

        Args:
            receptacle: its type.
            rules: of which simulator; who does not know takes the widest.
        """
        if receptacle.accepts_only:
            return self.name in receptacle.accepts_only
        more = self.more_in.get(rules, ())
        return self.goes_in is None or receptacle.name in self.goes_in or receptacle.name in more


class _Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    groups: dict[str, tuple[str, ...]]
    rules: dict[RuleSet, dict[str, tuple[str, ...]]] = {}
    types: dict[str, _Row]


@cache
def object_types() -> Mapping[str, ObjectType]:
    """Return all types by name, read once from `types.toml`.

    Raises:
        FileError: the table is damaged; names the type and the name it does not know.
    """
    return read_types(TABLE)


@cache
def types_with(capability: Capability) -> frozenset[str]:
    """Return the names of all types with a capability.

    >>> "Mug" in types_with("pickupable"), "Sofa" in types_with("pickupable")
    (True, False)
    """
    return frozenset(name for name, kind in object_types().items() if kind.can(capability))


def read_types(path: Path) -> Mapping[str, ObjectType]:
    """Read a table of types; errors as in `object_types`."""
    table = read_toml(path, _Table)
    types = {name: _object_type(name, row, table, path) for name, row in table.types.items()}
    return MappingProxyType(dict(sorted(types.items())))


def object_type(name: str) -> ObjectType:
    """Return one type.

    Raises:
        UnknownNameError: there is no such type; suggests the nearest.
    """
    types = object_types()
    if name not in types:
        near = get_close_matches(name, types, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise UnknownNameError(f"no object type named {name!r}.{hint}")
    return types[name]


def _object_type(name: str, row: _Row, table: _Table, path: Path) -> ObjectType:
    facts = msgspec.structs.asdict(row)
    listed, ours = facts.pop("goes_in"), facts.pop("also_in")
    facts["goes_in"] = None if listed is None else _expand((*listed, *ours), table, name, path)
    more = {rules: pairs[name] for rules, pairs in table.rules.items() if name in pairs}
    named = (*(facts["goes_in"] or ()), *row.accepts_only, *filter(None, [row.slices_into]))
    for other in (*named, *(place for places in more.values() for place in places)):
        if other not in table.types:
            raise FileError(path, f"types.{name}: names {other!r}, which is not a type")
    return ObjectType(name=name, more_in=MappingProxyType(more), **facts)


def _expand(names: Iterable[str], table: _Table, owner: str, path: Path) -> tuple[str, ...]:
    found: dict[str, None] = {}
    for name in names:
        if not name.startswith("@"):
            found[name] = None
        elif name[1:] in table.groups:
            found.update(dict.fromkeys(table.groups[name[1:]]))
        else:
            raise FileError(path, f"types.{owner}: no group named {name!r}")
    return tuple(sorted(found))


def in_words(object_type: str) -> str:
    """Return a type as a person writes it.

    >>> in_words("CellPhone"), in_words("TVStand"), in_words("CD")
    ('cell phone', 'tv stand', 'cd')
    """
    return words_of(object_type).lower()


def words_of(object_type: str) -> str:
    """Return a type with a space between its words: "Cell Phone", "TV Stand"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", object_type)


def names_then() -> frozenset[str]:
    """Return the types that ALFRED's ids may begin with: ours, and those renamed since."""
    return frozenset((*object_types(), *_RENAMED))


def type_now(kind: str) -> str | None:
    """Return the name that AI2-THOR 5.0.0 has for a type of ALFRED; None if it has none.

    >>> type_now("Glassbottle"), type_now("Apple"), type_now("LaundryHamperLid")
    ('Bottle', 'Apple', None)
    """
    name = _RENAMED.get(kind, kind)
    return name if name in object_types() else None
