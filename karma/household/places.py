"""Where things are: in the hand, put down, found; and the furniture worth a word."""

from collections.abc import Callable, Collection
from functools import cache

from karma.household.types import object_types
from karma.household.uses import (
    BASINS,
    BIN,
    BURNER,
    COFFEE_MACHINE,
    FAUCET,
    FRIDGE,
    KNOB,
    MICROWAVE,
    SINK,
    TAPS,
    TOASTER,
)

ROOMS = ("kitchen", "living", "bedroom", "bathroom")  # kinds of rooms, as scenes are named
HAND = "hand"  # the place of what the agent holds
FLOOR = "Floor"
ON_TOP = frozenset(
    (
        "CounterTop", "DiningTable", "SideTable", "Desk", "Dresser", "CoffeeTable", "TVStand",
        "Shelf", "ShelvingUnit", "Bed", "Sofa", "ArmChair", "Chair", "Stool", "Ottoman", "Toilet",
        BURNER, "ToiletPaperHanger", "HandTowelHolder", "TowelHolder", FLOOR, "Footstool",
    )
)  # people say that things are on these, and in the others  # fmt: skip
NEAR_M = 0.5  # "near", between the origins of two things; the paper names none
SURFACES = (
    "CounterTop", "DiningTable", "SideTable", "Desk", "Dresser", "CoffeeTable", "TVStand",
    "Shelf", "ShelvingUnit", "Bed", "Sofa", "ArmChair", "Toilet", "Bathtub",
)  # where to put something down, the best first  # fmt: skip
_LIKE = (
    ("Desk", "DiningTable", "SideTable", "CoffeeTable", "CounterTop", "Dresser", "TVStand"),
    ("Dresser", "Desk", "SideTable", "TVStand", "Shelf"),
    ("DiningTable", "CoffeeTable", "SideTable", "CounterTop", "Desk"),
    ("SideTable", "CoffeeTable", "DiningTable", "Desk", "Dresser", "CounterTop"),
    ("CoffeeTable", "SideTable", "DiningTable", "Desk", "CounterTop"),
    ("CounterTop", "DiningTable", "SideTable", "CoffeeTable", "Desk"),
    ("TVStand", "Dresser", "SideTable", "Shelf", "CoffeeTable"),
    ("Shelf", "ShelvingUnit", "Dresser", "SideTable", "Cabinet"),
    ("ShelvingUnit", "Shelf", "Cabinet", "Dresser"),
    ("Cabinet", "Drawer", "Shelf"), ("Drawer", "Cabinet", "Dresser"),
    ("Sofa", "ArmChair", "Ottoman", "Bed"), ("ArmChair", "Sofa", "Ottoman", "Bed"),
    ("Ottoman", "ArmChair", "Sofa", "Bed"), ("Bed", "Sofa", "ArmChair"),
    ("DeskLamp", "FloorLamp"), ("FloorLamp", "DeskLamp"),
)  # furniture, and what is taken in its place where there is none, the likest first  # fmt: skip
LIKELY = (
    "CounterTop", "DiningTable", "Desk", "CoffeeTable", "Dresser", "SideTable", "TVStand", "Bed",
    "Sofa", "ArmChair", "Shelf", FRIDGE, SINK, "Cabinet", "Drawer", "Bathtub", "Toilet", BIN,
    MICROWAVE,
)  # where things are found, the likeliest first  # fmt: skip
BESIDE_A_DOOR = (
    "ArmChair", "Bed", "CoffeeTable", "CounterTop", "Desk", "DiningTable", "Dresser", "Ottoman",
    "Shelf", "ShelvingUnit", "SideTable", "Sofa", "TVStand",
)  # where a world puts what may not leave the room: nothing that it would fall into  # fmt: skip
STAND_CLOSED = (FRIDGE, MICROWAVE, "Cabinet", "Drawer", "Safe", "LaundryHamper")
# A program opens and closes these: those that `must_be_open`, but a Box, which stands open, and a
# Safe, of which AI2-THOR does not say so.
SEVERAL = ("Cabinet", "Drawer", "Shelf", "CounterTop", "SideTable", BURNER)  # often in one room
OVERLOOKED = frozenset(
    (
        *TAPS, TOASTER, COFFEE_MACHINE, "LightSwitch", "Blinds", "ToiletPaperHanger",
        "HandTowelHolder", "TowelHolder",
    )
)  # fixed things so small that a map may lack them  # fmt: skip
HANG_ON_WALLS = (
    "Blinds", "Curtains", "HandTowelHolder", "LightSwitch", "Mirror", "Painting", "Poster",
    "ToiletPaperHanger", "TowelHolder", "Window",
)  # fmt: skip
FACE_EITHER_WAY = ("Mirror", "Painting", "Poster", "Window")  # of them: AI2-THOR's headings differ
BACK_TO_WALLS = (
    "Bed", "Cabinet", COFFEE_MACHINE, "Drawer", "Dresser", FAUCET, FRIDGE, MICROWAVE, SINK,
    "Television", TOASTER, "Toilet",
)  # what stands or is built with its back to a wall  # fmt: skip
ROUND_A_CORNER = ("CounterTop", "Desk")  # may be bent: then the box covers free floor
_NOT_WORTH_A_WORD = {FLOOR, "Chair", "Stool", KNOB, *BASINS, "Window"}


def surface_for(object_type: str, is_known: Callable[[str], bool]) -> str:
    """Return the type of surface to put a thing down on: the best known that takes it, if any."""
    kinds = object_types()
    fitting = [name for name in SURFACES if kinds[object_type].fits(kinds[name])]
    return next(filter(is_known, fitting), next(iter(fitting), SURFACES[0]))


@cache
def landmark_types() -> frozenset[str]:
    """Return the immovable types worth a word: things to put into, to open or to switch."""
    useful = {"receptacle", "openable", "toggleable"}
    fixed = (one for one in object_types().values() if not one.can("pickupable"))
    named = frozenset(one.name for one in fixed if useful & set(one.capabilities))
    return named - _NOT_WORTH_A_WORD


def likest(name: str, here: Collection[str]) -> str | None:
    """Return the furniture of a room that is likest to what it lacks; None where nothing is.

    >>> likest("Desk", ("Bed", "SideTable")), likest("Fridge", ("Bed",))
    ('SideTable', None)
    """
    others = next((others for first, *others in _LIKE if first == name), [])
    return next((other for other in others if other in here), None)
