"""What the log of a home says of things: who moved them, what is theirs, where they go back to.

A request may speak of it: "put it back where it was", "the first thing you put away", "put the
apple away" where apples go into the fridge. It is then said in plain words, and carried out so.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from karma.agent.perceive import place_of
from karma.contracts import SeenObject
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.places import FLOOR, HAND
from karma.household.saying import name_of, told_place
from karma.household.types import object_types
from karma.language.request import RequestReader
from karma.language.request_words import request_words
from karma.talk.home import PastErrand

_LINKS = "in|on|into|onto|to|at|under|from|near|next|back|away|where|wherever|with|and|then"
_IT = rf"(?P<it>it|them|that|this|(?:the|my|that|this)(?: (?!(?:{_LINKS})\b)\w+){{1,4}})"
_BACK = re.compile(
    rf"\b(?:put|place|bring|take|return|set|move) (?:back )?{_IT}(?: back| away)?"
    r"(?:,? (?:to )?where(?:ver)? (?:it|they|you)(?: \w+)? ?"
    r"(?:was|were|came from|found (?:it|them)|took (?:it|them) from|had (?:it|them)"
    r"|(?P<habit>belongs?|goes|go|lives?))(?: before)?)?(?=[.,;!]|$| and | then )",
    re.IGNORECASE,
)
_ORDINAL = re.compile(
    r"\bthe (?P<which>first|last) (?:thing|one) (?:that )?you (?:have )?"
    r"(?:put (?:away|down)|moved|picked up|took|taken|handled|carried|stored)\b",
    re.IGNORECASE,
)
_MINE = re.compile(r"^\W*(?:my|mine)\b.*\bone\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """A thing that came from one place to another, as the log shows it."""

    object_id: str
    before: str  # id of the place it came from
    after: str | None  # of where it was seen next; None: on nothing that was seen
    at_s: float
    said: str  # the request by which the agent moved it; "" where somebody else did
    told: bool = False  # a person said so


def moves(past: Sequence[PastErrand]) -> list[Move]:
    """Return what was moved, by whom it may be, in the order in which it was known."""
    found: list[Move] = []
    places: dict[str, str | None] = {}
    for errand in past:
        for change in errand.changes:
            taken = dict(change.taken)
            for sight in change.seen:
                name, after = sight.object_id, place_of(sight)
                before = taken.get(name) or places.get(name)
                if _can_move(sight) and before and before != after:
                    said = errand.said if name in taken else ""
                    found.append(
                        Move(object_id=name, before=before, after=after, at_s=errand.at_s,
                             said=said, told=errand.status == "told")
                    )  # fmt: skip
                places[name] = after
    return found


def _can_move(sight: SeenObject) -> bool:
    return sight.pickupable or object_types()[base_type(sight.object_type)].can("pickupable")


def habits(past: Sequence[PastErrand], reader: RequestReader) -> dict[str, str]:
    """Return where things of a type always go, as it was told last: type -> type of the place."""
    found: dict[str, str] = {}
    for errand in past:
        if errand.status == "told" and (habit := habit_in(errand.said, reader)) is not None:
            found.update(dict.fromkeys(habit[0], habit[1]))
    return found


def habit_in(text: str, reader: RequestReader) -> tuple[tuple[str, ...], str] | None:
    """Return the types and the place of "the apples always go in the fridge"; None of no habit."""
    words = {word.strip(".,!") for word in text.lower().split()}
    lists = request_words()
    if not words & (lists.habits - lists.negations) or words & lists.negations:
        return None
    requests = reader.read(text)
    named = [one for one in (requests[0].alone if requests else ()) if one.types]
    if len(requests) != 1 or requests[0].form not in ("statement", "teaching") or len(named) != 2:
        return None
    kinds, (thing, place) = object_types(), named
    carried = any(kinds[one].can("pickupable") for one in thing.types)
    return (thing.types, place.types[0]) if carried and _holds(place.types[0]) else None


def _holds(kind: str) -> bool:
    return object_types()[kind].can("receptacle")


def owned(past: Sequence[PastErrand]) -> dict[str, str]:
    """Return what is whose: type -> id of the thing that "my mug is the one ..." was said of."""
    found: dict[str, str] = {}
    for errand in past:
        if errand.status == "told" and is_owning(errand.said):
            for sight in (one for change in errand.changes for one in change.seen):
                found[base_type(sight.object_type)] = sight.object_id
    return found


def is_owning(text: str) -> bool:
    """Return whether a statement says which thing is the person's own.

    >>> is_owning("my mug is the one in the cabinet"), is_owning("my mug is in the cabinet")
    (True, False)
    """
    return bool(_MINE.match(text))


# ----------------------------------------------------------------- a request that speaks of it


@dataclass(frozen=True, slots=True)
class PlainRequest:
    """A request without what it says of the log, and which things it means: type -> id."""

    text: str
    means: Mapping[str, str]


def in_plain_words(text: str, past: Sequence[PastErrand], reader: RequestReader) -> PlainRequest:
    """Return a request with what it says of the log said plainly; as it is where that is unknown.

    Args:
        text: the request.
        past: the home's log.
        reader: of English.
    """
    speaking = _SpeakingOfThePast(past, reader)
    text = _ORDINAL.sub(speaking.ordinal, text)
    return PlainRequest(_BACK.sub(speaking.back, text), speaking.means)


class _SpeakingOfThePast:
    """Says plainly what is said of the log, and keeps what that means."""

    def __init__(self, past: Sequence[PastErrand], reader: RequestReader) -> None:
        self._moves = [one for one in moves(past) if one.said]
        self._usual, self._reader = habits(past, reader), reader
        self.means: dict[str, str] = {}

    def ordinal(self, found: re.Match[str]) -> str:
        """Return "the apple" for the first thing that was put away."""
        put = [one for one in self._moves if one.after not in (None, HAND, FLOOR)]
        if not put:
            return found[0]
        name = put[0 if found["which"].lower() == "first" else -1].object_id
        self.means[base_type(type_of(name))] = name
        return f"the {name_of(name)}"

    def back(self, found: re.Match[str]) -> str:
        """Return "put the apple on the table" for "put it back", where the log knows both."""
        said = found["it"]
        kinds = _kinds_of(said, self._reader)
        about = [
            one for one in self._moves
            if not kinds or base_type(type_of(one.object_id)) in kinds
        ]  # fmt: skip
        last = about[-1] if about else None
        kind = next(iter(kinds), None) or (base_type(type_of(last.object_id)) if last else "")
        name = said if kinds or last is None else f"the {name_of(last.object_id)}"
        away = re.search(r"\baway\b", found[0], re.IGNORECASE)
        if (found["habit"] or away) and kind in self._usual:
            return f"put {name} {told_place(self._usual[kind])}"
        back = re.search(r"\b(?:back|return|where)", found[0], re.IGNORECASE)
        if away or not back or last is None or type_of(last.before) in (HAND, FLOOR):
            return found[0]
        self.means |= {kind: last.object_id, base_type(type_of(last.before)): last.before}
        return f"put {name} {told_place(last.before)}"


def _kinds_of(said: str, reader: RequestReader) -> tuple[str, ...]:
    """Return the types that a thing's words mean; () of a pronoun."""
    if " " not in said:
        return ()
    found = reader.read(f"find {said}")
    return next((thing.types for one in found for thing in one.mentions if thing.types), ())


def looked_into(past: Sequence[PastErrand]) -> set[str]:
    """Return the ids of what was opened: it was looked into."""
    return set(_opened(past))


def _opened(past: Sequence[PastErrand]) -> Iterator[str]:
    for errand in past:
        for action, arguments in errand.actions:
            if action == "OpenObject":
                yield str(arguments.get("objectId", ""))
