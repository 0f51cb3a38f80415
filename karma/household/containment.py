"""What may go where: as it is, in pieces, or in a vessel. Expert, inspector and judge read this."""

from collections.abc import Callable, Iterable, Iterator

from karma.household.ids import short_type
from karma.household.pieces import piece_type
from karma.household.types import RULES, RuleSet, object_types
from karma.household.uses import BASIN_OF


def goes_in(object_type: str, receptacle_type: str, rules: RuleSet = RULES) -> bool:
    """Return whether AI2-THOR lets a thing into a receptacle, or into its basin, as it is.

    >>> goes_in("Laptop", "Box"), goes_in("Laptop", "Cabinet"), goes_in("Mug", "Sofa")
    (True, False, False)
    """
    kinds = object_types()
    basin = BASIN_OF.get(receptacle_type, receptacle_type)
    places = [kinds[receptacle_type], kinds[basin]]
    holds = any(place.can("receptacle") for place in places)
    return holds and any(kinds[object_type].fits(place, rules) for place in places)


def fits_whole_or_cut(object_type: str, receptacle_type: str, rules: RuleSet = RULES) -> bool:
    """Return whether AI2-THOR lets a thing into a receptacle, or the pieces it can be cut into.

    >>> fits_whole_or_cut("Bread", "Toaster"), fits_whole_or_cut("Mug", "Toaster")
    (True, False)
    """
    kinds = (object_type, piece_type(object_type))
    return any(goes_in(kind, receptacle_type, rules) for kind in kinds)


def has_door(object_type: str) -> bool:
    """Return whether furniture is opened before anything is taken out of it or put into it.

    >>> has_door("Fridge"), has_door("Box"), has_door("Shelf")
    (True, False, False)
    """
    kind = object_types().get(object_type)
    return kind is not None and kind.must_be_open and not kind.can("pickupable")


def brings(vessel_type: str, object_type: str, receptacle_type: str) -> bool:
    """Return whether a thing can be carried to a receptacle in such a vessel, and stay there in it.

    >>> brings("Pan", "Egg", "StoveBurner"), brings("Box", "Laptop", "Cabinet")
    (True, True)
    """
    vessel = object_types()[vessel_type]
    return (
        vessel.can("pickupable")
        and object_type != vessel_type != receptacle_type
        and goes_in(object_type, vessel_type)
        and goes_in(vessel_type, receptacle_type)
    )


def vessels(names: Iterable[str], object_type: str, receptacle_type: str) -> Iterator[str]:
    """Yield which of some things (`Box`, `Plate_2`) would bring a thing to a receptacle."""
    kinds = object_types()
    for name in names:
        if (kind := short_type(name)) in kinds and brings(kind, object_type, receptacle_type):
            yield name


def holders(place_id: str | None, above: Callable[[str], str | None]) -> Iterator[str]:
    """Yield the receptacle that an object lies in, then its own receptacle, and so on.

    >>> list(holders("Bowl", {"Bowl": "Fridge"}.get))
    ['Bowl', 'Fridge']
    """
    passed: set[str] = set()
    while place_id is not None and place_id not in passed:
        passed.add(place_id)
        yield place_id
        place_id = above(place_id)
