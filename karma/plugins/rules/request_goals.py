"""Goal lines of a parsed request, for use when no answer of the planner will do."""

from collections.abc import Collection, Iterator

from karma.agent.planning.goal_lines import COFFEE, GOAL_LINES, HOLD, LINE_OF_STATE, NEAR, PUT
from karma.household import uses
from karma.household.pieces import piece_type
from karma.household.uses import kind_of, switch_of
from karma.plugins.rules.deeds import able_to, deed_kind
from karma.plugins.rules.language.request_words import deed_states
from karma.plugins.rules.request_checker import Guard, meant_by
from karma.plugins.rules.types import Mention, Request, SaidDeed
from karma.types.planning import SkillCall

_MOVES = ("put", "throw")
_BY_DEED = {"put": PUT, "throw": PUT, "take": HOLD, "coffee": COFFEE}


def asked_lines(asked: Request, here: Collection[str]) -> tuple[SkillCall, ...]:
    """Return the goals of a request as its words were read, for want of a planner's answer.

    In the order of the deeds; () where one has no line. Each thing has to be one whole of a type,
    not one of several, a piece, or known by its past, its state or what lies in it.
    """
    found: list[SkillCall] = []
    if Guard(asked, here).in_pieces():
        return ()
    for number, deed in enumerate(asked.deeds):
        moved = {kind for one in asked.deeds[number + 1 :] for kind in _moved(one)}
        lines = [_asked_line(deed, one, here) for one in deed.things or (None,)]
        if not all(lines):
            return ()
        held = deed.deed == "take" and moved & {kind for one in deed.things for kind in one.types}
        found += [line for line in lines if line is not None and not held]
    return tuple(dict.fromkeys(found))


def _moved(deed: SaidDeed) -> Iterator[str]:
    """Yield the types of what a deed moves, beside taking it."""
    if deed.deed in _MOVES:
        yield from (kind for one in deed.things for kind in one.types)


def _asked_line(deed: SaidDeed, thing: Mention | None, here: Collection[str]) -> SkillCall | None:
    name = _BY_DEED.get(deed.deed) or LINE_OF_STATE.get(deed_kind(deed.deed).leaves, "")
    name = NEAR if deed.deed == "put" and deed.near else name
    takes = next((line.takes for line in GOAL_LINES if line.name == name), "")
    objects = [_asked_type(thing, here, takes or "pickupable")]
    match deed.deed:
        case "put":
            objects.append(_asked_type(deed.place, here, "" if deed.near else "receptacle"))
        case "throw":
            objects.append(uses.BIN)
        case "coffee":
            objects = [uses.COFFEE_CUP]
    return SkillCall(skill=name, objects=tuple(objects)) if name and all(objects) else None


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
