"""Names of things in prompts (`Apple`, `Apple_2`, `Cabinet_7`), and parts of the full prompt.

Those are furniture by name, what is in sight, what failed, and what skills need.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache

from karma.agent.planning.program import SKILL_OF
from karma.agent.seeing.perceive import place_of
from karma.household.ids import is_part, root_id, short_type, type_of, whole_id
from karma.household.pieces import EGG, base_type, is_piece
from karma.household.places import FLOOR, HAND, NEAR_M
from karma.household.states import SAID_AS
from karma.household.types import object_types, types_with
from karma.household.uses import (
    BASINS,
    BURNER,
    FOUND_BY_SKILL,
    KNIVES,
    KNOB,
    STOVE,
    WHOLE_OF,
    with_wholes,
    without_basin,
)
from karma.types.memory import Area, Known, MemoryUnit
from karma.types.observation import SeenObject
from karma.types.planning import FailedProgram, PlanRequest

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


def furniture_names(names: Mapping[str, str]) -> dict[str, str]:
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


# ----------------------------------------------------------------- parts of the full prompt

_UNSAID = (FLOOR, KNOB)  # no program names them
_DOORS = {one: SAID_AS.get(one, one) for one in ("opened", "closed", "on", "off")}
_LINES = 40  # of a failed program that are shown
_WIDTH = 160  # characters of one of its lines


def with_furniture(area: Area, names: Mapping[str, str]) -> Area:
    """Return an area whose contents are named furniture with its place, then types without either.

    `names` are furniture's (-> id).
    """
    name_of = {object_id: name for name, object_id in names.items()}
    named = _placed(area.fixtures, name_of)
    spoken = {*with_wholes(one.object_type for one in area.fixtures if one.object_id in name_of)}
    spoken |= {*_UNSAID, *(basin for basin, whole in WHOLE_OF.items() if whole in area.contains)}
    rest = [kind for kind in area.contains if kind not in spoken]
    return replace(area, contains=(*named, *rest))


def coarse_text(position_m: Sequence[float]) -> str:
    """Return a position to the decimetre, in few tokens.

    >>> coarse_text((1.0, -0.04, 2.345))
    '(1.0,0.0,2.3)'
    """
    return "(" + ",".join(f"{round(v, 1) + 0.0:.1f}" for v in position_m) + ")"


def place_name(place_id: str | None, name_of: Mapping[str, str]) -> str:
    """Return what the place of a thing is called."""
    if place_id is None or place_id == HAND:
        return place_id or "unknown"
    return name_for(place_id, name_of)


def by_place(seen: Iterable[SeenObject], name_of: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the names of things by what they lie in or on, in the order given."""
    found: dict[str, list[str]] = {}
    for one in seen:
        place = place_name(place_of(one), name_of)
        found.setdefault(place, []).append(name_of[one.object_id])
    return found


def off_the_map(
    seen: Iterable[SeenObject], areas: Iterable[Area], names: Mapping[str, str]
) -> list[str]:
    """Return furniture that was seen and the map lacks, by name and place."""
    mapped = {one.object_id for area in areas for one in area.fixtures}
    name_of = {object_id: name for name, object_id in names.items() if object_id not in mapped}
    return _placed(seen, name_of)


def _placed(things: Iterable[Known | SeenObject], name_of: Mapping[str, str]) -> list[str]:
    """Return what of furniture has a name, with its place; burners are all where the stove is."""
    named = [one for one in things if one.object_id in name_of]
    placed = [
        f"{name_of[one.object_id]}{coarse_text(one.position_m)}"
        for one in named
        if one.object_type != BURNER
    ]
    return placed + in_runs(name_of[one.object_id] for one in named if one.object_type == BURNER)


def doors_and_switches(
    seen: Sequence[SeenObject], name_of: Mapping[str, str]
) -> dict[str, list[str]]:
    """Return what was last seen open, closed, on or off, by state; a burner's is its knob's."""
    knobs = {burner: one.states for one in seen for burner in one.controls}
    found: dict[str, list[str]] = {word: [] for word in _DOORS.values()}
    for one in seen:
        if one.object_type not in _UNSAID:
            for word in _DOORS.keys() & {*one.states, *knobs.get(one.object_id, ())}:
                found[_DOORS[word]].append(name_for(one.object_id, name_of))
    return {word: in_runs(names) for word, names in found.items() if names}


def in_runs(names: Iterable[str]) -> list[str]:
    """Return names in order, three and more numbered ones in a row as a run.

    >>> in_runs(["Drawer_3", "Fridge", "Drawer_1", "Drawer_2", "Drawer_5"])
    ['Drawer_1 to Drawer_3', 'Drawer_5', 'Fridge']
    """
    numbered = sorted({(*_numbered(name), name) for name in names})
    runs: list[list[str]] = []
    for n, (kind, number, name) in enumerate(numbered):
        if n and numbered[n - 1][:2] == (kind, number - 1):
            runs[-1].append(name)
        else:
            runs.append([name])
    return [one for run in runs for one in ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else run)]


def _numbered(name: str) -> tuple[str, int]:
    kind, _, number = name.rpartition("_")
    return (kind, int(number)) if kind and number.isdecimal() else (name, 0)


# ----------------------------------------------------------------- what failed


def failed_line(failure: FailedProgram, name_of: Mapping[str, str]) -> str:
    """Return one failure as one line: the call that failed and why."""
    call = "" if failure.failed is None else f"{failure.lines[failure.failed]}: "
    return in_names(f"{call}{failure.reason}", name_of)


def failed_program(request: PlanRequest, name_of: Mapping[str, str]) -> list[str]:
    """Return the lines of the program that failed last, the one that failed marked."""
    if not request.failures:
        return [in_names(request.error, name_of)] if request.error else []
    last = request.failures[-1]
    lines = [
        in_names(line[:_WIDTH], name_of) + _mark(last, number, name_of)
        for number, line in enumerate(last.lines)
    ]
    first = max((last.failed or 0) - _LINES // 2, 0)
    shown = lines[first : first + _LINES]
    return shown if last.failed is not None else [*shown, in_names(last.reason, name_of)]


def _mark(failure: FailedProgram, number: int, name_of: Mapping[str, str]) -> str:
    """Return what became of a line."""
    if failure.failed is None:
        return ""
    if number == failure.failed:
        return f"  # FAILED: {in_names(failure.reason, name_of)}"
    if number > failure.failed or not failure.ran:
        return "  # not run"
    return "  # done"


# ----------------------------------------------------------------- what skills need


@cache
def skill_needs() -> Mapping[str, str]:
    """Return for each skill what it does and needs, where that is more than Listing 2 has.

    The same in all rooms, so that a prompt of another room begins with the same tokens. That towels
    alone go on a TowelHolder its name says.
    """
    kinds = object_types().values()
    shut = [kind.name for kind in kinds if kind.must_be_open and not kind.can("pickupable")]
    picky = [k for k in kinds if k.accepts_only and not k.name.startswith(k.accepts_only)]
    only = [f"{kind.name} {_or(kind.accepts_only)}" for kind in picky]
    facts = {
        "shut": _or(shut),
        "picky": "; ".join(only),
        "egg": EGG,
        "knives": _or(KNIVES),
        "sliceable": _or(sorted(types_with("sliceable"))),
        "near_m": NEAR_M,
    }
    return {name: skill.needs.format(**facts) for name, skill in SKILL_OF.items()}


def _or(words: Sequence[str]) -> str:
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
