"""Apply the rule table to the objects of a moment until nothing changes."""

from dataclasses import replace
from typing import NamedTuple

import msgspec
from msgspec import UNSET

from karma.household.water import Lying, wetted
from karma.world.core.objects import Objects, derived
from karma.world.core.rules import Effect, rules
from karma.world.core.scene import SceneObject
from karma.world.core.state import WorldState
from karma.world.core.thing import is_shut


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


@derived("parents", "inert", "open", "state")
def effects(objects: Objects) -> Effects:
    """Return what the household does to these objects by itself, in one round."""
    changes: dict[str, SceneObject] = {}
    kept: set[str] = set()
    for effect in rules().effect:
        for source in objects.of_types(*effect.source):
            if source.is_broken or (effect.on and not source.is_toggled):
                continue
            for target in _zone(objects, effect, source.id):
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


def _zone(objects: Objects, effect: Effect, source: str) -> tuple[str, ...]:
    if effect.zone == "inside":
        return objects.containment.inside(source)
    return tuple(sorted(wetted([source], _lying(objects))))


@derived("place", "parents", "open")
def _lying(objects: Objects) -> list[Lying]:
    return [
        Lying(one.id, one.type, one.center, one.size, one.parents, is_shut(one))
        for one in objects.values()
    ]


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
