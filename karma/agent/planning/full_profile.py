"""Parts of the full prompt: furniture by name, what is in sight, what failed, what skills need."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from karma.agent.planning.program import SKILL_OF
from karma.agent.planning.short_names import in_names, name_for
from karma.agent.seeing.perceive import place_of
from karma.contracts import Area, FailedProgram, Fixture, PlanRequest, SeenObject, Vec3
from karma.household.ids import short_type
from karma.household.pieces import EGG
from karma.household.places import FLOOR, HAND, NEAR_M
from karma.household.states import SAID_AS
from karma.household.types import object_types, types_with
from karma.household.uses import BURNER, KNIVES, KNOB, WHOLE_OF, with_wholes

_UNSAID = (FLOOR, KNOB)  # no program names them
_DOORS = {one: SAID_AS.get(one, one) for one in ("opened", "closed", "on", "off")}
_LINES = 40  # of a failed program that are shown
_WIDTH = 160  # characters of one of its lines


@dataclass(frozen=True, slots=True, kw_only=True)
class AreaLine:
    """One area node as the prompt has it."""

    name: str
    position_m: Vec3
    adjacent: tuple[str, ...]
    things: tuple[str, ...]  # named furniture with its place, then types without either


def area_line(area: Area, names: Mapping[str, str]) -> AreaLine:
    """Return an area with its furniture.

    `names` are furniture's (-> id); an area without fixtures has its types told.
    """
    name_of = {object_id: name for name, object_id in names.items()}
    named = _placed(area.fixtures, name_of)
    spoken = {*with_wholes(one.object_type for one in area.fixtures if one.object_id in name_of)}
    spoken |= {*_UNSAID, *(basin for basin, whole in WHOLE_OF.items() if whole in area.contains)}
    rest = [kind for kind in area.contains if kind not in spoken]
    return AreaLine(
        name=area.name, position_m=area.position_m, adjacent=area.adjacent, things=(*named, *rest)
    )


def furniture(areas: Sequence[Area], names: Mapping[str, str]) -> list[str]:
    """Return what furniture a map has, by name without places, and types of what has no name."""
    lines = [area_line(replace(area, fixtures=()), {}) for area in areas]
    spoken = {short_type(one) for one in names}
    rest = dict.fromkeys(kind for line in lines for kind in line.things if kind not in spoken)
    return in_runs([*names, *rest])


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


def _placed(things: Iterable[Fixture | SeenObject], name_of: Mapping[str, str]) -> list[str]:
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
