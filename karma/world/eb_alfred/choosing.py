"""Choose the object that a type's name means, as the benchmark does: by distance and penalties."""

from collections.abc import Mapping, Sequence
from typing import Any

from karma.household.ids import names_part, root_type, type_of
from karma.household.pieces import is_piece
from karma.household.uses import BURNER
from karma.world.core.rules import rules

Thing = Mapping[str, Any]  # one object of the metadata
_SHUT_IN, _IN_USE, _UNSEEN, _PIECE = 100_000.0, 10_000.0, 1_000.0, -100.0  # metres more


def nearest(
    things: Sequence[Thing],
    word: str,
    *,
    able: str = "",
    by_sight: bool = False,
    pieces_first: bool = False,
    parts_only: bool = False,
    any_lid: bool = False,
    other_than: str = "",
) -> Thing | None:
    """Return the object of a type with the least distance and penalties; None if there is none.

    Pieces count as the whole that they were cut from, basins as their sink or bathtub. The object
    has to have the flag `able` ("pickupable"). With `by_sight` what is out of view comes later,
    with `parts_only` only basins and pieces count, with `any_lid` a toilet's lid shuts in, too,
    what lies on top of it.
    """
    shut = {
        one["objectId"]
        for one in things
        if one["openable"] and not one["isOpen"] and (any_lid or hides(one["objectType"]))
    }
    found = []
    for number, one in enumerate(things):
        object_id = one["objectId"]
        if root_type(object_id) != word or object_id == other_than or (able and not one[able]):
            continue
        if parts_only and not names_part(object_id):
            continue
        cost = float(one["distance"])
        cost += _SHUT_IN if not shut.isdisjoint(one["parentReceptacles"] or ()) else 0.0
        cost += _IN_USE if word == BURNER and one["receptacleObjectIds"] else 0.0
        cost += _UNSEEN if by_sight and not one["visible"] else 0.0
        cost += _PIECE if pieces_first and is_piece(type_of(object_id)) else 0.0
        found.append((cost, number))
    return things[min(found)[1]] if found else None


def hides(kind: str) -> bool:
    """Return whether what is in such a thing cannot be seen while it is shut."""
    return kind in rules().view.hides_when_closed


def by_id(things: Sequence[Thing], object_id: str) -> Thing | None:
    """Return the object of an id; None if there is none."""
    return next((one for one in things if one["objectId"] == object_id), None)
