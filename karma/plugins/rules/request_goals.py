"""Goals of a parsed request, and their program, for use when no answer of the planner will do."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from karma.agent.planning.expert import ExpertView, NamedThing
from karma.agent.planning.plain_program import plain_program
from karma.household import uses
from karma.household.ids import short_type
from karma.household.pieces import piece_type
from karma.household.states import END_STATES, NEEDS
from karma.household.uses import kind_of, switch_of
from karma.plugins.rules.deeds import able_to, deed_kind
from karma.plugins.rules.language.request_words import deed_states
from karma.plugins.rules.request_checker import Guard, meant_by
from karma.plugins.rules.types import Mention, Request, SaidDeed
from karma.types.memory import MemoryUnit
from karma.types.planning import SkillCall
from karma.types.tasks import Goal

_MOVES = ("put", "throw")
_PREDICATES = {state: predicate for predicate, state in END_STATES.items()}
_NEAR = "NEAR"  # as ON, but beside the second object
_COFFEE = (
    Goal(predicate="STATE", arguments=(uses.COFFEE_CUP, "filled")),
    Goal(predicate="TOGGLEON", arguments=(uses.COFFEE_MACHINE,)),
)


def asked_goals(asked: Request, here: Collection[str]) -> tuple[Goal, ...]:
    """Return the goals of a request in the order of its actions, read from its words alone.

    () if an action has no goal. Each object has to be a whole one of a single type, not one of
    several, a piece, or identified by its history, its state or its contents.
    """
    found: list[Goal] = []
    if Guard(asked, here).in_pieces():
        return ()
    for number, deed in enumerate(asked.deeds):
        moved = {kind for one in asked.deeds[number + 1 :] for kind in _moved(one)}
        goals = [_asked_goals(deed, thing, here) for thing in deed.things or (None,)]
        if not all(goals):
            return ()
        held = deed.deed == "take" and moved & {kind for one in deed.things for kind in one.types}
        found += [goal for some in goals for goal in some if not held]
    return tuple(dict.fromkeys(found))


def _moved(deed: SaidDeed) -> Iterator[str]:
    """Yield the types of what a deed moves, beside taking it."""
    if deed.deed in _MOVES:
        yield from (kind for one in deed.things for kind in one.types)


def _asked_goals(deed: SaidDeed, thing: Mention | None, here: Collection[str]) -> tuple[Goal, ...]:
    """Return the goals of an action with one of its objects, () if the words do not tell them."""
    if deed.deed == "coffee":
        return _COFFEE
    state = deed_kind(deed.deed).leaves
    what = _asked_type(thing, here, NEEDS.get(state, "pickupable"))
    arguments: tuple[str, ...]
    match deed.deed:
        case "put":
            where = _asked_type(deed.place, here, "" if deed.near else "receptacle")
            predicate, arguments = _NEAR if deed.near else "ON", (what, where)
        case "throw":
            predicate, arguments = "ON", (what, uses.BIN)
        case "take":
            predicate, arguments = "HOLDON", ("robot", what)
        case _ if state in _PREDICATES:
            predicate, arguments = _PREDICATES[state], (what,)
        case _:
            predicate, arguments = "STATE", (what, state)
    return (Goal(predicate=predicate, arguments=arguments),) if all(arguments) else ()


def program_for(
    goals: Sequence[Goal], units: Sequence[MemoryUnit], names: Mapping[str, str]
) -> tuple[SkillCall, ...]:
    """Return the plain program that makes goals true; () if nothing is left to do.

    `units` are those of the prompt, `names` its short names (-> id).
    """
    unit_of = {unit.object_id: unit for unit in units}
    near = {goal.arguments[1] for goal in goals if goal.predicate == _NEAR}
    known = {name: unit_of[one] for name, one in names.items() if one in unit_of}
    things = [
        NamedThing(
            name=name,
            object_type=known[name].object_type if name in known else short_type(name),
            states=known[name].states if name in known else (),
            holds=name not in near,
        )
        for name in (*known, *(near - known.keys()))
    ]
    placed = [replace(goal, predicate="ON") if goal.predicate == _NEAR else goal for goal in goals]
    return plain_program(placed, ExpertView(things=tuple(things)))


def _asked_type(one: Mention | None, here: Collection[str], need: str) -> str:
    """Return the one type that a mention means here; "" where words alone do not tell.

    It has to be what `need` says, "" for anything.
    """
    if one is None or one.told or one.anything or one.every or one.other or one.holding:
        return ""
    if (one.number or 1) > 1:
        return ""
    if deed_states().keys() & one.text.lower().split():  # "the empty roll": a look must tell
        return ""
    kinds = {
        switch_of(kind) if need == "toggleable" and kind not in uses.TAPS else kind_of(kind)
        for kind in meant_by(one, here)
        if not need
        or able_to(kind, need)
        or (need == "cookable" and able_to(piece_type(kind), need))
    }
    return kinds.pop() if len(kinds) == 1 else ""  # "the light": a lamp, or all of them?
