"""What things are called in a prompt: `Apple`, `Apple_2`, `Cabinet_7`; and ids put into names."""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence

from karma.contracts import Area, MemoryUnit, SeenObject
from karma.household.ids import root_id, type_of, whole_id
from karma.household.pieces import base_type, is_piece
from karma.household.places import FLOOR, HAND
from karma.household.uses import BASINS, FOUND_BY_SKILL, without_basin

_ID = re.compile(r"\b[A-Z]\w*\|[\w|+.\-]*\w")


def short_names(
    units: Sequence[MemoryUnit],
    held: tuple[str, str] | None,
    *,
    fixtures: Mapping[str, str] | None = None,
    seen: Sequence[SeenObject] = (),
) -> dict[str, str]:
    """Give every recalled unit and its place a short name: the last used Apple is `Apple`.

    Args:
        units: the last used last.
        held: (object id, object type) of what is in the hand.
        fixtures: names that furniture has already.
        seen: more things, called by what names are left.

    Returns:
        name -> object id; older things of the same type become `Apple_2`, `Apple_3`, ...
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


def fixture_names(areas: Iterable[Area]) -> dict[str, str]:
    """Name the furniture of a map: `Fridge`, but `Cabinet_1`, `Cabinet_2`, ... in order of areas.

    The bare type of what there are several of is no name: it means any of them. Floors, the
    basins of sinks and what a skill finds by itself (taps, knobs, burners) have no names of their
    own; where there is only a basin, it is the sink.

    Returns:
        name -> object id.
    """
    things = [one for area in areas for one in area.fixtures]
    kinds = {one.object_type for one in things}
    unnamed = {FLOOR, *FOUND_BY_SKILL, *(one for one in BASINS if without_basin(one) in kinds)}
    things = [one for one in things if one.object_type not in unnamed]
    several = Counter(without_basin(one.object_type) for one in things)
    names, count = dict[str, str](), Counter[str]()
    for one in things:
        kind = without_basin(one.object_type)
        count[kind] += 1
        names[kind if several[kind] == 1 else f"{kind}_{count[kind]}"] = one.object_id
    return names


def one_of_each(
    seen: Iterable[SeenObject], *, besides: Collection[str | None] = ()
) -> list[SeenObject]:
    """Return things with one slice for all slices of a thing.

    Args:
        seen: the things.
        besides: ids of things that are told elsewhere; neither they nor more slices of the same.
    """
    told = {_whole(name, type_of(name)) for name in besides if name}
    found: dict[str, SeenObject] = {}
    for one in seen:
        found.setdefault(_whole(one.object_id, one.object_type), one)
    return [one for whole, one in found.items() if whole not in told]


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
