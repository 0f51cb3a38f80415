"""From what the skills saw and did to units of short-term memory."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from karma.agent.body.sightings import carried
from karma.agent.seeing.perceive import place_of
from karma.agent.seeing.picture_states import look_at
from karma.household.containment import holders
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
    others = [
        sight
        for object_id, sight in experience.seen.items()
        if sight.pickupable and object_id not in handled and object_id not in experience.cut
        if not any(is_part(object_id, whole) for whole in experience.cut)
    ]
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
    """Return units as the agent's actions left them, handled or not.

    An object that was seen is where it was seen; the contents of an object that was moved have
    moved with it. Poured-out objects are not filled; other states end when their opposite comes.
    """
    before = {unit.object_id: unit for unit in units}
    changed = []
    for name, unit in before.items():
        sight = experience.seen.get(name)
        at = sight.position_m if sight else carried(unit, before.get, experience.seen)
        drained = ("filled",) if name in experience.emptied else ()
        states = tuple(word for word in unit.states if word not in drained)
        changed.append(
            replace(
                unit,
                position_m=at,
                place_id=place_of(sight) if sight else unit.place_id,
                states=merged_states(states, experience.effects.get(name, ())),
            )
        )
    return changed


def lost(units: Iterable[MemoryUnit], experience: Experience) -> list[MemoryUnit]:
    """Return the units to forget: cut, missed where they were, or thrown with their receptacle."""
    units = tuple(units)
    places = {unit.object_id: unit.place_id for unit in units}

    def is_spilled(unit: MemoryUnit) -> bool:
        name = unit.object_id
        for holder in holders(unit.place_id, places.get):
            if name in experience.seen:
                return False
            if holder in experience.spilled:
                return True
            name = holder
        return False

    return [unit for unit in units if unit.object_id in experience.gone or is_spilled(unit)]


def shut_away(units: Iterable[MemoryUnit], among: Iterable[MemoryUnit]) -> tuple[MemoryUnit, ...]:
    """Return units for a prompt: the contents of an object behind a door lie behind that door.

    `among` is the memory of the room.
    """
    places = {unit.object_id: unit.place_id for unit in among}
    found = []
    for unit in units:
        around = holders(unit.place_id, places.get)
        doors = (place for place in around if type_of(place) in STAND_CLOSED)
        found.append(replace(unit, place_id=next(doors, unit.place_id)))
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


def _handled(experience: Experience) -> list[str]:
    """Return the ids that stand for what was handled, by last use."""
    last: dict[str, None] = {}
    for name in experience.handled_ids:
        if name in experience.cut:  # a slice stands for the whole
            parts = [part for part in experience.seen if is_part(part, name)]
            used = [part for part in last if part in parts]
            name = (used or sorted(parts) or [name])[-1]
        sight = experience.seen.get(name)
        if sight is not None and sight.pickupable:
            last.pop(name, None)
            last[name] = None
    return list(last)
