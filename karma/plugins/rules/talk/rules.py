"""What a person forbids for good: "never open the safe" holds until it is taken back."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from karma.household.containment import has_door
from karma.household.saying import name_of
from karma.plugins.homes.home import RULE, RULE_ENDED, PastErrand
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.talk.remembering import MemoryAnswer, answer
from karma.plugins.rules.types import Mention, Request, SaidDeed

_FOR_GOOD = re.compile(
    r"\b(?:never(?! (?:mind|have|had)\b)|ever|any ?more|from now on|in (?:the )?future"
    r"|at any time|no matter what|under any circumstances)\b",
    re.IGNORECASE,
)
_STATES = frozenset(("dirty", "hot", "cold", "empty", "full", "broken", "sliced", "cooked", "warm"))
_TAKEN_BACK = re.compile(
    r"\b(?:forget|drop|cancel|lift|scrap|ignore)\b.*"
    r"\b(?:rules?|orders?|bans?|what i (?:said|told))\b"
    r"|\b(?:you (?:may|can|are allowed to)|(?:it's|it is) (?:ok|okay|fine|all right) to)\b"
    r".*\b(?:again|now)\b",
    re.IGNORECASE,
)


def is_rule(request: Request) -> bool:
    """Return whether a sentence only forbids something, and for good."""
    only = bool(request.forbidden or request.exclusions) and not (request.deeds or request.unread)
    if not only or _FOR_GOOD.search(request.text) is None:
        return False
    if any(one.verb.startswith("leave") for one in request.forbidden):
        return False
    # of "dirty things", "the red mug" nobody could say whether a request is about them
    named = [one for one in _things_in(request) if one.types]
    told = not named or any(one.states or one.at or one.marks for one in named)
    return not (told or _STATES & {*re.findall(r"[a-z]+", request.text.lower())})


def rules(past: Sequence[PastErrand], reader: RequestReader) -> list[Request]:
    """Return what is forbidden by now, in the order in which it was said."""
    kept: list[Request] = []
    for errand in past:
        if errand.status == RULE:
            kept += [one for one in reader.read(errand.said) if is_rule(one)]
        elif errand.status == RULE_ENDED:
            kept = _without(kept, errand.said, reader)
    return kept


def is_taken_back(text: str, known: Sequence[Request], reader: RequestReader) -> bool:
    """Return whether a text takes back one of the rules: "forget that rule"."""
    if not (known and _TAKEN_BACK.search(text)):
        return False
    return len(_without(known, text, reader)) < len(known)


def _without(kept: Sequence[Request], text: str, reader: RequestReader) -> list[Request]:
    """Return rules without those that a text names things of; of no things, without the last."""
    named = {kind for one in reader.read(text) for kind in _kinds(_things_in(one))}
    if re.search(r"\b(?:all|every)\b.*\brules?\b", text, re.IGNORECASE):
        return []
    if not named:
        return [*kept[:-1]]
    return [one for one in kept if not named & _kinds(_things_in(one))]


def _things_in(request: Request) -> Iterator[Mention]:
    """Yield all things that a sentence names, those that it forbids too."""
    yield from (*request.alone, *request.mentions, *request.exclusions)
    for deed in request.forbidden:
        yield from deed.things
        if deed.place is not None:
            yield deed.place


def kept_to(request: Request) -> MemoryAnswer:
    """Return what is said to a rule, and of what else it holds where words tell things apart."""
    lines = [f"I will keep to it: {request.text.rstrip('.!')}."]
    for one in _things_in(request):
        kinds = [name_of(kind) for kind in one.types]
        if kinds and one.text.rstrip("s").endswith(f" {kinds[0]}"):
            lines.append(f"I cannot tell the {one.text} from others: it holds for each {kinds[0]}.")
    return answer(*lines)


def with_rules(request: Request, known: Sequence[Request]) -> Request:
    """Return a request that forbids what rules do, too."""
    forbidden = (deed for rule in known for deed in rule.forbidden)
    left_alone = (replace(one, start=-1, end=-1) for rule in known for one in rule.exclusions)
    return replace(
        request,
        forbidden=(*request.forbidden, *forbidden),
        exclusions=(*request.exclusions, *left_alone),
    )


def against(request: Request, known: Sequence[Request]) -> MemoryAnswer | None:
    """Return that a request asks for what a rule forbids; None where it asks for no such thing."""
    asked = _kinds(request.mentions)
    for rule in known:
        named = asked & _kinds(rule.exclusions)
        if named or any(_is_that(deed, no) for deed in request.deeds for no in rule.forbidden):
            told = f"You told me: {rule.text.rstrip('.!')}. So I do nothing."
            back = 'Say "forget that rule" if it is to hold no more.'
            return MemoryAnswer(lines=(told, back), refuses=True)
    return None


def _is_that(deed: SaidDeed, forbidden: SaidDeed) -> bool:
    """Return whether a deed is a forbidden one, or goes through a door that is to be kept shut."""
    kinds, place = _kinds(forbidden.things), deed.place
    if forbidden.deed == "open" and place is not None and not deed.near:
        return any(has_door(kind) and (kind in kinds or not kinds) for kind in place.types)
    there = forbidden.place is None or (
        place is not None and bool({*place.types} & {*forbidden.place.types})
    )
    about = not kinds or bool(kinds & _kinds(deed.things))
    return deed.deed == forbidden.deed and about and there


def _kinds(things: Iterable[Mention]) -> set[str]:
    return {kind for one in things for kind in one.types}
