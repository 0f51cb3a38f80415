"""Actions that requests name: required capability, resulting state, receptacles and tools."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from karma.household.types import Capability, object_types
from karma.household.uses import (
    BASIN_OF,
    BASINS,
    BIN,
    BURNER,
    COFFEE_CUP,
    COFFEE_MACHINE,
    FRIDGE,
    KNIVES,
    LAMPS,
    MICROWAVE,
    SINK,
    SWITCHED_BY_A_PART,
    TAPS,
    TOASTER,
)

_WATER = frozenset((SINK, "Bathtub"))
_STOVE = frozenset((MICROWAVE, BURNER))
_POTS = frozenset(("Pan", "Pot"))


@dataclass(frozen=True, slots=True, kw_only=True)
class DeedKind:
    """An action, independent of the words that request it."""

    said: str = ""  # the action in a few words; "": in the words of the request
    takes: Capability | None = None  # capability that its object needs
    leaves: str = ""  # resulting state of the object (`household.states`)
    put_in: frozenset[str] = frozenset()  # receptacle types used on the way
    runs: frozenset[str] = frozenset()  # device types that may run for it
    tools: frozenset[str] = frozenset()  # types of tools that may be moved for it
    for_good: bool = False  # whether it cannot be undone


DEED_KINDS: Mapping[str, DeedKind] = MappingProxyType({
    "put": DeedKind(takes="pickupable"),
    "take": DeedKind(said="pick up", takes="pickupable"),
    "find": DeedKind(said="find"),
    "go": DeedKind(said="go to"),
    "look": DeedKind(said="look at", runs=frozenset(LAMPS)),
    "throw": DeedKind(
        said="throw away", takes="pickupable", put_in=frozenset((BIN,)), for_good=True
    ),
    "fling": DeedKind(for_good=True),
    "wash": DeedKind(
        said="wash", takes="pickupable", leaves="cleaned", put_in=_WATER,
        runs=frozenset((TAPS[0],)),
    ),
    "heat": DeedKind(
        said="heat", takes="pickupable", leaves="heated", runs=_STOVE, tools=_POTS,
        put_in=_STOVE | _POTS | {"Plate", "Bowl"},
    ),
    "cook": DeedKind(
        said="cook", takes="pickupable", leaves="cooked", runs=_STOVE | {TOASTER}, tools=_POTS,
        put_in=_STOVE | _POTS | {"Plate", "Bowl", TOASTER},
    ),
    "toast": DeedKind(
        said="toast", leaves="cooked", put_in=frozenset((TOASTER,)), runs=frozenset((TOASTER,)),
        tools=frozenset(KNIVES),
    ),
    "cool": DeedKind(
        said="chill", takes="pickupable", leaves="cooled", put_in=frozenset((FRIDGE,))
    ),
    "slice": DeedKind(
        said="slice", takes="sliceable", leaves="sliced", tools=frozenset(KNIVES), for_good=True
    ),
    "fill": DeedKind(
        said="fill", takes="canFillWithLiquid", leaves="filled", put_in=_WATER,
        runs=frozenset((TAPS[0],)),
    ),
    "empty": DeedKind(said="empty", takes="canFillWithLiquid", leaves="empty", for_good=True),
    "coffee": DeedKind(
        put_in=frozenset((COFFEE_MACHINE,)), runs=frozenset((COFFEE_MACHINE,)),
        tools=frozenset((COFFEE_CUP, "Cup")),
    ),
    "break": DeedKind(said="break", takes="breakable", leaves="broken", for_good=True),
    "open": DeedKind(said="open", takes="openable", leaves="opened"),
    "close": DeedKind(said="close", takes="openable", leaves="closed"),
    "on": DeedKind(said="turn on", takes="toggleable", leaves="on"),
    "off": DeedKind(said="turn off", takes="toggleable", leaves="off"),
})  # fmt: skip
FOR_GOOD = tuple(name for name, kind in DEED_KINDS.items() if kind.for_good)
_NO_KIND = DeedKind()


def deed_kind(name: str) -> DeedKind:
    """Return the facts about an action; empty facts for an unknown name."""
    return DEED_KINDS.get(name, _NO_KIND)


def able_to(kind: str, need: str) -> bool:
    """Return whether an object type has a capability, itself or through a part."""
    known = object_types()[kind]
    if need == "toggleable":
        return known.can("toggleable") or kind in SWITCHED_BY_A_PART
    if need == "receptacle":
        return known.can("receptacle") or kind in (*BASIN_OF, *BASINS)
    return known.can(need)  # type: ignore[arg-type]
