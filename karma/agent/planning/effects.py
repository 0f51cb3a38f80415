"""What a program brings about if all of it goes well, by types: for a check before its first step.

Which of its lines are about another thing of the same name, and which part of it is what was asked.
Not what the agent knows afterwards: that is in `afterwards`, by its own eyes.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

from karma.agent.planning.program import CHANGES, DEEDS, DOOR_AFTER, PUTS, SWITCH_AFTER, WAYS
from karma.contracts import SkillCall
from karma.household.ids import short_type
from karma.household.places import FLOOR, HAND
from karma.household.uses import (
    BIN,
    BURNER,
    COFFEE_MACHINE,
    COOKWARE,
    FRIDGE,
    MICROWAVE,
    TAP_OF,
    TAPS,
    TOASTER,
    kind_of,
)


@dataclass(slots=True)
class _Chain:
    """What a program has done so far with the things of one name."""

    turn: int = 0  # things of the name that are put away
    places: set[str] = field(default_factory=set)  # where this turn's thing was put
    since: int = 0  # the line after it was last put down
    cuts: bool = False  # it is carried to cut with: a tool may go back to its place


def with_turns(calls: Sequence[SkillCall]) -> tuple[SkillCall, ...]:
    """Return a program whose lines say how many things of their name were put away before.

    A small planner asks for two pens by saying the same lines twice. Nothing in them tells the
    second pen from the first, but a plan puts no thing twice into the same place.
    A line of a later turn searches where it would only go: the other thing may be anywhere.

    >>> lines = [SkillCall.of("PickupObject", "Pen"),
    ...          SkillCall.of("PutObject", "Pen", "Desk")]
    >>> [call.turn for call in with_turns([*lines, *lines])]
    [0, 0, 1, 1]
    """
    found, chains = list(calls), dict[str, _Chain]()
    for number, call in enumerate(calls):
        name = call.objects[0]
        chain = chains.setdefault(name, _Chain(since=number))
        if call.skill == "SliceObject":
            for other in chains.values():
                other.cuts = True
        if call.skill == "PutObject" and call.objects[1:]:
            place = call.objects[1]
            if place in chain.places and not chain.cuts and name == short_type(name):
                chain.turn, chain.places = chain.turn + 1, set()
                _turn(found, range(chain.since, number + 1), name, chain.turn)
            chain.places.add(place)
            chain.since, chain.cuts = number + 1, False
        if chain.turn:
            _turn(found, range(number, number + 1), name, chain.turn)
    return tuple(found)


def _turn(found: list[SkillCall], lines: range, name: str, turn: int) -> None:
    for line in lines:
        call = found[line]
        if call.objects[0] == name:
            searched = call.skill == "GoToObject" and call.turn != turn
            found[line] = replace(call, turn=turn, skill="Explore" if searched else call.skill)


_BY_RUNNING: Mapping[str, tuple[str, ...]] = {
    MICROWAVE: ("heat", "cook"), BURNER: ("heat", "cook"), TOASTER: ("toast", "heat", "cook"),
    COFFEE_MACHINE: ("coffee", "fill"),
}  # of what lies there when it is switched on  # fmt: skip

Thing = tuple[str, int]  # name in the program, and which of that name


@dataclass(slots=True)
class ProgramEffects:
    """What a program adds up to; kinds are types of wholes (`reading.kind_of`)."""

    at: dict[Thing, str] = field(default_factory=dict)  # moved things -> kind of the last place
    inside: dict[Thing, str] = field(default_factory=dict)  # the same -> name of that place
    near: set[Thing] = field(default_factory=set)  # put beside it, not in or on it
    passed: dict[Thing, list[str]] = field(default_factory=dict)  # kinds of all places, in order
    deeds: set[tuple[str, Thing]] = field(default_factory=set)  # ("slice", thing)
    ever: set[tuple[str, Thing]] = field(default_factory=set)  # the same, undone or not
    switched: dict[str, str] = field(default_factory=dict)  # kind -> "on", "off", as it is left
    ran: set[str] = field(default_factory=set)  # kinds that were on at some time
    doors: dict[str, str] = field(default_factory=dict)  # kind -> "open", "close", as it is left
    opened: set[str] = field(default_factory=set)
    visited: set[str] = field(default_factory=set)  # kinds of all that it names
    held: Thing | None = None
    began: Thing | None = None  # what was held before

    def places(self, thing: Thing) -> frozenset[str]:
        """Return the kinds of what a thing is in or on at the end, and of what that is in."""
        found: set[str] = set()
        at, name = self.at.get(thing, ""), self.inside.get(thing, "")
        for _ in range(5):
            if not at or at in found:
                break
            found.add(at)
            holder = next((one for one in self.at if one[0] == name), None)
            at, name = (self.at[holder], self.inside.get(holder, "")) if holder else ("", "")
        return frozenset(found)

    def did(self, deed: str, kinds: Iterable[str]) -> bool:
        """Return whether something was done to a thing of one of some kinds."""
        wanted = set(kinds)
        return any(one == deed and kind_of(thing[0]) in wanted for one, thing in self.deeds)

    def of(self, kinds: Iterable[str]) -> list[Thing]:
        """Return the moved things of some kinds."""
        wanted = set(kinds)
        return [one for one in self.at if kind_of(one[0]) in wanted]


def effects_of(calls: Sequence[SkillCall], held: str | None = None) -> ProgramEffects:
    """Return what a program brings about."""
    found = ProgramEffects(held=(held, 0) if held else None)
    found.began = found.held
    if found.held is not None:
        found.at[found.held], found.inside[found.held] = HAND, ""
    for call in calls:
        _add(found, call)
        found.ever |= found.deeds
    return found


def _add(found: ProgramEffects, call: SkillCall) -> None:
    thing, kind = (call.objects[0], call.turn), kind_of(call.objects[-1])
    found.visited.update(kind_of(name) for name in call.objects)
    if call.skill == "PickupObject":
        found.held = thing
        found.at[thing], found.inside[thing] = HAND, ""
    elif call.skill in PUTS:
        _put(found, call, kind)
    elif call.skill == "ThrowObject":
        found.at[thing], found.inside[thing] = FLOOR, FLOOR  # wherever it flies, into no bin
        found.deeds.add(("fling", thing))
        found.held = None
    elif call.skill in CHANGES:
        found.deeds.add((DEEDS[call.skill], thing))
    elif call.skill in SWITCH_AFTER:
        _switch(found, kind, SWITCH_AFTER[call.skill])
    elif call.skill in DOOR_AFTER:
        found.doors[kind] = DEEDS[call.skill]
        if kind == FRIDGE and call.skill == "CloseObject":
            cooled = [one for one in found.at if FRIDGE in found.places(one)]
            found.deeds |= {("cool", one) for one in cooled}
            found.deeds -= {("heat", one) for one in cooled}
        if call.skill == "OpenObject":
            found.opened.add(kind)


def _put(found: ProgramEffects, call: SkillCall, kind: str) -> None:
    thing = (call.objects[0], call.turn) if call.objects[1:] else found.held
    if thing is None:
        return
    found.at[thing], found.inside[thing] = kind, call.objects[-1]
    found.passed.setdefault(thing, []).append(kind)
    found.near.discard(thing)
    if call.skill == "PutNear":
        found.near.add(thing)
    elif kind == BIN:
        found.deeds.add(("throw", thing))
    found.held = None


def _switch(found: ProgramEffects, kind: str, word: str) -> None:
    tap = kind in TAPS or kind in TAP_OF
    found.switched[TAPS[0] if tap else kind] = word
    if word == "off":
        return
    found.ran.add(TAPS[0] if tap else kind)
    for thing in found.at:
        places = found.places(thing)
        if tap and places & set(TAP_OF):
            found.deeds |= {("wash", thing), ("fill", thing)}
            found.deeds.discard(("empty", thing))
        if kind in places and kind in _BY_RUNNING:
            found.deeds |= {(deed, thing) for deed in _BY_RUNNING[kind]}
            found.deeds.discard(("cool", thing))
        elif kind == BURNER and places & set(COOKWARE):
            found.deeds |= {("heat", thing), ("cook", thing)}


def trimmed(
    calls: Sequence[SkillCall], objection: Callable[[Sequence[SkillCall]], str]
) -> tuple[SkillCall, ...]:
    """Return a program less the fewest lines without which there is no objection; () for none.

    Planners bring a pen to a lamp, shut a door that was to stay open, say the same twice. What
    is cut leaves nothing in the hand that the whole would have put down.
    """
    numbered = with_turns(calls)
    hands = (None, effects_of(numbered).held)
    for left_out in _parts(numbered):
        rest = _without(calls, left_out)
        if rest and effects_of(with_turns(rest)).held in hands and not objection(rest):
            also = _ways_to_nothing(calls, left_out)
            less = _without(calls, left_out | also)
            rest = less if less and not objection(less) else rest
            while rest[-1].skill in WAYS and rest[1:] and not objection(rest[:-1]):
                rest = rest[:-1]
            return rest
    return ()


def _without(calls: Sequence[SkillCall], left_out: frozenset[int]) -> tuple[SkillCall, ...]:
    return tuple(call for number, call in enumerate(calls) if number not in left_out)


def _ways_to_nothing(calls: Sequence[SkillCall], left_out: frozenset[int]) -> frozenset[int]:
    """Return the lines that only look for or go to a thing to which nothing is done any more."""
    used = {
        kind_of(name) for number, call in enumerate(calls) if number not in left_out
        if call.skill not in WAYS for name in call.objects
    }  # fmt: skip
    gone = {kind_of(calls[number].objects[0]) for number in left_out} - used
    return frozenset(
        number for number, call in enumerate(calls)
        if call.skill in WAYS and kind_of(call.objects[0]) in gone
    )  # fmt: skip


def _parts(calls: Sequence[SkillCall]) -> Iterator[frozenset[int]]:
    """Yield what may be left out: the end, one line, all about a thing or a turn of it, or two."""
    things: dict[tuple[str, int], set[int]] = {}
    for number, call in enumerate(calls):
        things.setdefault((kind_of(call.objects[0]), call.turn), set()).add(number)
    lines = [frozenset((number,)) for number in range(len(calls))]
    groups = [frozenset(one) for one in things.values()]
    turned = frozenset(n for n, call in enumerate(calls) if call.turn)
    pairs = [one | other for one, other in combinations(groups, 2)]
    if turned:  # the same lines said twice
        yield turned
    yield from (frozenset(range(n, len(calls))) for n in range(len(calls) - 1, 0, -1))
    yield from lines
    yield from sorted(groups, key=len)
    yield from sorted(pairs, key=len)
