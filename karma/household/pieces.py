"""Wholes and their pieces: Apple and AppleSliced, Egg and EggCracked (`slices_into`)."""

from collections.abc import Mapping
from functools import cache

from karma.household.types import RULES, RuleSet, object_types

EGG = "Egg"  # what comes to pieces when it breaks, not by a knife


def base_type(object_type: str) -> str:
    """Return the whole's type; what is no piece is its own.

    >>> base_type("AppleSliced"), base_type("EggCracked"), base_type("Mug")
    ('Apple', 'Egg', 'Mug')
    """
    return _wholes().get(object_type, object_type)


def is_piece(object_type: str) -> bool:
    """Return whether a type is that of a piece.

    >>> is_piece("AppleSliced"), is_piece("EggCracked"), is_piece("Apple")
    (True, True, False)
    """
    return object_type in _wholes()


def piece_type(object_type: str) -> str:
    """Return the type of a whole's pieces; what is not cut is its own.

    >>> piece_type("Apple"), piece_type("AppleSliced"), piece_type("Mug")
    ('AppleSliced', 'AppleSliced', 'Mug')
    """
    kind = object_types().get(object_type)
    return kind.slices_into or object_type if kind else object_type


def goes_by(name: str, object_id: str, object_type: str) -> bool:
    """Return whether a name may mean an object: its id or type, or the type of its whole.

    >>> goes_by("Apple", "Apple|1|2|3|AppleSliced_2", "AppleSliced")
    True
    """
    return name in (object_id, object_type, base_type(object_type))


def goes_in(object_type: str, receptacle_type: str, rules: RuleSet = RULES) -> bool:
    """Return whether AI2-THOR lets a thing into a receptacle as it is."""
    return object_types()[object_type].fits(object_types()[receptacle_type], rules)


def fits_whole_or_cut(object_type: str, receptacle_type: str, rules: RuleSet = RULES) -> bool:
    """Return whether AI2-THOR lets a thing into a receptacle, or the pieces it can be cut into.

    >>> fits_whole_or_cut("Bread", "Toaster"), fits_whole_or_cut("Mug", "Toaster")
    (True, False)
    """
    kinds = (object_type, piece_type(object_type))
    return any(goes_in(kind, receptacle_type, rules) for kind in kinds)


def brings(vessel_type: str, object_type: str, receptacle_type: str) -> bool:
    """Return whether a thing can be carried to a receptacle in such a vessel, and stay there in it.

    >>> brings("Pan", "Egg", "StoveBurner"), brings("Fridge", "Egg", "StoveBurner")
    (True, False)
    """
    vessel = object_types()[vessel_type]
    return (
        vessel.can("pickupable")
        and vessel.can("receptacle")
        and goes_in(object_type, vessel_type)
        and goes_in(vessel_type, receptacle_type)
    )


@cache
def _wholes() -> Mapping[str, str]:
    kinds = object_types().items()
    return {kind.slices_into: name for name, kind in kinds if kind.slices_into}
