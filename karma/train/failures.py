"""What an earlier program failed on, in the agent's words, and the program that goes on from there.

The words are those of `karma.agent` (reach, search, handling, inspector) for small planners.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from karma.agent.planning.program import SKILL_OF
from karma.bench.drawing.memories import Rng, pick, place_type, weighted
from karma.bench.drawing.referring_expressions import Situation
from karma.contracts import SkillCall
from karma.household.ids import short_type
from karma.household.pieces import base_type
from karma.household.places import HAND, landmark_types, surface_for
from karma.household.types import object_types, types_with

FAILED = 0.08  # share of prompts that tell of a failure
SORTS = {"lost": 3, "missed": 2, "shut": 3, "full hand": 0.0, "empty hand": 0.5, "wrong": 4}
HELD = 12.0  # weight of a full hand where something is held
ALIKE = 8  # types that one may be taken for


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnFailure:
    """What the next prompt says, and the program to answer with."""

    error: str
    calls: tuple[SkillCall, ...]


def draw_failure(
    rng: Rng, scene: Situation, calls: tuple[SkillCall, ...], *, wanted: frozenset[str]
) -> DrawnFailure:
    """Draw what went wrong before a program; mostly nothing did.

    `calls`: the program of one to whom nothing has happened; `wanted`: types that the request
    is about, which were not the mistake.
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
    """Tell of a thing whose place was not known, or not that any more: it is searched for."""
    name = pick(rng, [call.objects[0] for call in calls])
    kind = short_type(name)
    words, skill = f"no {name} is known; Explore(robot, '{name}') first", "GoToObject"
    if kind not in landmark_types() and rng.random() < 0.6:
        words = f"{kind} is not at its remembered place; Explore(robot, '{kind}') to find it"
        skill = pick(rng, ("GoToObject", "PickupObject"))
    return DrawnFailure(error=f"{skill}(robot, '{name}'): {words}", calls=calls)


def _missed(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure:
    """Tell of something that may go well the next time."""
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
    """Tell of a thing that is shut in: what it is in is opened, and closed when it is out."""
    taken = [n for n, call in enumerate(calls) if call.skill == "PickupObject" and n]
    if not taken or calls[taken[0] - 1].skill != "GoToObject":
        return None
    at = taken[0]
    name = calls[at].objects[0]
    unit = next((one for one in scene.units if scene.names[one.object_id] == name), None)
    place = place_type(scene.units, unit.place_id) if unit and unit.place_id else ""
    kind = object_types()[short_type(name)]
    if place == HAND:
        return None
    if not place:
        places = [one for one in scene.room.landmarks if kind.fits(object_types()[one])]
        places = [one for one in places if object_types()[one].must_be_open]
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
    """Tell of what is in the hand: it is put down before another thing is taken."""
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
    """Tell of a thing that was to be put down and had not been picked up."""
    put = next((call for call in calls if call.skill == "PutObject"), None)
    if put is None:
        return None
    words = f"the hand is empty; PickupObject(robot, '{put.objects[0]}') first"
    return DrawnFailure(error=f"{put}: {words}", calls=calls)


def _mistaken(
    rng: Rng, scene: Situation, calls: tuple[SkillCall, ...], wanted: frozenset[str]
) -> DrawnFailure | None:
    """Tell of another type that the words were taken for, which it cannot have been."""
    call = pick(rng, calls)
    at = int(rng.integers(len(call.objects)))
    kind = short_type(call.objects[at])
    others = [one for one in _taken_for(kind) if one not in wanted]
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
    elif (skill := SKILL_OF[call.skill]).cannot and not skill.hand:
        words = f"{other} {skill.cannot}"
    else:
        words = f"no {other} is known; Explore(robot, '{other}') first"
    return DrawnFailure(error=f"{told}: {words}", calls=calls)


@cache
def _taken_for(kind: str) -> Sequence[str]:
    """Return the types that are most like one: they go to the same places, and can the same."""
    kinds = object_types()
    info = kinds[kind]
    able = frozenset(info.capabilities)
    movable = "pickupable" in able
    pool = types_with("pickupable") if movable else landmark_types()

    def unlike(other: str) -> tuple[int, str]:
        places = frozenset(info.goes_in or ()) ^ frozenset(kinds[other].goes_in or ())
        return len(places) + 3 * len(able ^ frozenset(kinds[other].capabilities)), other

    return sorted((one for one in pool if base_type(one) != base_type(kind)), key=unlike)[:ALIKE]


def _call(skill: str, *objects: str) -> SkillCall:
    return SkillCall(skill=skill, objects=objects)
