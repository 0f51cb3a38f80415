"""Wholes and their pieces: Apple and AppleSliced, Egg and EggCracked (`slices_into`)."""

from collections.abc import Mapping
from functools import cache

from karma.household.types import object_types

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


@cache
def _wholes() -> Mapping[str, str]:
    kinds = object_types().items()
    return {kind.slices_into: name for name, kind in kinds if kind.slices_into}
