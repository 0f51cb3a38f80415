"""Apply the rule table to the objects of a moment until nothing changes."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import msgspec
from msgspec import UNSET

from karma.household.uses import BASIN_OF, BASINS
from karma.world.core.objects import Objects, derived
from karma.world.core.rules import Effect, rules
from karma.world.core.scene import SceneObject
from karma.world.core.state import WorldState
from karma.world.core.thing import gaps


class Effects(NamedTuple):
    """One round of the rule table over the objects of a moment."""

    changes: dict[str, SceneObject]  # what it makes of those that it changes
    kept: frozenset[str]  # whose temperature a zone keeps up
    fading: tuple[str, ...]  # hot or cold, and in no zone: furniture stays as it is


def settle(state: WorldState) -> WorldState:
    """Return the state after all effects, and after heat and cold that ran out.

    Effects are idempotent, so the loop ends; the bound only guards against a bad table.
    """
    for _ in range(len(rules().effect) + 1):
        changes = effects(state.objects).changes
        if not changes:
            break
        state = replace(state, objects=state.objects.changed(changes))
    fading = effects(state.objects).fading
    return _decay(state, fading) if fading or state.until_s else state


@derived("parents", "inert", "state")
def effects(objects: Objects) -> Effects:
    """Return what the household does to these objects by itself, in one round."""
    changes: dict[str, SceneObject] = {}
    kept: set[str] = set()
    for effect in rules().effect:
        for source in _sources(objects, effect):
            for target in _zone(objects, effect, source):
                thing = changes.get(target, objects[target])
                if not effect.fits(thing):
                    continue
                if effect.set.temperature is not UNSET:
                    kept.add(target)
                if not effect.set.holds(thing):
                    changes[target] = msgspec.structs.replace(thing, **dict(effect.set.items()))
    fading = (
        object_id
        for object_id, thing in objects.items()
        if thing.temperature != "RoomTemp"
        and object_id not in kept
        and "pickupable" in thing.capabilities
    )
    changes = {key: thing for key, thing in changes.items() if thing != objects[key]}
    return Effects(changes, frozenset(kept), tuple(fading))


def _sources(objects: Objects, effect: Effect) -> Iterator[str]:
    for kind in effect.source:
        for object_id in objects.by_type.get(kind, ()):
            thing = objects[object_id]
            if (thing.is_toggled or not effect.on) and not thing.is_broken:
                yield object_id


def _zone(objects: Objects, effect: Effect, source: str) -> tuple[str, ...]:
    if effect.zone == "inside":
        return objects.containment.inside(source)
    basin = basin_under(objects, source)
    return () if basin is None else objects.containment.inside(basin)


def basin_under(objects: Objects, source: str) -> str | None:
    """Return the nearest basin a faucet or shower head pours into; basins before sinks."""
    x, y, z = objects[source].center
    for kinds in (BASINS, tuple(BASIN_OF)):
        found: list[tuple[float, str]] = []
        for kind in kinds:
            for object_id in objects.by_type.get(kind, ()):
                thing = objects[object_id]
                far = math.hypot(*gaps(thing, x, z))
                if far <= rules().liquids.basin_reach_m and thing.center[1] <= y + 0.1:
                    found.append((far, object_id))
        if found:
            return min(found)[1]
    return None


def _decay(state: WorldState, fading: tuple[str, ...]) -> WorldState:
    """Let heat and cold outside any zone run out."""
    until: dict[str, float] = {}
    changes: dict[str, SceneObject] = {}
    for object_id in fading:
        end = state.until_s.get(object_id, state.time_s + state.decay_s)
        if end <= state.time_s:
            thing = state.objects[object_id]
            changes[object_id] = msgspec.structs.replace(thing, temperature="RoomTemp")
        else:
            until[object_id] = end
    if not changes and until == state.until_s:
        return state
    return replace(state, objects=state.objects.changed(changes), until_s=until)
