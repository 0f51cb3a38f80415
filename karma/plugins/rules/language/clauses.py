"""A request as the single errands that a planner is told one by one, in words that it knows."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from karma.household.saying import preposition, spoken
from karma.household.states import SAID_AS
from karma.plugins.rules.deeds import deed_kind
from karma.plugins.rules.types import Mention, Request, SaidDeed

_LINKS = frozenset(
    ("in", "on", "into", "onto", "to", "at", "under", "near", "beside", "next", "from")
)
_LOOSE = frozenset(("it", "that", "this", "them", "one"))
_OPEN = frozenset(("the", "a", "an", "my", "your", "our"))
_FIRST = ("take", "find", "go")  # are part of what is done next with the thing


def clauses_of(request: Request) -> tuple[tuple[str, Request], ...]:
    """Return the errands of a request in their order, each with what it asks.

    One deed to one thing keeps the words that were said. Of several each is said in few words, with
    the names that were said; what was only taken to be put elsewhere is one with that.
    """
    single = tuple(_singles(request.deeds))
    if len(single) < 2:
        return ((request.errand or request.text, replace(request, deeds=single)),)
    verbs = {deed.verb for deed in single if not deed.deed}
    others = tuple(word for word in request.unread if word not in verbs)
    found = []
    for deed in single:
        unread = others if deed.deed else (*others, deed.verb)
        part = replace(request, deeds=(deed,), rest=single, unread=unread)
        found.append((said(deed, request.whole), part))
    return tuple(found)


def context_left_out(requests: Sequence[Request]) -> tuple[Request, ...]:
    """Return the sentences without those that only tell something, where others ask for something.

    A thing that is named alone goes with the errand that then speaks of it: "Fridge! Shut it!"
    """
    if not any(one.form == "errand" for one in requests):
        return tuple(requests)
    requests = _constraints_kept(requests)
    about = {kind for one in requests for thing in one.mentions for kind in thing.types}

    def named_before(one: Request) -> bool:
        spoken_of = all(about & set(thing.types) for thing in one.alone)
        return one.form == "incomplete" and bool(one.alone) and spoken_of

    kept = (one for one in requests if one.form not in ("statement", "talk"))
    return tuple(one for one in kept if not named_before(one))


def _constraints_kept(requests: Sequence[Request]) -> tuple[Request, ...]:
    """Return requests without those that only rule something out, which then holds for all."""
    only = [
        one for one in requests
        if (one.forbidden or one.exclusions) and not (one.deeds or one.unread)
    ]  # fmt: skip
    rest = [one for one in requests if one not in only]
    if not only or not any(one.deeds for one in rest):
        return tuple(requests)
    forbidden = tuple(deed for one in only for deed in one.forbidden)
    left_out = tuple(thing for one in only for thing in one.exclusions)
    return tuple(
        replace(one, forbidden=forbidden + one.forbidden, exclusions=left_out + one.exclusions)
        if one.form == "errand" else one
        for one in rest
    )  # fmt: skip


def _singles(deeds: Sequence[SaidDeed]) -> Iterator[SaidDeed]:
    """Yield deeds of one thing each, without those that the next one holds already."""
    flat = [replace(deed, things=(one,)) for deed in deeds for one in deed.things]
    flat += [deed for deed in deeds if not deed.things]
    flat.sort(key=lambda deed: deed.start)
    for number, deed in enumerate(flat):
        later = flat[number + 1 :]
        kinds = [one.types for one in deed.things[:1]]
        same = kinds and any(kinds == [two.types for two in one.things[:1]] for one in later)
        if not (deed.deed in _FIRST and (same or (deed.deed == "go" and later))):
            yield deed


def said(deed: SaidDeed, whole: str = "", *, plain: bool = False) -> str:
    """Return a deed in few words.

    Args:
        deed: of one thing.
        whole: the text that it was said in; its own words for things are kept.
        plain: things by their types' names.

    >>> thing = Mention(text="spud", start=0, end=4, types=("Potato",))
    >>> place = Mention(text="icebox", start=0, end=4, types=("Fridge",))
    >>> deed = SaidDeed(verb="stow", deed="put", start=0, things=(thing,), place=place)
    >>> said(deed), said(deed, plain=True)
    ('put the spud in the icebox', 'put the potato in the fridge')
    """
    thing = _called(deed.things[0], whole, plain=plain) if deed.things else ""
    if deed.deed == "coffee":
        return "make a mug of coffee"
    if deed.deed == "put":
        if deed.place is None:
            return f"put away {thing}"
        place = _called(deed.place, whole, plain=plain)
        usual = preposition(deed.place.types[0]) if deed.place.types else "on"
        return f"put {thing} {'near' if deed.near else usual} {place}"
    if deed.deed == "fill":
        return f"fill {thing} with water"
    verb = deed_kind(deed.deed).said or deed.verb
    under = " under the lamp" if deed.deed == "look" else ""
    return f"{verb} {thing}{under}".rstrip()


def _called(one: Mention, whole: str, *, plain: bool) -> str:
    """Return a thing with its article, as it was said where that is one thing."""
    if one.types and (plain or one.every or one.number is not None):
        return f"the {spoken(one.types[0]).lower()}"
    as_said = whole[one.start : one.end] if 0 <= one.start < one.end <= len(whole) else ""
    if one.states and not plain:
        return f"{as_said or one.text} that is {SAID_AS.get(one.states[0], one.states[0])}"
    if one.other or as_said.lower().endswith((" one", " ones", " other")):
        return f"the {one.text}"  # of what "the other one" stands for
    return as_said or f"the {one.text}"


def plainly(request: Request) -> str:
    """Return a request of one deed to one thing in plain words; "" for any other."""
    single = list(_singles(request.deeds))
    known = len(single) == 1 and all(one.types for one in single[0].things)
    return said(single[0], plain=True) if known and single[0].deed else ""


def completed(asked: str, answer: str, about: str = "") -> str:
    """Return a request that was asked back about with what was answered put in.

    Args:
        asked: the request.
        answer: a thing, a place, or which one is meant.
        about: the words of the request that may mean several things.

    >>> completed("put the mug on the", "table"), completed("put the bowl", "in the sink")
    ('put the mug on the table', 'put the bowl in the sink')
    >>> completed("move it to the desk", "the lamp"), completed("put the book there", "the shelf")
    ('move the lamp to the desk', 'put the book on the shelf')
    >>> completed("slice", "the apple"), completed("put the bowl", "the table")
    ('slice the apple', 'put the bowl on the table')
    >>> completed("throw the egg away", "the one in the fridge", "egg")
    'throw the egg in the fridge away'
    """
    asked, answer = asked.rstrip(" .,!?"), answer.strip(" .,!?")
    which = re.match(
        rf"(?:the (?:one|{re.escape(about)}) )?((?:in|on|at|from|near|under) .+)", answer
    )
    if about and which and about in asked:
        return asked.replace(about, f"{about} {which[1]}", 1)
    words, first = asked.split(), answer.split()[0].lower() if answer.split() else ""
    last = words[-1].lower() if words else ""
    for small in (_OPEN, _LINKS):
        if last in small:
            return f"{asked} {answer.split(maxsplit=1)[-1] if first in small else answer}"
    loose = next((n for n, word in enumerate(words) if word.lower() in _LOOSE), None)
    if last in ("there", "here") and loose is None:
        words, last = words[:-1], ""
        return " ".join([*words, *([] if first in _LINKS else ["on"]), answer])
    if loose is not None and first not in _LINKS:
        skipped = 1 + (words[loose + 1 : loose + 2] == ["thing"])
        return " ".join([*words[:loose], answer, *words[loose + skipped :]])
    named = any(word.lower() in _OPEN for word in words)
    return " ".join([asked, *(["on"] if named and first not in _LINKS else []), answer])
