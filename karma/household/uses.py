"""What in a home is used for what: basins and taps, knives, burners, lamps, appliances."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from karma.household.ids import short_type, type_of
from karma.household.pieces import EGG, base_type

# ----------------------------------------------------------------- water

SINK = "Sink"
FAUCET, SHOWER_HEAD = "Faucet", "ShowerHead"
TAPS = (FAUCET, SHOWER_HEAD)
BELOW_SINKS = ("Cabinet",)  # what is put under the sink goes in there
BASIN_OF: Mapping[str, str] = MappingProxyType({SINK: "SinkBasin", "Bathtub": "BathtubBasin"})
WHOLE_OF: Mapping[str, str] = MappingProxyType({basin: of for of, basin in BASIN_OF.items()})
BASINS = tuple(WHOLE_OF)  # things are put into the basin, and lie in it
TAP_OF: Mapping[str, str] = MappingProxyType(
    {kind: FAUCET for pair in BASIN_OF.items() for kind in pair} | {"Shower": SHOWER_HEAD}
)  # what is switched for it


def without_basin(object_type: str) -> str:
    """Return the type of a basin's sink or bathtub; anything else is its own.

    >>> without_basin("SinkBasin"), without_basin("Mug")
    ('Sink', 'Mug')
    """
    return WHOLE_OF.get(object_type, object_type)


def with_wholes(object_types: Iterable[str]) -> frozenset[str]:
    """Return types, and the sinks and bathtubs whose basins are among them: one place, two names.

    >>> sorted(with_wholes(["Mug", "SinkBasin"]))
    ['Mug', 'Sink', 'SinkBasin']
    """
    known = frozenset(object_types)
    return known | {without_basin(kind) for kind in known}


def covers(name: str, object_type: str) -> bool:
    """Return whether a type's name means such objects: of that type, its pieces, its basin.

    >>> covers("Apple", "AppleSliced"), covers("Sink", "SinkBasin"), covers("SinkBasin", "Sink")
    (True, True, False)
    """
    return name in (object_type, base_type(object_type)) or BASIN_OF.get(name) == object_type


# ----------------------------------------------------------------- knives, fire, light

KNIFE = "Knife"
KNIVES = (KNIFE, "ButterKnife")  # the better one first
WASHED_WITH = ("DishSponge", "SoapBottle", "SoapBar", "Cloth", "ScrubBrush")
STOVE, BURNER, KNOB = "Stove", "StoveBurner", "StoveKnob"  # a knob switches its burner
SWITCHED_BY_A_PART = (BURNER, *BASIN_OF, *BASINS)  # a skill that switches them finds the part
FOUND_BY_SKILL = (*TAPS, KNOB, BURNER, STOVE)  # of several, a skill knows which is meant
COOKWARE = ("Pan", "Pot", "Kettle")  # stand on a burner; what lies in them is heated with them
PARTS_OF_FURNITURE = frozenset(("Drawer", "Shelf", "Cabinet"))  # what one names of another
# of which drawers, shelves and cabinets are parts, so that "on the desk" may say which drawer
HAVE_PARTS = frozenset(("Desk", "Dresser", "SideTable", "TVStand", "CounterTop", "ShelvingUnit"))
LAMPS = ("DeskLamp", "FloorLamp")


# ----------------------------------------------------------------- where things are changed

FRIDGE, MICROWAVE, TOASTER, COFFEE_MACHINE = "Fridge", "Microwave", "Toaster", "CoffeeMachine"
BIN = "GarbageCan"
CHANGED_IN: Mapping[str, str] = MappingProxyType(
    {"cleaned": SINK, "filled": SINK, "heated": MICROWAVE, "cooked": MICROWAVE, "cooled": FRIDGE}
)  # the state that being there brings about
COOKED = ("Potato", "PotatoSliced", EGG)  # in the microwave; an egg that is cracked is not
TOASTED = "Bread"
COFFEE_CUP = "Mug"
MOMENTARY = frozenset((*TAPS, MICROWAVE, TOASTER, COFFEE_MACHINE, BURNER, KNOB))


# ----------------------------------------------------------------- whole object types


def kind_of(name: str) -> str:
    """Return the type that a name or id stands for: of wholes, sinks and burners.

    >>> kind_of("Apple_2"), kind_of("Sink|1|2|3|SinkBasin"), kind_of("StoveKnob")
    ('Apple', 'Sink', 'StoveBurner')
    """
    kind = without_basin(base_type(short_type(type_of(name))))
    return BURNER if kind in (KNOB, STOVE) else kind


def switch_of(kind: str) -> str:
    """Return the type that is switched for a type: the tap of a sink."""
    return TAPS[0] if kind in (SINK, "Bathtub", *TAPS) else kind
