"""Drop the calls of a program that the request checker objects to."""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

from karma.agent.planning.program import WAYS
from karma.agent.planning.turns import with_turns
from karma.household.skill_effects import BeliefState, outcome
from karma.household.uses import kind_of
from karma.types.planning import SkillCall


def trimmed(
    calls: Sequence[SkillCall], objection: Callable[[Sequence[SkillCall]], str]
) -> tuple[SkillCall, ...]:
    """Return a program less the fewest lines without which there is no objection; () for none.

    Planners bring a pen to a lamp, shut a door that was to stay open, say the same twice. What
    is cut leaves nothing in the hand that the whole would have put down.
    """
    numbered = with_turns(calls)
    hands = (None, outcome(numbered, BeliefState()).held)
    for left_out in _parts(numbered):
        rest = _without(calls, left_out)
        if rest and outcome(with_turns(rest), BeliefState()).held in hands and not objection(rest):
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
