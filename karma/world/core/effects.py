"""Say what follows by itself: effects of the rule table, pieces of what was cut or broken."""

from dataclasses import replace
from typing import NamedTuple

import msgspec
from msgspec import UNSET

from karma.household.ids import part_id
from karma.household.pieces import EGG
from karma.household.types import object_types
from karma.household.water import Lying, wetted
from karma.world.core.objects import Objects, derived
from karma.world.core.rules import Effect, rules
from karma.world.core.scene import SceneObject
from karma.world.core.state import WorldState
from karma.world.core.thing import bottom, is_shut, shatters


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
        end = state.until_s.get(object_id, state.time_s + rules().time.decay_s)
        if end <= state.time_s:
            thing = state.objects[object_id]
            changes[object_id] = msgspec.structs.replace(thing, temperature="RoomTemp")
        else:
            until[object_id] = end
    if not changes and until == state.until_s:
        return state
    return replace(state, objects=state.objects.changed(changes), until_s=until)


def broken(state: WorldState, thing: SceneObject) -> WorldState:
    """Return the state with a thing broken.

    An egg runs out; a screen goes dark and stays; of a vessel only its id is left, out of
    everything, and what lay in it lies where it lay.
    """
    if thing.type == EGG:
        return in_pieces(state, msgspec.structs.replace(thing, is_broken=True))
    if not shatters(thing):
        thing = msgspec.structs.replace(thing, is_broken=True, is_toggled=False)
        return replace(state, objects=state.objects.changed({thing.id: thing}))
    gone = msgspec.structs.replace(thing, is_broken=True, parents=())
    changes = {thing.id: gone, **left_behind(state.objects, thing)}
    return replace(state, objects=state.objects.changed(changes))


def left_behind(objects: Objects, thing: SceneObject) -> dict[str, SceneObject]:
    """Return the contents of a thing, now lying where the thing lies."""
    found = {}
    for child in objects.containment.children.get(thing.id, ()):
        rest = tuple(p for p in objects[child].parents if p != thing.id)
        found[child] = msgspec.structs.replace(objects[child], parents=rest or thing.parents)
    return found


def in_pieces(state: WorldState, source: SceneObject) -> WorldState:
    """Return the state with the pieces of a thing in its place; the source stays, inert."""
    kind = object_types()[source.type].slices_into or ""
    pieces = _pieces(source, kind, object_types()[source.type].slice_count)
    changes = {source.id: msgspec.structs.replace(source, parents=()), **pieces}
    return replace(state, objects=state.objects.changed(changes))


def _pieces(source: SceneObject, kind: str, count: int) -> dict[str, SceneObject]:
    """Return the pieces side by side along the source's longer side, as `<id>|<kind>_<n>`."""
    row = object_types()[kind]
    axis = 0 if source.size[0] >= source.size[2] else 2
    found = {}
    for number in range(count):
        size = list(source.size) if count > 1 else list(row.size_m)
        middle = list(source.center)
        middle[1] = bottom(source) + size[1] / 2
        if count > 1:
            size[axis] /= count
            middle[axis] += (number - (count - 1) / 2) * size[axis]
        place = (round(middle[0], 5), round(middle[1], 5), round(middle[2], 5))
        piece = SceneObject(
            id=part_id(source.id, f"{kind}_{number}"),
            type=kind,
            name=f"{kind}_{number}_of_{source.name}",
            position=place,
            center=place,
            size=(size[0], size[1], size[2]),
            rotation=source.rotation,
            capabilities=row.capabilities,
            mass_kg=row.mass_kg,
            materials=row.materials,
            parents=source.parents,
            is_cooked=source.is_cooked and "cookable" in row.capabilities,
        )
        found[piece.id] = piece
    return found
