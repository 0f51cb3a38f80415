"""What lies in or on what, by boxes alone."""

import math
from collections.abc import Iterable

from karma.contracts import SeenObject
from karma.household.types import object_types

_ASIDE_M = 0.05  # how far a thing's centre may be outside what holds it
_ON_M = 0.1  # between the underside of a thing and the top that it stands on
_NEAR_M = 1.0  # how far a switch may be from what it switches


def holder_of(thing: SeenObject, others: Iterable[SeenObject]) -> str | None:
    """Return the id of what a thing that can be carried lies on, or else in; None if nothing does.

    Of several tops the nearest below counts, of several boxes round it the smallest.
    """
    kind = object_types().get(thing.object_type)
    if kind is None or not thing.pickupable:
        return None
    on, inside = [], []
    bottom = thing.box_center_m[1] - thing.box_size_m[1] / 2
    for other in others:
        place = object_types()[other.object_type]
        if other.object_id == thing.object_id or not place.can("receptacle"):
            continue
        if not kind.fits(place) or not _over(thing, other):
            continue
        low, high = _heights(other)
        if abs(bottom - high) <= _ON_M:
            on.append((abs(bottom - high), other.object_id))
        elif low - _ASIDE_M <= bottom and thing.box_center_m[1] <= high:
            inside.append((math.prod(other.box_size_m), other.object_id))
    return min(on or inside, default=(0.0, None))[1]


def nearest(one: SeenObject, kind: str, others: Iterable[SeenObject]) -> SeenObject | None:
    """Return the nearest thing of a type round another one, None if there is none."""
    near = [
        (math.dist(one.box_center_m, other.box_center_m), other.object_id, other)
        for other in others
        if other.object_type == kind
    ]
    gap, _, found = min(near, default=(math.inf, "", one))
    return found if gap <= _NEAR_M else None


def contents(place: str, things: Iterable[SeenObject]) -> set[str]:
    """Return the ids of what lies in a place, and in that again."""
    things = list(things)
    inside, waiting = set[str](), [place]
    while waiting:
        holder = waiting.pop()
        for thing in things:
            if holder in thing.parent_ids and thing.object_id not in inside:
                inside.add(thing.object_id)
                waiting.append(thing.object_id)
    return inside


def _over(thing: SeenObject, other: SeenObject) -> bool:
    return all(
        abs(thing.box_center_m[axis] - other.box_center_m[axis])
        <= other.box_size_m[axis] / 2 + _ASIDE_M
        for axis in (0, 2)
    )


def _heights(one: SeenObject) -> tuple[float, float]:
    half = one.box_size_m[1] / 2
    return one.box_center_m[1] - half, one.box_center_m[1] + half
