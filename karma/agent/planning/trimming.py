"""A program without what nobody asked for: the part of it that is what was asked, if there is one.

Planners bring a pen along to a lamp, shut a door that was to stay open, say the same lines twice.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

from karma.agent.planning.effects import effects_of
from karma.agent.planning.program import WAYS
from karma.agent.planning.reading import kind_of
from karma.agent.planning.several import with_turns
from karma.contracts import SkillCall


def trimmed(
    calls: Sequence[SkillCall], objection: Callable[[Sequence[SkillCall]], str]
) -> tuple[SkillCall, ...]:
    """Return a program less the fewest lines without which there is no objection; () for none.

    What is cut leaves nothing in the hand that the whole would have put down.
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
