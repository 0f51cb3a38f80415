"""From what the skills saw and did to units of short-term memory."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from karma.agent.body.sightings import offset, shifted
from karma.agent.seeing.perceive import place_of
from karma.agent.seeing.picture_states import look_at
from karma.household.ids import is_part, type_of, whole_id
from karma.household.places import STAND_CLOSED
from karma.memory.short_term import merged, merged_states
from karma.types.memory import Experience, MemoryUnit
from karma.types.observation import SeenObject
from karma.types.roles import VisionModel


def units_of(
    experience: Experience,
    before: Sequence[MemoryUnit],
    vision: VisionModel,
    instruction: str,
    *,
    scene: str,
    seen_kept: int,
    folder: Path | None = None,
) -> list[MemoryUnit]:
    """Return what to remember: things only seen first, then things handled, in order of use.

    Only what can be carried; immovable things belong to long-term memory. A thing that was cut is
    represented by one slice, the one handled last, which inherits the history of the whole.

    `before` are units whose history goes on in these. Of what was only seen the last `seen_kept`
    things are kept; `folder` takes the pictures that were looked at.
    """
    handled = _handled(experience)
    others = _only_seen(experience, handled)
    kept = others[len(others) - seen_kept :] if seen_kept else []
    sights = [*kept, *(experience.seen[object_id] for object_id in handled)]
    looked = look_at(vision, instruction, sights, experience.views, folder)
    by_id = {unit.object_id: unit for unit in before}
    found = []
    for sight in sights:
        name = sight.object_id
        states = (*experience.effects.get(name, ()), *looked.states.get(name, ()))
        image = looked.images.get(name)
        unit = unit_of(sight, states, handled=name in handled, image=image, scene=scene)
        whole = whole_id(name) if whole_id(name) in experience.cut else ""
        old = by_id.get(name) or by_id.get(whole)
        found.append(merged(old, unit) if old is not None else unit)
    return found


def as_left(units: Iterable[MemoryUnit], experience: Experience) -> list[MemoryUnit]:
    """Return units with what the agent's deeds made of them, handled or not.

    What a tap or an oven did to a thing that was only remembered there is added. What was poured
    out is not filled: other states end when their opposite comes; these have none. What was seen is
    where it was seen; what lies in a thing that was moved has moved with it.
    """
    before = {unit.object_id: unit for unit in units}
    changed = []
    for unit in before.values():
        ended = experience.ended.get(unit.object_id, ())
        effects = experience.effects.get(unit.object_id, ())
        states = tuple(word for word in unit.states if word not in ended)
        placed = _placed(unit, before, experience)
        changed.append(replace(placed, states=merged_states(states, effects)))
    return changed


def lost(units: Iterable[MemoryUnit], experience: Experience) -> list[MemoryUnit]:
    """Return the units to forget: cut, missed where they were, or thrown with what they lay in."""
    before = {unit.object_id: unit for unit in units}

    def is_spilled(unit: MemoryUnit | None, depth: int = 0) -> bool:
        if unit is None or depth > len(before) or unit.object_id in experience.seen:
            return False
        return unit.place_id in experience.spilled or is_spilled(
            before.get(unit.place_id or ""), depth + 1
        )

    return [
        unit for unit in before.values() if unit.object_id in experience.gone or is_spilled(unit)
    ]


def _placed(
    unit: MemoryUnit, before: Mapping[str, MemoryUnit], experience: Experience
) -> MemoryUnit:
    """Return a unit where it is by now, as far as the agent's own eyes and hands know."""
    sight = experience.seen.get(unit.object_id)
    if sight is not None:
        return replace(unit, position_m=sight.position_m, place_id=place_of(sight))
    holder, passed = unit.place_id, set[str]()
    while holder is not None and holder not in passed:
        passed.add(holder)
        sight, then = experience.seen.get(holder), before.get(holder)
        if sight is not None:
            if not sight.pickupable:
                return unit
            by = offset(then.position_m, sight.position_m) if then is not None else None
            at = shifted(unit.position_m, by) if by is not None else sight.position_m
            return replace(unit, position_m=at)
        holder = then.place_id if then is not None else None
    return unit


def shut_away(units: Iterable[MemoryUnit], among: Iterable[MemoryUnit]) -> tuple[MemoryUnit, ...]:
    """Return units as they are told: what lies in a thing behind a door lies behind that door.

    `among` is what is remembered of the room.
    """
    places = {unit.object_id: unit.place_id for unit in among}
    found = []
    for unit in units:
        place, passed = unit.place_id, set[str]()
        while place is not None and place not in passed and type_of(place) not in STAND_CLOSED:
            passed.add(place)
            place = places.get(place)
        door = place if place is not None and place not in passed else unit.place_id
        found.append(replace(unit, place_id=door))
    return tuple(found)


def unit_of(
    sight: SeenObject, states: Sequence[str], *, handled: bool, image: str | None, scene: str = ""
) -> MemoryUnit:
    """Return the line of short-term memory for one sight of an object.

    `states` are in the order they came about, "none" is dropped; `image` is a path below the run
    folder.
    """
    return MemoryUnit(
        object_id=sight.object_id,
        object_type=sight.object_type,
        position_m=sight.position_m,
        states=tuple(dict.fromkeys(word for word in states if word != "none")),
        place_id=place_of(sight),
        handled=handled,
        image=image,
        scene=scene,
    )


def _only_seen(experience: Experience, handled: Sequence[str]) -> list[SeenObject]:
    """Return the sights of what can be carried and was not handled, nor cut off a whole."""
    return [
        sight
        for object_id, sight in experience.seen.items()
        if sight.pickupable and object_id not in handled and object_id not in experience.cut
        if not any(is_part(object_id, whole) for whole in experience.cut)
    ]


def _handled(experience: Experience) -> list[str]:
    """Return the ids that stand for what was handled, by last use."""
    last: dict[str, None] = {}
    for object_id in experience.handled_ids:
        name = _standing_for(object_id, experience, last)
        sight = experience.seen.get(name)
        if sight is not None and sight.pickupable:
            last.pop(name, None)
            last[name] = None
    return list(last)


def _standing_for(object_id: str, experience: Experience, before: Iterable[str]) -> str:
    """Return the id itself, or the slice that stands for a whole that was cut."""
    if object_id not in experience.cut:
        return object_id
    parts = [name for name in experience.seen if is_part(name, object_id)]
    used = [name for name in before if name in parts]
    return (used or sorted(parts) or [object_id])[-1]
