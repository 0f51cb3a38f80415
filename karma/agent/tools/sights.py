"""Describe sights in text: stable names, locations, and changes since the last prompt."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from karma.agent.planning.full_profile import fixture_names, in_runs, name_for
from karma.agent.seeing.perceive import place_of
from karma.household.places import FLOOR, HAND
from karma.household.uses import KNOB
from karma.types.memory import Area, MemoryUnit
from karma.types.observation import SeenObject

_USUAL = frozenset({"closed", "off", "none"})  # states that are not mentioned at first sight
_UNMENTIONED = frozenset({FLOOR, KNOB})  # types without names of their own


def with_names(
    names: Mapping[str, str],
    areas: Iterable[Area],
    seen: Iterable[SeenObject],
    units: Iterable[MemoryUnit] = (),
) -> dict[str, str]:
    """Return names (-> object id) with those of new objects; a name never changes.

    Furniture is `Fridge`, or `Cabinet_1`, `Cabinet_2` where there are several. A movable object is
    `Mug`, the next of its type `Mug_2`.
    """
    sights = list(seen)
    found = fixture_names(areas, sights, before=names)
    known = set(found.values())
    movable = [(sight.object_id, sight.object_type) for sight in sights if sight.pickupable]
    for object_id, object_type in (*((u.object_id, u.object_type) for u in units), *movable):
        if object_id not in known:
            found[_free_name(object_type, found)] = object_id
            known.add(object_id)
    return found


def _free_name(object_type: str, names: Mapping[str, str]) -> str:
    if object_type not in names:
        return object_type
    number = 2
    while f"{object_type}_{number}" in names:
        number += 1
    return f"{object_type}_{number}"


def map_text(areas: Iterable[Area], names: Mapping[str, str]) -> str:
    """Return the map as text: a line with the fixtures of each area."""
    name_of = {object_id: name for name, object_id in names.items()}
    lines = []
    for area in areas:
        known = [name_of[entry.object_id] for entry in area.fixtures if entry.object_id in name_of]
        if known:
            lines.append(", ".join(in_runs(known)))
    return "\n".join(lines)


def unit_text(unit: MemoryUnit, name_of: Mapping[str, str]) -> str:
    """Return a unit of short-term memory: `Apple (sliced) in Fridge`."""
    states = [word for word in unit.states if word not in _USUAL]
    shown = f" ({', '.join(states)})" if states else ""
    place = name_for(unit.place_id, name_of) if unit.place_id and unit.place_id != HAND else ""
    return name_for(unit.object_id, name_of) + shown + (f" at {place}" if place else "")


@dataclass(frozen=True, slots=True)
class Shown:
    """Location and states of each object as last shown to the model, by object id."""

    objects: Mapping[str, tuple[str | None, tuple[str, ...]]]

    def news(self, seen: Mapping[str, SeenObject], names: Mapping[str, str]) -> tuple[str, "Shown"]:
        """Return the changes by location as text, and the updated record.

        `seen` are all objects that the agent knows to be there.
        """
        name_of = {object_id: name for name, object_id in names.items()}
        now = dict(self.objects)
        by_place: dict[str, list[str]] = {}
        fixed: list[str] = []
        held: list[str] = []
        for object_id, sight in seen.items():
            state = (place_of(sight), sight.states)
            before = now.get(object_id)
            if before == state or sight.object_type in _UNMENTIONED:
                continue
            now[object_id] = state
            states = [w for w in sight.states if w != "none" and (before or w not in _USUAL)]
            shown = name_for(object_id, name_of) + (f" ({', '.join(states)})" if states else "")
            if not sight.pickupable:
                if states:
                    fixed.append(shown)
            elif state[0] == HAND:
                held += [shown] if states else []
            else:
                place = name_for(state[0], name_of) if state[0] else "unknown place"
                by_place.setdefault(place, []).append(shown)
        gone = [name_for(object_id, name_of) for object_id in now if object_id not in seen]
        parts = [f"{place}: {', '.join(in_runs(shown))}" for place, shown in by_place.items()]
        parts += [", ".join(in_runs(fixed))] if fixed else []
        parts += [f"in the hand: {held[0]}"] if held else []
        parts += [f"no longer there: {', '.join(in_runs(gone))}"] if gone else []
        kept = {object_id: state for object_id, state in now.items() if object_id in seen}
        return "; ".join(parts), Shown(kept)
