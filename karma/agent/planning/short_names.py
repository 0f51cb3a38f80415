"""What things are called in a prompt: `Apple`, `Apple_2`, `Cabinet_7`; and ids put into names."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from karma.agent.seeing.perceive import place_of
from karma.contracts import Area, MemoryUnit, SeenObject
from karma.household.ids import is_part, root_id, short_type, type_of, whole_id
from karma.household.pieces import base_type, is_piece
from karma.household.places import FLOOR, HAND
from karma.household.types import object_types
from karma.household.uses import BASINS, FOUND_BY_SKILL, KNOB, STOVE, without_basin

_ID = re.compile(r"\b[A-Z]\w*\|[\w|+.\-]*\w")


def short_names(
    units: Sequence[MemoryUnit],
    held: tuple[str, str] | None,
    *,
    fixtures: Mapping[str, str] | None = None,
    seen: Sequence[SeenObject] = (),
) -> dict[str, str]:
    """Return names of every recalled unit and its place (-> id): the last used Apple is `Apple`.

    Older things of a type are `Apple_2`, `Apple_3`, ... `held`: id and type of what is in the hand;
    `fixtures`: names that furniture has already; what is `seen` is called by what is left.
    """
    names = dict(fixtures or {})
    known = set(names.values())
    things = [(unit.object_id, unit.object_type) for unit in reversed(units)]
    places = [(unit.place_id, type_of(unit.place_id)) for unit in reversed(units)]
    others = [(sight.object_id, sight.object_type) for sight in seen]
    for object_id, object_type in [*([held] if held else []), *things, *places, *others]:
        if object_id is None or object_id == HAND or object_id in known:
            continue
        names[_free(base_type(object_type), names)] = object_id
        known.add(object_id)
    return names


def _free(base: str, names: Mapping[str, str]) -> str:
    """Return the first name that is left; `Cabinet` is any cabinet where there is a `Cabinet_1`."""
    if base not in names and f"{base}_1" not in names:
        return base
    count = 2
    while f"{base}_{count}" in names:
        count += 1
    return f"{base}_{count}"


def fixture_names(
    areas: Iterable[Area],
    seen: Iterable[SeenObject] = (),
    *,
    before: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """Return names of furniture (-> id): `Fridge`, but `Cabinet_1`, `Cabinet_2`, ... by areas.

    The bare type of what there are several of is no name: it means any of them. Floors, knobs and
    the basins of sinks have no names of their own; where there is only a basin, it is the sink. Nor
    has a tap or burner of which there is one: skills find it. Furniture that was `seen` and the map
    lacks is named after it; `before` are names that it keeps.
    """
    names = dict(before or {})
    things = {one.object_id: one.object_type for area in areas for one in area.fixtures}
    things |= {one.object_id: one.object_type for one in seen if not one.pickupable}
    kinds = set(things.values())
    unnamed = {FLOOR, KNOB, STOVE, *(one for one in BASINS if without_basin(one) in kinds)}
    named = names.values()
    fresh = [
        (one, without_basin(kind))
        for one, kind in things.items()
        if kind not in unnamed and one not in named
        if not any(is_part(other, one) for other in named)  # its basin, as the sink
    ]
    count = Counter(short_type(name) for name in names)
    several = count + Counter(kind for _, kind in fresh)
    for object_id, kind in fresh:
        count[kind] += 1
        if several[kind] > 1:
            names[f"{kind}_{count[kind]}"] = object_id
        elif kind not in FOUND_BY_SKILL:
            names[kind] = object_id
    return names


def furniture(names: Mapping[str, str]) -> dict[str, str]:
    """Return the names that are furniture's: they stay what they are for a whole task."""
    kinds = object_types()
    types = {name: type_of(object_id) for name, object_id in names.items()}
    return {
        name: names[name]
        for name, kind in types.items()
        if kind in kinds and not kinds[kind].can("pickupable")
    }


def stand_ins(
    seen: Iterable[SeenObject], told: Iterable[tuple[str, str | None]] = ()
) -> dict[str, str]:
    """Return id -> id of what stands for it: of the slices of a thing in one place one for all.

    `told`: (id, place) of things that are told of elsewhere, and stand for slices beside them.
    """
    first: dict[tuple[str, str | None], str] = {}
    listed = dict(told)
    for object_id, place in listed.items():
        first.setdefault((_whole(object_id, type_of(object_id)), place), object_id)
    found = {}
    for one in seen:
        key = (_whole(one.object_id, one.object_type), place_of(one))
        own = one.object_id in listed
        found[one.object_id] = one.object_id if own else first.setdefault(key, one.object_id)
    return found


def _whole(object_id: str, object_type: str) -> str:
    """Return the id of what a slice was cut from; what is no slice is its own."""
    return whole_id(object_id) if is_piece(object_type) else object_id


def name_for(object_id: str, name_of: Mapping[str, str]) -> str:
    """Return what an id is called: its name, that of the whole it is a part of, or its type.

    >>> name_for("Sink|1|2|3|SinkBasin", {"Sink|1|2|3": "Sink"}), name_for("Apple|1|2|3", {})
    ('Sink', 'Apple')
    """
    return (
        name_of.get(object_id) or name_of.get(root_id(object_id)) or base_type(type_of(object_id))
    )


def in_names(text: str, name_of: Mapping[str, str]) -> str:
    """Put names in place of the ids in a text.

    >>> in_names("Fridge|1|2|3 is closed", {"Fridge|1|2|3": "Fridge"})
    'Fridge is closed'
    """
    return _ID.sub(lambda found: name_for(found.group(), name_of), text)
