"""What running water reaches: one rule for the world, the judge of goals and the agent's memory.

A tap pours into the nearest basin. A sink or bathtub that has a basin is rim and board beside it,
and stays dry. Of what lies in the basin water reaches what can be carried, and what lies in that
again, but not what is shut in. AI2-THOR lists furniture there too (the worktop that a sink is let
into, with all that stands on and under it; the tap; the shower's curtain): that stays dry.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

from karma.household.ids import part_id
from karma.household.types import types_with
from karma.household.uses import BASIN_OF, TAPS, WHOLE_OF
from karma.types.space import Vec3, outside_m

POURS_M = 1.0  # across the floor: a tap pours into the nearest basin within it
_ABOVE_M = 0.1  # by which a basin's middle may be higher than its tap's


class Lying(NamedTuple):
    """One thing of a room, as water meets it."""

    object_id: str
    object_type: str
    center_m: Vec3  # of its box
    size_m: Vec3
    parent_ids: Sequence[str]
    shut: bool  # its lid keeps water out


def wetted(running: Collection[str], things: Iterable[Lying]) -> frozenset[str]:
    """Return the ids of what the water of running taps reaches.

    Args:
        running: ids of what is switched on; what is no tap pours nothing.
        things: all that is known of the room, the taps among them.
    """
    by_id = {thing.object_id: thing for thing in things}
    taps = [by_id[name] for name in running if name in by_id and by_id[name].object_type in TAPS]
    waiting = [basin for tap in taps for basin in _under(tap, by_id)]
    if not waiting:
        return frozenset()
    carried = types_with("pickupable")
    inside: dict[str, list[Lying]] = {}
    for thing in by_id.values():
        for parent in thing.parent_ids if thing.object_type in carried else ():
            inside.setdefault(parent, []).append(thing)
    found: set[str] = set()
    while waiting:
        for thing in inside.pop(waiting.pop(), ()):
            found.add(thing.object_id)
            if not thing.shut:
                waiting.append(thing.object_id)
    return frozenset(found)


def _under(tap: Lying, by_id: Mapping[str, Lying]) -> list[str]:
    """Return the basin that a tap pours into; [] if none is near enough."""
    basins = []
    for one in by_id.values():
        if one.center_m[1] <= tap.center_m[1] + _ABOVE_M and _is_basin(one, by_id):
            x, _, z = outside_m(tap.center_m, one.center_m, one.size_m)
            basins.append((math.hypot(x, z), one.object_id))
    return [name for far, name in sorted(basins)[:1] if far <= POURS_M]


def _is_basin(one: Lying, by_id: Mapping[str, Lying]) -> bool:
    """Return whether water stays in a thing: a basin, or a sink that is known without one."""
    if one.object_type in WHOLE_OF:
        return True
    parts = (part_id(one.object_id, basin) for basin in WHOLE_OF)
    return one.object_type in BASIN_OF and by_id.keys().isdisjoint(parts)
