"""Number the objects of one name that a program handles one after another."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from karma.household.ids import short_type
from karma.types.planning import SkillCall


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
