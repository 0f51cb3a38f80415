"""The past in training examples: short-term memories and failures of earlier programs.

A memory is the result of a few requests and of objects seen on the way; rules record effects, no
simulator runs. Failures are in the words of `karma.agent` (reach, search, handling, inspector),
with the program that continues from there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

from karma.agent.planning.program import SKILL_OF
from karma.household import uses
from karma.household.containment import goes_in
from karma.household.ids import part_id, short_type
from karma.household.pieces import base_type, is_piece
from karma.household.places import HAND, SEVERAL, landmark_types, surface_for
from karma.household.types import ObjectType, object_types, types_with
from karma.plugins.rules.language.lexemes import lexicon
from karma.plugins.training.drawing.memories import (
    CAPACITY,
    KnownRoom,
    RequestHistory,
    Rng,
    pick,
    place_type,
    unit_of,
    weighted,
)
from karma.plugins.training.drawing.referring_expressions import Situation
from karma.plugins.training.drawing.requests import NEEDS, STATE_AFTER, suits
from karma.types.memory import MemoryUnit
from karma.types.planning import SkillCall
from karma.types.tasks import Goal

EVENTS = {
    "place": 30, "stack": 10, "clean": 14, "slice": 10, "heat": 6, "cook": 4, "cool": 5, "fill": 5,
    "coffee": 3, "hold": 8, "switch": 5, "door": 6, "trash": 3,
}  # kind of request -> weight in a history  # fmt: skip
MAX_REQUESTS = 6
NUMBERED = (*SEVERAL, "Sofa", "ArmChair")  # receptacles that get a number of 1 to 3
SEEN_SHARE, KNOWN_SHARE, DIRTY_SHARE = 0.55, 0.45, 0.3


def live_memory(rng: Rng, room: KnownRoom) -> tuple[tuple[MemoryUnit, ...], MemoryUnit | None]:
    """Sample the short-term memory after some requests, and the unit in the hand, if any.

    The unit used last comes last.
    """
    history = RequestHistory()
    for _ in range(int(rng.integers(0, MAX_REQUESTS + 1))):
        _see(rng, room, history)
        history.apply(_goals(rng, room, history, weighted(rng, EVENTS)))
        while len(history.units) > CAPACITY:
            seen = [unit for unit in history.units if not unit.handled] or history.units
            history.units.remove(seen[0])
    in_hand = [unit for unit in history.units if unit.place_id == HAND][-1:]
    units = tuple(_in_place(rng, room, u, is_held=u in in_hand) for u in history.units)
    return units, next((unit for unit in units if unit.place_id == HAND), None)


def _see(rng: Rng, room: KnownRoom, history: RequestHistory) -> None:
    """Remember up to two objects that were seen and not handled."""
    for _ in range(2):
        pool = [k for k in room.movables if k in lexicon() and history.known(k) is None]
        if pool and rng.random() < SEEN_SHARE:
            kind = pick(rng, pool)
            states, place = _first_states(rng, object_types()[kind]), _receptacle(rng, room, kind)
            history.units.append(unit_of(kind, kind, states=states, place_id=place))


def _first_states(rng: Rng, info: ObjectType) -> tuple[str, ...]:
    states = []
    if "dirtyable" in info.capabilities and rng.random() < DIRTY_SHARE:
        states.append("dirty")
    if "toggleable" in info.capabilities:
        states.append("on" if rng.random() < 0.3 else "off")
    if "openable" in info.capabilities:
        states.append("opened" if rng.random() < 0.5 else "closed")
    if "canBeUsedUp" in info.capabilities and rng.random() < 0.08:
        states.append("used up")
    return tuple(states)


def _receptacle(rng: Rng, room: KnownRoom, kind: str) -> str | None:
    info = object_types()[kind]
    fitting = [name for name in room.landmarks if info.fits(object_types()[name])]
    return pick(rng, fitting) if fitting else None


def _goals(rng: Rng, room: KnownRoom, history: RequestHistory, kind: str) -> Sequence[Goal]:
    """Sample the goals of a request of a kind; () if the room offers none."""
    if kind in NEEDS and NEEDS[kind] not in room.landmarks:
        return ()
    able = {"switch": "toggleable", "door": "openable"}.get(kind, "pickupable")
    name = _object(rng, room, history, lambda name: able in object_types()[name].capabilities
                   and suits(kind, name))  # fmt: skip
    if name is None:
        return ()
    if kind in STATE_AFTER:
        return (_goal("STATE", name, STATE_AFTER[kind]),)
    if kind == "coffee":
        return (_goal("STATE", name, "filled"), _goal("INSIDE", name, uses.COFFEE_MACHINE))
    if kind == "hold":
        return (_goal("HOLDON", "robot", name),)
    if kind in ("switch", "door"):
        return (_goal(pick(rng, PREDICATES[kind]), name),)
    if kind == "trash":
        return (_goal("INSIDE", name, uses.BIN),)
    dish = None
    if kind == "stack":
        dish = _object(rng, room, history, lambda other: other != name and goes_in(name, other))
    place = dish or _receptacle(rng, room, name)
    return (_goal("ON", name, place),) if place else ()


PREDICATES = {"switch": ("TOGGLEON", "TOGGLEOFF"), "door": ("OPEN", "CLOSED")}


def _object(
    rng: Rng, room: KnownRoom, history: RequestHistory, fits: Callable[[str], bool]
) -> str | None:
    """Sample a type for a request: known, more often new; return None if no type fits."""
    known = [base_type(unit.object_type) for unit in history.units]
    fitting = [name for name in known if fits(name)]
    if fitting and rng.random() < KNOWN_SHARE:
        return pick(rng, fitting)
    pool = [k for k in room.movables if k in lexicon() and k not in known and fits(k)]
    return pick(rng, pool) if pool else None


def _in_place(rng: Rng, room: KnownRoom, unit: MemoryUnit, *, is_held: bool) -> MemoryUnit:
    """Return a unit in a numbered receptacle; without a place it was put down on a surface."""
    place = unit.place_id
    if (place is None and unit.handled) or (place == HAND and not is_held):
        place = "CounterTop" if "CounterTop" in room.landmarks else "SideTable"
    if place in landmark_types():
        number = int(rng.integers(1, 4)) if place in NUMBERED else 1
        place = part_id(uses.BASIN_OF.get(place, place), str(number))
    return replace(unit, place_id=place, states=tuple(dict.fromkeys(unit.states)))


def with_twins(rng: Rng, room: KnownRoom, units: tuple[MemoryUnit, ...]) -> tuple[MemoryUnit, ...]:
    """Add one or two objects of a remembered type, elsewhere and in other states."""
    loose = [unit for unit in units if not is_piece(unit.object_type)]
    if not loose or len(units) >= CAPACITY:
        return units
    found = list(units)
    first = pick(rng, loose)
    info = object_types()[first.object_type]
    places = [name for name in room.landmarks if info.fits(object_types()[name])]
    for number in range(min(int(rng.integers(1, 3)), CAPACITY - len(found))):
        twin = replace(
            first,
            object_id=f"{info.name}|{90 + number}",
            states=tuple(state for state in first.states if rng.random() < 0.3),
            place_id=f"{pick(rng, places)}|1" if places else None,
            handled=bool(rng.random() < 0.6),
        )
        found.insert(int(rng.integers(len(found) + 1)), twin)
    return tuple(found)


# ----------------------------------------------------------------- failures


FAILED = 0.08  # share of prompts that tell of a failure
SORTS = {"lost": 3, "missed": 2, "shut": 3, "full hand": 0.0, "empty hand": 0.5, "wrong": 4}
HELD = 12.0  # weight of a full hand where something is held
ALIKE = 8  # types that another may be taken for


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnFailure:
    """Error of the next prompt, and the program that answers it."""

    error: str
    calls: tuple[SkillCall, ...]


def draw_failure(
    rng: Rng, scene: Situation, calls: tuple[SkillCall, ...], *, wanted: frozenset[str]
) -> DrawnFailure:
    """Sample a failure before a program; mostly none.

    `calls`: the program without a failure; `wanted`: the request's types, which are no mistake.
    """
    if rng.random() > FAILED:
        return DrawnFailure(error="", calls=calls)
    sorts = {**SORTS, "full hand": HELD if scene.facts.held_type else 0.0}
    tell = {
        "lost": _lost, "missed": _missed, "shut": _shut_in, "full hand": _full_hand,
        "empty hand": _empty_hand,
    }.get(weighted(rng, sorts))  # fmt: skip
    found = tell(rng, scene, calls) if tell is not None else _mistaken(rng, scene, calls, wanted)
    return found or _lost(rng, scene, calls)


def _lost(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure:
    """Report an object at no known place: the program searches for it."""
    name = pick(rng, [call.objects[0] for call in calls])
    kind = short_type(name)
    words, skill = f"no {name} is known; Explore(robot, '{name}') first", "GoToObject"
    if kind not in landmark_types() and rng.random() < 0.6:
        words = f"{kind} is not at its remembered place; Explore(robot, '{kind}') to find it"
        skill = pick(rng, ("GoToObject", "PickupObject"))
    return DrawnFailure(error=f"{skill}(robot, '{name}'): {words}", calls=calls)


def _missed(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure:
    """Report a failure that may not happen again."""
    call = pick(rng, calls)
    name, spent = call.objects[-1], int(rng.integers(40, 900))
    words = (
        f"could not get {short_type(name)} into view and reach",
        f"gave up after {spent} actions on {name}",
        "No valid positions to place object found",
    )
    return DrawnFailure(
        error=f"{call}: {words[int(rng.integers(2 + (len(call.objects) > 1)))]}", calls=calls
    )


def _shut_in(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure | None:
    """Report an object in a closed receptacle: the program opens and closes it."""
    taken = [n for n, call in enumerate(calls) if call.skill == "PickupObject" and n]
    if not taken or calls[taken[0] - 1].skill != "GoToObject":
        return None
    at = taken[0]
    name = calls[at].objects[0]
    unit = next((unit for unit in scene.units if scene.names[unit.object_id] == name), None)
    place = place_type(scene.units, unit.place_id) if unit and unit.place_id else ""
    kind = object_types()[short_type(name)]
    if place == HAND:
        return None
    if not place:
        places = [place for place in scene.room.landmarks if kind.fits(object_types()[place])]
        places = [place for place in places if object_types()[place].must_be_open]
        place = pick(rng, places) if places else ""
    if place not in landmark_types() or not object_types()[place].must_be_open:
        return None
    word = kind.name
    error = (
        f"PickupObject(robot, '{name}'): {word} is in the closed {place}; "
        f"OpenObject(robot, '{place}') first"
    )
    opened = (_call("GoToObject", place), _call("OpenObject", place))
    got = (calls[at], _call("CloseObject", place))
    return DrawnFailure(error=error, calls=(*calls[: at - 1], *opened, *got, *calls[at + 1 :]))


def _full_hand(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure | None:
    """Report a full hand: the program puts the held object down first."""
    held = base_type(scene.facts.held_type or "")
    first = next((call.objects[0] for call in calls if call.skill == "PickupObject"), "")
    if not held or not first or base_type(short_type(first)) == held:
        return None
    there = scene.room.landmarks if scene.mapped else ()
    surface = surface_for(held, frozenset(there).__contains__)
    if scene.mapped and surface not in there:
        return None
    error = (
        f"PickupObject(robot, '{first}'): the hand holds {held}; put it down first, "
        f"e.g. PutObject(robot, '{held}', '{surface}')"
    )
    put = (_call("GoToObject", surface), _call("PutObject", held, surface))
    return DrawnFailure(error=error, calls=(*put, *calls))


def _empty_hand(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure | None:
    """Report an empty hand at a PutObject."""
    put = next((call for call in calls if call.skill == "PutObject"), None)
    if put is None:
        return None
    words = f"the hand is empty; PickupObject(robot, '{put.objects[0]}') first"
    return DrawnFailure(error=f"{put}: {words}", calls=calls)


def _mistaken(
    rng: Rng, scene: Situation, calls: tuple[SkillCall, ...], wanted: frozenset[str]
) -> DrawnFailure | None:
    """Report a wrong type that the words were mistaken for."""
    call = pick(rng, calls)
    at = int(rng.integers(len(call.objects)))
    kind = short_type(call.objects[at])
    others = [other for other in _taken_for(kind) if other not in wanted]
    if not others:
        return None
    other = pick(rng, others)
    told = SkillCall(
        skill=call.skill,
        objects=tuple(other if n == at else name for n, name in enumerate(call.objects)),
    )
    missing = kind not in landmark_types() and rng.random() < 0.7
    if missing:
        places = int(rng.integers(2, 40))
        words = f"could not find {other}; searched {places} places"
        return DrawnFailure(error=f"Explore(robot, '{other}'): {words}", calls=calls)
    if call.skill == "PutObject":
        words = f"{told.objects[0]} cannot be placed in {told.objects[1]}"
    elif (skill := SKILL_OF[call.skill]).cannot and call.skill != "PickupObject":
        words = f"{other} {skill.cannot}"
    else:
        words = f"no {other} is known; Explore(robot, '{other}') first"
    return DrawnFailure(error=f"{told}: {words}", calls=calls)


@cache
def _taken_for(kind: str) -> Sequence[str]:
    """Return the types most like a type: by receptacles and capabilities."""
    kinds = object_types()
    info = kinds[kind]
    able = frozenset(info.capabilities)
    movable = "pickupable" in able
    pool = types_with("pickupable") if movable else landmark_types()

    def unlike(other: str) -> tuple[int, str]:
        places = frozenset(info.goes_in or ()) ^ frozenset(kinds[other].goes_in or ())
        return len(places) + 3 * len(able ^ frozenset(kinds[other].capabilities)), other

    return sorted((other for other in pool if base_type(other) != base_type(kind)), key=unlike)[
        :ALIKE
    ]


def _call(skill: str, *objects: str) -> SkillCall:
    return SkillCall(skill=skill, objects=objects)


def _goal(predicate: str, *arguments: str) -> Goal:
    return Goal(predicate=predicate, arguments=arguments)
