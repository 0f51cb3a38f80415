"""Resolve references to the log: what was moved, and where objects go back to or always belong.

"Put it back where it was", or "put the apple away" when apples go into the fridge, is said in plain
words and carried out so.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from karma.agent.planning.program import DEEDS, PUTS
from karma.agent.seeing.perceive import place_of
from karma.assistant.session_log import PLACE_TOLD, TOLD, PastAction, PastRequest
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.places import FLOOR, HAND
from karma.household.saying import name_of, told_place
from karma.household.types import object_types
from karma.household.uses import KNOB
from karma.plugins.rules.language.clauses import said
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.language.request_words import (
    deed_verbs,
    is_usual,
    request_words,
)
from karma.plugins.rules.types import Mention, Request, SaidDeed
from karma.types.events import SkillResult
from karma.types.observation import SeenObject

_LINKS = "in|on|into|onto|to|at|under|from|near|next|back|away|where|wherever|with|and|then"
_IT = (
    "(?P<it>it|them|that|this"
    rf"|(?:the|my|that|this)(?: (?!(?:{_LINKS})\b)\w+){{1,4}})"
)
_BACK = re.compile(
    rf"\b(?:put|place|bring|take|return|set|move) (?:back )?{_IT}(?: back(?: in)?| away)?"
    r"(?:,? (?:to )?where(?:ver)? (?:it|they|you)(?: \w+)? ?"
    r"(?:was|were|came from|found (?:it|them)|took (?:it|them) from|had (?:it|them)"
    r"|(?P<habit>belongs?|goes|go|lives?))(?: before)?)?(?=[.,;!]|$| and | then )",
    re.IGNORECASE,
)
_TAUGHT = re.compile(
    r"^\W*(?:please )?(?:remember|keep in mind|note|don't forget) that +", re.IGNORECASE
)
_AND_BACK = re.compile(r"(?:,? and|, then| then)+ back(?: again)?(?=[.!]?$)", re.IGNORECASE)
_TELL = re.compile(
    r"\b(?:tell me|let me know) (?=(?:what|where|which|who|when|how|whether|if)\b)", re.IGNORECASE
)
_USUAL = re.compile(r"\b(?:always|usually|belongs?)\b[^.;!]*[.;!]", re.IGNORECASE)
_CUTS = re.compile(r"[.;!]|,? (?:and )?then\b|,|\band\b", re.IGNORECASE)
_BELONGS = frozenset(("belongs", "belong", "goes", "go", "lives", "live"))
_JOINING = frozenset(("and", "the", "all", "my", "our"))  # words between things that go alike
_POINTING = frozenset(
    ("it", "them", "that", "this", "there", "one", "too", "both", "these", "those")
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """A thing that came from one place to another, as the log shows it."""

    object_id: str
    before: str  # id of the place it came from
    after: str | None  # of where it was seen next; None: on nothing that was seen
    at_s: float
    said: str  # the request by which the agent moved it; "" where somebody else did


def moves(past: Sequence[PastRequest]) -> list[Move]:
    """Return what was moved, by whom it may be, in the order in which it was known."""
    found: list[Move] = []
    places: dict[str, str | None] = {}
    for errand in past:
        for change in errand.changes:
            taken = dict(change.taken)
            for sight in change.seen:
                name, after = sight.object_id, place_of(sight)
                known, took = places.get(name), taken.get(name)
                steps = [(known, took, ""), (took, after, errand.plain or errand.said)]
                for before, then, own in steps if took else [(known, after, "")]:
                    if can_move(sight) and before and before != then:
                        found.append(
                            Move(object_id=name, before=before, after=then, at_s=errand.at_s,
                                 said=own)
                        )  # fmt: skip
                places[name] = after
    return found


def deeds_of(
    asked: Request | None, results: Sequence[SkillResult], *, done: bool
) -> Iterator[PastAction]:
    """Yield what an errand asked for and what its skills did, to be asked about later."""
    for deed in asked.deeds if asked is not None else ():
        things = tuple(kind for one in deed.things for kind in one.types)
        places = deed.place.types if deed.place is not None else ()
        yield PastAction(deed=deed.deed or deed.verb, things=things, places=places, done=done)
    for result in (one for one in results if one.ok):
        kinds = tuple(base_type(type_of(one)) for one in result.object_ids)
        said = deed_verbs().get(DEEDS.get(result.call.skill, ""), "")
        places = kinds[-1:] if result.call.skill in PUTS else ()
        if said and kinds:
            yield PastAction(deed=said, things=kinds[:1], places=places, done=True)


def deeds_in(errand: PastRequest, reader: RequestReader) -> tuple[PastAction, ...]:
    """Return what an errand asked for and did; of a log that did not keep it, by its words."""
    if errand.deeds or errand.status in TOLD:
        return errand.deeds
    read, done = reader.read(errand.said), errand.status == "done"
    return tuple(deed for one in read for deed in deeds_of(one, (), done=done))


def in_plain(asked: Request | None) -> str:
    """Return a request in plain words where its own only point at what it is about."""
    if asked is None or not asked.deeds:
        return ""
    words = {word.strip(".,!?").lower() for word in asked.text.split()}
    bare = not any(thing.start >= 0 for deed in asked.deeds for thing in deed.things)
    return " and ".join(map(said, asked.deeds)) if bare or words & _POINTING else ""


def found_elsewhere(past: Sequence[PastRequest]) -> tuple[str, ...]:
    """Return what is said of things that the last errand took from elsewhere than was known."""
    taken = {name for change in past[-1].changes for name, _ in change.taken}
    return tuple(
        f"the {name_of(one.object_id)} was {told_place(type_of(one.after))}, not "
        f"{told_place(type_of(one.before))}: somebody had moved it"
        for one in moves(past)
        if one.at_s == past[-1].at_s and one.object_id in taken and not one.said and one.after
        and type_of(one.after) != type_of(one.before)
    )  # fmt: skip


def can_move(sight: SeenObject) -> bool:
    """Return whether an object can be carried."""
    return sight.pickupable or object_types()[base_type(sight.object_type)].can("pickupable")


def habits(past: Sequence[PastRequest], reader: RequestReader) -> dict[str, str]:
    """Return where things of a type always go, as it was told last: type -> type of the place."""
    found: dict[str, str] = {}
    for errand in past:
        is_said = errand.status == PLACE_TOLD or _BELONGS & {*errand.said.lower().split()}
        for thing, place in habits_in(errand.said, reader) if is_said else ():
            found.update(dict.fromkeys(thing.types, place.types[0]))
    return found


def habits_in(text: str, reader: RequestReader) -> list[tuple[Mention, Mention]]:
    """Return what goes where by "apples and eggs always go in the fridge, forks in a drawer".

    So of "remember that the apples belong in the fridge", which without its first words is asked.
    """
    text = _TAUGHT.sub("", text)
    words = {word.strip(".,!") for word in text.lower().split()}
    lists = request_words()
    usual = is_usual(text.lower().split()) or words & _BELONGS
    requests = reader.read(text)
    no = words & lists.negations or any(word.endswith("n't") for word in words)
    if not usual or no or len(requests) != 1:
        return []
    request = requests[0]
    belongs = [one for one in request.deeds if one.verb in _BELONGS]  # not of "go and put it"
    named = list(request.alone)
    if belongs and belongs == list(request.deeds):
        named = [one for deed in belongs for one in (*deed.things, deed.place) if one is not None]
    elif request.form not in ("statement", "teaching"):
        return []
    found: list[tuple[Mention, Mention]] = []
    waiting: list[Mention] = []  # for the place that comes behind them
    for one in (one for one in named if one.types):
        between = (request.whole or request.text)[waiting[-1].end : one.start] if waiting else ""
        is_next = not {*between.replace(",", " and ").lower().split()} - _JOINING
        if waiting and not is_next and all(can_lie_in(thing, one) for thing in waiting):
            found += [(thing, one) for thing in waiting]
            waiting = []
        else:
            waiting.append(one)
    return [] if waiting else found


def is_taught(text: str) -> bool:
    """Return whether a text begins so as to be kept: "remember that ..."."""
    return bool(_TAUGHT.match(text))


def can_lie_in(thing: Mention, place: Mention) -> bool:
    """Return whether what is named first can be carried, and what is named second can hold."""
    kinds = object_types()
    return any(kinds[one].can("pickupable") for one in thing.types) and any(
        kinds[one].can("receptacle") for one in place.types
    )


# ----------------------------------------------------------------- a request that speaks of it


@dataclass(frozen=True, slots=True)
class PlainRequest:
    """A request without what it says of the log, and which things it means: type -> id."""

    text: str
    means: Mapping[str, str]
    unknown: tuple[str, ...] = ()  # words of it to which nothing in the log answers


def in_turn(text: str) -> list[str]:
    """Return a text cut ahead of what speaks of the log, and behind what always goes somewhere.

    What is before a cut is done, or kept, first.

    >>> in_turn("wash the mug, then put it back where it was")
    ['wash the mug', 'put it back where it was']
    """
    text = _AND_BACK.sub(", then put it back where it was", text)  # "to the bath, then back again"
    speaks = [one.start() for one in _BACK.finditer(text) if _goes_back(one)]
    speaks += [one.start() for one in _TELL.finditer(text)]
    cuts = [0]
    for at in sorted(speaks):
        ahead = [one for one in _CUTS.finditer(text, 0, at) if one.start() > 0]
        if ahead and ahead[-1].end() > cuts[-1]:
            cuts.append(ahead[-1].end())
    cuts = sorted({*cuts, *(one.end() for one in _USUAL.finditer(text) if text[one.end() :])})
    parts = [text[a:b] for a, b in zip(cuts, [*cuts[1:], len(text)], strict=True)]
    parts = [re.sub(rf"(?:{_CUTS.pattern})\s*$", "", part.strip(), flags=re.IGNORECASE).strip()
             if n < len(parts) - 1 else part.strip() for n, part in enumerate(parts)]  # fmt: skip
    return [part for part in parts if part] or [text]


def only_needs(text: str, reader: RequestReader) -> bool:
    """Return whether a text says no more than that something is needed: "I still need it"."""
    deeds = [deed for request in reader.read(text) for deed in request.deeds]
    return bool(deeds) and all(
        deed.verb in request_words().needs and all(thing.vague for thing in deed.things)
        for deed in deeds
    )


def _goes_back(found: re.Match[str]) -> bool:
    return re.search(r"\b(?:back|return|where)", found[0], re.IGNORECASE) is not None


def in_plain_words(text: str, past: Sequence[PastRequest], reader: RequestReader) -> PlainRequest:
    """Return a request with what refers to the log said plainly; unchanged if that is unknown."""
    if not _BACK.search(text):
        return PlainRequest(text, {})
    references = _LogReferences(past, reader)
    text = _BACK.sub(references.back, text)
    return PlainRequest(text, references.means, tuple(references.unknown))


def with_habits(request: Request, usual: Mapping[str, str]) -> Request:
    """Return a request that puts things away where they always go: "tidy the bread away".

    `usual` has the type of the place by the type of the thing.
    """

    def of(deed: SaidDeed) -> SaidDeed:
        kinds = [kind for thing in deed.things for kind in thing.types]
        place = next((usual[kind] for kind in kinds if kind in usual), "")
        if deed.deed != "put" or deed.place is not None or not place:
            return deed
        there = Mention(text=name_of(place), start=-1, end=-1, types=(place,))
        return replace(deed, place=there)

    deeds = tuple(map(of, request.deeds))
    if deeds == request.deeds:
        return request
    whole = request.lacking != "where" or all(d.place for d in deeds if d.deed == "put")
    if not whole:
        return replace(request, deeds=deeds)
    errand = " and ".join(said(deed, request.whole) for deed in deeds)
    return replace(request, deeds=deeds, form="errand", lacking="", errand=errand)


class _LogReferences:
    """Says plainly what refers to the log, and keeps what that means."""

    def __init__(self, past: Sequence[PastRequest], reader: RequestReader) -> None:
        self._moves = [one for one in moves(past) if one.said]
        self._taken = [
            (name, place) for one in past for change in one.changes for name, place in change.taken
        ]
        self._usual, self._reader = habits(past, reader), reader
        self.means: dict[str, str] = {}
        self.unknown: list[str] = []

    def _mean(self, name: str) -> None:
        """Note that a thing or place is meant; there is but one floor, and no knob is named."""
        if type_of(name) not in (FLOOR, KNOB):
            self.means[base_type(type_of(name))] = name

    def back(self, found: re.Match[str]) -> str:
        """Return "put the apple on the table" for "put it back", where the log knows both."""
        words = found["it"]
        kinds = _kinds_of(words, self._reader)
        moved = [(one.object_id, one.before) for one in self._moves]
        about = [one for one in self._taken if base_type(type_of(one[0])) in kinds]
        last = next(reversed(about if kinds else moved), None)
        kind = next(iter(kinds), None) or (base_type(type_of(last[0])) if last else "")
        name = words if kinds or last is None else f"the {name_of(last[0])}"
        if found["habit"]:
            place = self._usual.get(kind)
            return found[0] if place is None else f"put {name} {told_place(place)}"
        if _goes_back(found) and last is None and (kinds or self._moves):
            self.unknown.append(found[0])  # the log has no place to which it would go back
        if not _goes_back(found) or last is None or type_of(last[1]) == HAND:
            return found[0]
        self.means[kind] = last[0]
        self._mean(last[1])
        return f"put {name} {told_place(last[1])}"


def _kinds_of(words: str, reader: RequestReader) -> tuple[str, ...]:
    """Return the types that a thing's words mean; () of a pronoun."""
    if " " not in words:
        return ()
    found = reader.read(f"find {words}")
    return next((thing.types for one in found for thing in one.mentions if thing.types), ())


def looked_into(past: Sequence[PastRequest]) -> set[str]:
    """Return the ids of what was opened: it was looked into."""
    return {
        str(arguments["objectId"]) for errand in past for action, arguments in errand.actions
        if action == "OpenObject" and "objectId" in arguments
    }  # fmt: skip
