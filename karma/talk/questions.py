"""Questions answered from memory: where, whether, how many, when, what lies there, what was done.

What was seen is told with its age; what was not seen is not guessed, and the answer offers to look.
Nothing is done for a question.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from karma.agent.perceive import place_of
from karma.contracts import MemoryUnit, Mention, Request, SeenObject
from karma.household.containment import has_door
from karma.household.deeds import DEED_KINDS
from karma.household.ids import root_id, type_of
from karma.household.pieces import base_type, is_piece
from karma.household.places import HAND, NEAR_M
from karma.household.saying import name_of, told_place
from karma.household.states import NEEDS
from karma.household.types import ObjectType, object_types
from karma.household.uses import BASIN_OF, BASINS, BELOW_SINKS, without_basin
from karma.journal.formats import plural
from karma.language.request import RequestReader
from karma.language.request_words import base_of_deed, request_words
from karma.methods.guarded import is_so
from karma.talk.asking import ASKING, AskedQuestion
from karma.talk.history import (
    Move,
    deeds_in,
    deeds_of,
    habit_in,
    habits,
    how_sure,
    looked_into,
    moves,
    owned,
)
from karma.talk.home import (
    PLACE_TOLD,
    STATE_TOLD,
    TOLD,
    PastDeed,
    PastErrand,
)

_MOVING = ("moved", "took", "put", "placed", "brought", "left", "carried")
_POURED = ("water", "coffee", "wine", "liquid")
_MOST = 6  # things or errands in one answer
_OLD_S = 3600.0  # what was seen so long ago may have been moved
_OFFER = 'Say "go and see", or /look, and I look for it.'
_OF_ANOTHER = re.compile(
    r"^\W*(?:and |or )?(?:what about|how about|and|or)\b(?P<rest>.*)\?\W*$", re.IGNORECASE
)


@dataclass(frozen=True, slots=True, kw_only=True)
class MemoryAnswer:
    """What is said to a question."""

    lines: tuple[str, ...]
    known: bool = True
    look: str = ""  # the errand that would find it out
    refuses: bool = False  # it was an errand, and is not carried out


@dataclass(frozen=True, slots=True, kw_only=True)
class Remembering:
    """What questions are answered from."""

    sights: Mapping[str, tuple[SeenObject, float]]  # id -> the latest sight, when it was in view
    units: Mapping[str, MemoryUnit]  # short-term memory
    furniture: Sequence[str]  # types on the map
    past: Sequence[PastErrand]
    now_s: float
    people: int = 0  # who live here too
    is_here: bool = True  # the agent can go and see

    @property
    def room(self) -> str:
        """What the room is called by who asks."""
        return "this room" if self.is_here else "that room"

    def of(self, thing: Mention) -> list[tuple[SeenObject, float]]:
        """Return the sights of what a mention may mean, the last seen first."""
        kinds = {*thing.types, *map(without_basin, thing.types)}
        found = [
            one for one in self.all() if kinds & {one[0].object_type, base_type(one[0].object_type)}
        ]
        found.sort(key=lambda one: (-one[1], one[0].object_id))
        return list({_heap(sight): (sight, when) for sight, when in reversed(found)}.values())[::-1]

    def all(self) -> Iterator[tuple[SeenObject, float]]:
        """Yield each thing that was seen, in the states that are known, with when it was seen."""
        for sight, when in self.sights.values():
            yield replace(sight, states=self._states(sight)), when

    def _states(self, sight: SeenObject) -> tuple[str, ...]:
        unit = self.units.get(sight.object_id)
        return tuple(dict.fromkeys((*sight.states, *(unit.states if unit else ()))))

    def ago(self, when_s: float) -> str:
        """Return how long ago something was."""
        return age(self.now_s - when_s)

    def is_old(self, when_s: float) -> bool:
        """Return whether what was seen then may be otherwise by now."""
        return self.now_s - when_s > _OLD_S

    def seen(self, sight: SeenObject, when_s: float, about: str = PLACE_TOLD) -> str:
        """Return when a thing was seen or told of, and whether that may not be so any more."""
        told_s = self._told_s(sight.object_id, about)
        how = f"you told me {self.ago(told_s)}" if told_s >= when_s else f"seen {self.ago(when_s)}"
        if not self.is_old(max(told_s, when_s)):
            return how
        if self.people and sight.pickupable:
            sure = how_sure(self.past, sight, max(told_s, when_s), self.now_s)
            return f"{how}; people live here: {sure:.1f} is the chance that it is still there"
        return f"{how}; that may have changed since"

    def told(self) -> set[str]:
        """Return the ids of which a person told where or how they are after they were seen."""
        return {
            name for name, (_, when_s) in self.sights.items()
            if max(self._told_s(name, about) for about in TOLD) >= when_s
        }  # fmt: skip

    def _told_s(self, object_id: str, about: str) -> float:
        """Return when a person last told that of a thing; before all time if nobody did."""
        told = (
            one.at_s
            for one in self.past
            if one.status == about
            and any(object_id == s.object_id for change in one.changes for s in change.seen)
        )
        return max(told, default=-1.0)


def _heap(sight: SeenObject) -> tuple[str, str | None]:
    """Return what stands for a thing: the pieces of one whole at one place are one."""
    name, piece = sight.object_id, is_piece(sight.object_type)
    return (root_id(name) if piece else name), (place_of(sight) if piece else None)


def age(seconds: float) -> str:
    """Return a time that has passed, in words.

    >>> age(5), age(200), age(7300), age(200_000)
    ('just now', '3 minutes ago', '2 hours ago', '2 days ago')
    """
    for size, unit in ((86_400, "day"), (3600, "hour"), (60, "minute")):
        if (count := int(seconds // size)) > 0:
            return f"{count} {unit}{'s' * (count > 1)} ago"
    return "just now"


def answered(
    request: Request, knows: Remembering, reader: RequestReader | None
) -> MemoryAnswer | None:
    """Return the answer to a question, None where it is not understood.

    Args:
        request: whose form is "question".
        knows: what is remembered.
        reader: reads what was asked for earlier.
    """
    asked = _Question(request, knows, reader)
    found = next((found for kind in _KINDS if (found := kind(asked)) is not None), None)
    if found is not None and not knows.is_here:
        return replace(found, look="")
    if found is None or found.look or not asked.things:
        return found
    old = any(knows.is_old(when) for _, when in knows.of(asked.things[0])[:1])
    return replace(found, look=_looking(asked.things[0])) if old else found


def of_another(text: str, question: str, reader: RequestReader) -> str:
    """Return "and the mug?" as the question before it, asked of the mug; else the text itself.

    Args:
        text: what is said.
        question: what was asked last, "" where it was none.
        reader: of English.
    """
    if not question or not _OF_ANOTHER.match(text):
        return text
    new, old = reader.read(text), reader.read(question)
    named = [one for request in old for one in request.alone if one.start >= 0]
    fresh = [one for request in new for one in request.alone if not one.vague]
    rest = re.findall(r"[a-z]+", _OF_ANOTHER.sub(r"\g<rest>", text).lower())
    if (
        {*rest} & {*ASKING, "is", "are", "was", "did", "do", "s"}
        or len(new) != 1
        or len(fresh) != 1
        or not named
    ):
        return text
    whole, instead = old[0].whole, new[0].whole[fresh[0].start : fresh[0].end]
    return whole[: named[0].start] + instead + whole[named[0].end :]


class _Question(AskedQuestion):
    """A question with what it is answered from."""

    def __init__(self, request: Request, knows: Remembering, reader: RequestReader | None) -> None:
        super().__init__(request, knows.now_s)
        self.knows, self.reader = knows, reader


# ----------------------------------------------------------------- what was done


def _what_it_can(q: _Question) -> MemoryAnswer | None:
    """Answer "what can you do?" and "who are you?"."""
    asks = q.says(
        r"\b(?:can|could) you (?:all )?do\b|\byou able to do\b|^(?:who|what) are you\b(?! \w)"
    )
    if not asks or q.asks not in ("what", "who") or q.things:
        return None
    deeds = ", ".join(kind.said for kind in DEED_KINDS.values() if kind.said and kind.takes)
    can = f"I look after this room. I can put things somewhere, {deeds}."
    tells = "Ask me where something is, how it is or what I did; tell me what I should know."
    return MemoryAnswer(lines=(can, tells))


def _what_was_done(q: _Question) -> MemoryAnswer | None:
    all_of_it = q.asks == "what" or q.has("anything", "something")
    failed = q.has("'t", "not", "failed") or q.says(r"\bwent wrong\b")
    did = q.has("did", "done") or q.says(r"\b(?:you|we|i)\b.* do\b|\bwent wrong\b")
    if not (all_of_it and did and (q.has("you", "i", "we") or failed)):
        return None
    if q.has("here") and q.has("see", "seen"):
        return None
    if q.things:
        return None
    past = [
        f"{q.knows.ago(one.at_s)}: {one.plain or one.said} ({one.status})"
        for one in q.knows.past
        if one.status not in TOLD and q.then(one.at_s) and not (failed and one.status == "done")
    ]
    if not past and failed:
        return MemoryAnswer(lines=("Nothing that I know of.",))
    if not past:
        return MemoryAnswer(lines=("Nothing then." if q.knows.past else "Nothing yet.",))
    left = len(past) - _MOST
    more = (f"and {left} before that",) if left > 0 else ()
    return MemoryAnswer(lines=(*reversed(past[-_MOST:]), *more, *q.of_no_time))


def _what_was_told(q: _Question) -> MemoryAnswer | None:
    """Answer "what did I tell you about the apple?" and "did I tell you where it is?"."""
    if not q.says(r"\bi (?:ever |just |already )?(?:tell|told|teach|taught)\b") or q.reader is None:
        return None
    kinds = {kind for one in q.things for kind in one.types}
    lines = [
        f"{q.knows.ago(one.at_s).capitalize()}: {one.said.rstrip('.!')}."
        for one in q.knows.past
        if (one.status in TOLD or habit_in(one.said, q.reader) is not None) and q.then(one.at_s)
        if not kinds or kinds & _spoken_of(one.said, q.reader)
    ]
    nothing = MemoryAnswer(lines=("Nothing that I remember.",), known=False)
    return MemoryAnswer(lines=tuple(reversed(lines[-_MOST:]))) if lines else nothing


def _spoken_of(text: str, reader: RequestReader) -> set[str]:
    named = (one for asked in reader.read(text) for one in (*asked.alone, *asked.mentions))
    return {kind for one in named for kind in one.types}


def _whether_it_was_done(q: _Question) -> MemoryAnswer | None:
    if q.asks not in ("", "when", "why") or not q.has("did", "have", "has") or q.has("see", "seen"):
        return None
    if q.has("leave", "left") and q.state:
        return None
    if q.reader is None or not (q.things or q.unknown):
        return None
    at = next((n for n, word in enumerate(q.words) if word in ("you", "i", "we")), -1)
    rest = [word for word in q.words[at + 1 :] if word not in ("last", "ever", "already", "yet")]
    return _whether_i_did(q, rest) if at >= 0 and rest else None


def _whether_i_did(q: _Question, rest: Sequence[str]) -> MemoryAnswer | None:
    """Tell whether the agent has done what some words ask for: "washed", "the", "apple"."""
    if q.reader is None:
        return None
    order = " ".join([base_of_deed(rest[0]) or rest[0], *rest[1:]])
    asked = [
        one
        for request in q.reader.read(order, q.things)
        for one in deeds_of(request, (), done=True)
    ]
    if not asked:
        return None
    for past in (one for one in reversed(q.knows.past) if q.then(one.at_s)):
        known = deeds_in(past, q.reader)
        found = [one for one in known if any(_is_that(one, other) for other in asked)]
        if not found:
            continue
        when, said = q.knows.ago(past.at_s), past.plain or past.said
        if not any(one.done for one in found):
            line = f"I tried {when}, and it came out {past.status}: {said}."
            return MemoryAnswer(lines=(line,))
        told = {
            "when": when.capitalize(), "who": f"I did, {when}", "why": f"You asked for it {when}"
        }  # fmt: skip
        return MemoryAnswer(lines=(f"{told.get(q.asks, f'Yes, {when}')}: {said}.",))
    nobody = "Nobody that I know of." if q.asks == "who" else "No, not that I remember."
    return MemoryAnswer(lines=(nobody,), known=q.asks != "who")


def _who_did_it(q: _Question) -> MemoryAnswer | None:
    """Answer "who moved the apple?": from the log, or that nobody was seen."""
    anybody = q.asks == "" and q.has("anybody", "anyone", "somebody", "someone")
    if not (q.asks == "who" or (anybody and q.has(*_MOVING))) or not q.things:
        return None
    if not q.has(*_MOVING):
        if q.has("in", "on", "under"):  # "who is in the kitchen?"
            return None
        deed = next((word for word in q.words[1:3] if base_of_deed(word)), "")
        return _whether_i_did(q, [deed, *q.words[q.words.index(deed) + 1 :]]) if deed else None
    kinds = {*q.things[0].types}
    moved = [one for one in moves(q.knows.past) if base_type(type_of(one.object_id)) in kinds]
    if not moved:
        name = name_of(q.things[0].types[0])
        return MemoryAnswer(lines=(f"Nobody that I know of: I saw no {name} moved.",), known=False)
    last = moved[-1]
    name, when = name_of(last.object_id), q.knows.ago(last.at_s)
    if last.told:
        return MemoryAnswer(lines=(f"You told me {when} that the {name} was moved.",))
    if last.said:
        return MemoryAnswer(lines=(f"I did, {when}: {last.said}.",))
    line = f"I do not know who. The {name} was {told_place(last.before)}; {when} I found it"
    return MemoryAnswer(lines=(f"{line} {told_place(last.after)}.",))


def _what_changed(q: _Question) -> MemoryAnswer | None:
    """Tell of each thing that was moved where it was and where it is, the last one first."""
    asks = q.asks == "what" or q.has("anything", "something")
    if not asks or not q.has("changed", "change", "different", "moved") or q.things:
        return None
    known = [one for one in moves(q.knows.past) if q.then(one.at_s)]
    last = {one.object_id: one for one in known}
    if not last:
        return MemoryAnswer(lines=("Nothing that I have seen.", *q.of_no_time))
    first: dict[str, Move] = {}
    for one in known:
        first.setdefault(one.object_id, one)
    told = sorted(last.values(), key=lambda one: -one.at_s)
    lines = [
        f"The {name_of(one.object_id)} went {_way(first[one.object_id].before, one.after)}, "
        f"{q.knows.ago(one.at_s)}: {_by(one)}."
        for one in told
        if first[one.object_id].before != one.after
    ]
    more = (f"and {len(lines) - _MOST} more",) if len(lines) > _MOST else ()
    again = ", the ".join(name_of(one.object_id) for one in told[:_MOST])
    lasted = f"Nothing that lasted: where it was before is the {again}."
    told_lines = (*lines[:_MOST], *more) or (lasted,)
    return MemoryAnswer(lines=(*told_lines, *q.of_no_time))


def _by(one: Move) -> str:
    if one.told:
        return "so you told me"
    return f'I did it when you said "{one.said}"' if one.said else "somebody did, not I"


def _way(before: str, after: str | None) -> str:
    start, end = _place_words(before), _place_words(after)
    return f"from one {name_of(before)} to another" if start == end else f"from {start} to {end}"


def _place_words(place: str | None) -> str:
    if place == HAND:
        return "my hand"
    return f"the {name_of(place)}" if place else "somewhere"


def _not_looked_into(q: _Question) -> MemoryAnswer | None:
    """Answer "what have you not seen?": what has a door, and was not opened."""
    if not (q.has("not", "'t", "never") and q.has("seen", "see", "looked", "searched")) or q.things:
        return None
    into = looked_into(q.knows.past)
    shut = [name for name in q.knows.sights if has_door(type_of(name)) and name not in into]
    if not shut:
        return MemoryAnswer(lines=("I have looked into all that has a door and that I know of.",))
    counts = Counter(name_of(name) for name in sorted(shut))
    told = ", ".join(plural(count, name) for name, count in counts.items())
    return MemoryAnswer(lines=(f"I have not looked into {len(shut)} places: {told}.",))


def _is_that(done: PastDeed, asked: PastDeed) -> bool:
    """Return whether a deed is one that is asked about: of its things, and at its place."""
    things = {*done.things} & {*asked.things}
    places = {*map(without_basin, done.places)} & {*map(without_basin, asked.places)}
    return done.deed == asked.deed and bool(things) and bool(places or not asked.places)


# ----------------------------------------------------------------- how things are


def _how_many(q: _Question) -> MemoryAnswer | None:
    if not (q.asks == "how" and q.has("many")):
        return None
    if not q.things:
        return _not_seen(q)
    if not q.about and not q.unknown:
        return _what_lies_there(q, counted=True)
    found = [one for one in q.knows.of(q.things[0]) if is_at(one[0], q.at if q.about else ())]
    if q.state:
        found = [one for one in found if is_so(q.state, one[0])]
    if not found:
        return MemoryAnswer(
            lines=("None that I have seen.",), known=False, look=_looking(q.things[0])
        )
    places = ", ".join(
        f"{_told(sight, q.knows.room)} ({q.knows.seen(sight, when)})"
        for sight, when in found[:_MOST]
    )
    return MemoryAnswer(lines=(f"{len(found)} that I have seen: {places}.",))


def _what_is_here(q: _Question) -> MemoryAnswer | None:
    """Answer "what is here?", and "what is in the kitchen?" there: the last that was seen first."""
    asks = q.asks in ("what", "which") or q.has("anything", "something")
    if (
        not asks
        or not q.has("here")
        or q.things
        or q.state
        or not all(one.anything for one in q.unknown)
    ):
        return None
    found = sorted(
        ((one, when) for one, when in q.knows.sights.values() if one.pickupable),
        key=lambda one: (-one[1], one[0].object_id),
    )
    if not found:
        return MemoryAnswer(lines=("I have seen nothing yet that can be carried.",), known=False)
    told = [
        f"the {name_of(one.object_id)} {_told(one, q.knows.room)} ({q.knows.seen(one, when)})"
        for one, when in found[:_MOST]
    ]
    more = f" and {len(found) - _MOST} more" if len(found) > _MOST else ""
    return MemoryAnswer(lines=(f"I have seen {', '.join(told)}{more}.",))


def _what_lies_there(q: _Question, *, counted: bool = False) -> MemoryAnswer | None:
    """Answer "what is in the fridge?", "is there anything on it?", "is the drawer empty?"."""
    empty = q.state == "empty" and not q.at and any(map(_holds_things, q.about[:1]))
    whether = q.asks == "" and q.open and not q.about and bool(q.at)
    asks = q.asks in ("what", "which", "who") and bool(q.at) and not q.about
    if not (empty or whether or asks or counted) or q.has("state", "done", "do"):
        return None
    place = (q.at or q.about)[-1]
    if q.under and {*place.types} & {*BASIN_OF, *BASINS}:
        place = replace(place, text="cabinet under it", types=BELOW_SINKS)
    elif q.under:
        line = f"I cannot see what is under the {place.text}."
        return MemoryAnswer(lines=(line,), known=False)
    known = q.knows.of(place)
    lying = _lying(q, place)
    where = told_place(known[0][0].object_id if known else place.types[0])
    if q.near:
        where = f"near the {place.text}"
    if not lying:
        return _nothing_there(q, place, where, empty=empty)
    lying.sort(key=lambda one: (-one[1], one[0].object_id))
    told = [
        f"the {name_of(sight.object_id)} ({q.knows.seen(sight, when)})" for sight, when in lying
    ]
    more = f" and {len(told) - _MOST} more" if len(told) > _MOST else ""
    lead = "No. " if empty else "Yes. " if whether else f"{len(told)}. " if counted else ""
    what = f"{where[0].upper()}{where[1:]}: {', '.join(told[:_MOST])}{more}."
    return MemoryAnswer(lines=(lead + what,))


def _lying(q: _Question, place: Mention) -> list[tuple[SeenObject, float]]:
    """Return what was seen in, on or near a place."""
    if not q.near:
        at = [one for one in q.knows.sights.values() if is_at(one[0], [place])]
        return [one for one in at if one[0].pickupable]
    return _beside(q, [sight for sight, _ in q.knows.of(place)])


def _beside(q: _Question, those: Sequence[SeenObject]) -> list[tuple[SeenObject, float]]:
    """Return what can be carried and was seen within reach of some things."""
    ids = {one.object_id for one in those}
    return [
        (sight, when)
        for sight, when in q.knows.sights.values()
        if sight.pickupable and sight.object_id not in ids and place_of(sight) != HAND
        if any(math.dist(sight.position_m, one.position_m) <= NEAR_M for one in those)
    ]


def _nothing_there(q: _Question, place: Mention, where: str, *, empty: bool) -> MemoryAnswer | None:
    """Return that nothing was seen at a place, and whether that says anything."""
    ids = {sight.object_id for sight, _ in q.knows.of(place)}
    unopened = has_door(place.types[0]) and not ids & looked_into(q.knows.past)
    if empty and unopened:
        line = f"I have not looked into the {place.text}."
        return MemoryAnswer(lines=(line,), known=False, look=_looking(place))
    if empty:
        return None if q.knows.of(place) else _not_seen(q)
    shut = " I have not looked into it." if unopened else ""
    return MemoryAnswer(lines=(f"I have seen nothing {where}.{shut}",), known=False)


def _holds_things(one: Mention) -> bool:
    return any(object_types()[kind].can("receptacle") for kind in one.types)


def _what_is_beside(q: _Question) -> MemoryAnswer | None:
    """Answer "what is the mug next to?"."""
    if not (q.hangs_near and len(q.about) == 1 and not q.at):
        return None
    if not (found := q.knows.of(q.about[0])):
        return _not_seen(q)
    sight, when = found[0]
    names = dict.fromkeys(f"the {name_of(one.object_id)}" for one, _ in _beside(q, [sight]))
    near = f", near {', '.join([*names][:_MOST])}" if names else ""
    where, seen = _told(sight, q.knows.room), q.knows.seen(sight, when)
    line = f"The {name_of(sight.object_id)} is {where}{near}; {seen}."
    return MemoryAnswer(lines=(line,))


def _which_are_so(q: _Question) -> MemoryAnswer | None:
    """Answer "is anything dirty?", "what is on?", "is everything closed?"."""
    asks = q.asks in ("what", "which")
    if not q.state or q.at or q.unknown or q.has("did", "do"):
        return None
    if not (asks or (q.open and not q.about)):
        return None
    kinds = {kind for one in q.about for kind in one.types}
    need = NEEDS.get({"clean": "dirty", "empty": "filled"}.get(q.state, q.state))
    known = [
        one
        for one in q.knows.all()
        if one[0].states and (need is None or kinds or _kind(one[0]).can(need))
        if not kinds or kinds & {one[0].object_type, base_type(one[0].object_type)}
    ]
    so = [one for one in known if is_so(q.state, one[0])]
    every = q.has("everything", "all") and q.asks == ""
    told = [one for one in known if one not in so] if every else so
    word = q.state_word
    if not told:
        none = f"Yes, all that I have seen is {word}." if every else "Nothing that I have seen."
        return MemoryAnswer(lines=(none,), known=bool(known))
    names = ", ".join(
        f"the {name_of(sight.object_id)} ({_lies(q, sight, when, STATE_TOLD)})"
        for sight, when in sorted(told, key=lambda one: (-one[1], one[0].object_id))[:_MOST]
    )
    more = f" and {len(told) - _MOST} more" if len(told) > _MOST else ""
    lead = f"No, not {word}: " if every else "Yes: " if q.asks == "" else f"{word.capitalize()}: "
    return MemoryAnswer(lines=(f"{lead}{names}{more}.",))


def _kind(sight: SeenObject) -> ObjectType:
    return object_types()[base_type(sight.object_type)]


def _what_is_known(q: _Question) -> MemoryAnswer | None:
    """Answer "what have you seen so far?", "what do you remember?"."""
    knows = q.has("seen", "remember", "know", "memory") and q.has("you", "your")
    if q.asks != "what" or not knows or q.things or q.has("not", "'t", "never"):
        return None
    carried = [sight for sight, _ in q.knows.sights.values() if sight.pickupable]
    counts = Counter(name_of(one.object_id) for one in carried)
    names = ", ".join(plural(count, name) for name, count in sorted(counts.items()))
    told = f"I have seen {plural(len(carried), 'thing')} that can be carried"
    return MemoryAnswer(lines=(f"{told}: {names}. /memory and /map show more.",))


def _what_is_held(q: _Question) -> MemoryAnswer | None:
    own = re.search(r"\byour hands?\b", " ".join(q.words))  # not "the hand towel"
    if not (own or q.has("holding", "hold", "carrying")) or q.asks in ("where", "when"):
        return None
    held = [one for one, _ in q.knows.sights.values() if place_of(one) == HAND]
    if not held:
        return MemoryAnswer(lines=("No, nothing.",) if q.asks != "what" else ("Nothing.",))
    kinds = {kind for thing in q.things for kind in thing.types}
    so = q.asks == "what" or not kinds or base_type(held[0].object_type) in kinds
    lead = "" if q.asks == "what" else "Yes: " if so else "No: "
    return MemoryAnswer(lines=(f"{lead}I hold the {name_of(held[0].object_id)}.",))


def _which_it_was(q: _Question) -> MemoryAnswer | None:
    """Answer "what was the first thing you moved?", which names that thing by now."""
    if (
        q.asks not in ("what", "which")
        or len(q.things) != 1
        or q.words[1:2] not in (["was"], ["is"])
    ):
        return None
    kinds = {*q.things[0].types}
    if q.has("state", "in", "on", "inside", "under", "with"):
        return None
    mine = [m for m in moves(q.knows.past) if m.said and base_type(type_of(m.object_id)) in kinds]
    return MemoryAnswer(lines=(f"The {name_of(mine[-1].object_id)}.",)) if mine else None


def _whether(q: _Question) -> MemoryAnswer | None:
    left = q.first == "did" and q.has("leave", "left") and bool(q.state)  # "did you leave it open"
    had = q.says(r"^(?:do|have|has) (?:we|you|i) (?:still )?(?:have|got)\b")
    had = had or (q.first in ("does", "do") and bool(q.about) and bool(q.at))
    about = q.first in ("is", "are", "was", "were") or q.has("whether", "if") or left or had
    sure = q.says(r"^how (?:sure|certain) are you\b")
    if not (about or sure) or (q.asks and not sure) or not (q.things or q.unknown):
        return None
    poured = [one for one in q.unknown if one.text.split()[-1] in _POURED]
    if not q.things or (q.unknown and not q.about and not poured):
        return _not_seen(q)
    thing, places = q.things[0], q.at if q.about else ()
    if poured and not q.about:  # "is there water in the vase?"
        return _state_told(q, thing, q.knows.of(thing), "filled") if q.knows.of(thing) else None
    found = q.knows.of(thing)
    if not found:
        told = _told_last(q, thing, -1.0, STATE_TOLD) if q.state else None
        said = told and f"You told me {q.knows.ago(told.at_s)}: {told.said.rstrip('.!')}."
        return MemoryAnswer(lines=(said,)) if said else _not_seen(q)
    if q.state and not places:
        return _state_told(q, thing, found)
    if "there" in q.words[:3] or places or had or q.has("here"):
        there = [one for one in found if _is_there(q, one[0], places)]
        if (thing.number or 0) > 1:
            return _whether_so_many(q, thing.number or 0, len(there))
        sight, when = (there or found)[0]
        yes = "Yes" if there else "No, not that I saw"
        name, seen = name_of(sight.object_id), q.knows.seen(sight, when)
        either = "or" in q.words and len(places) > 1 and bool(there)
        lead = f"The {name}" if either else f"{yes}: the {name}"
        return MemoryAnswer(lines=(f"{lead} is {_told(sight, q.knows.room)}, {seen}.",))
    return None


def _whether_so_many(q: _Question, number: int, count: int) -> MemoryAnswer:
    """Answer "are there more than two pillows?"."""
    fewer = q.says(r"\b(?:less|fewer) than\b")
    enough = count < number if fewer else count > number if q.says(r"\bmore than\b") else None
    enough = count >= number if enough is None else enough
    return MemoryAnswer(lines=(f"{'Yes' if enough else 'No'}: {count} that I have seen.",))


def _is_there(q: _Question, sight: SeenObject, places: Sequence[Mention]) -> bool:
    if not q.near or not places:
        return is_at(sight, places)
    those = [one for place in places for one, _ in q.knows.of(place)]
    return any(one.object_id == sight.object_id for one, _ in _beside(q, those))


def _state_told(
    q: _Question, thing: Mention, found: Sequence[tuple[SeenObject, float]], state: str = ""
) -> MemoryAnswer:
    """Return whether what was seen of a thing shows a state; of several, which do."""
    several = (thing.every or (thing.number or 0) > 1) and len(found) > 1
    some = found if several else found[:1]
    so = [one for one in some if is_so(state or q.state, one[0])]
    yes = len(so) == len(some)
    word = state or next(w for w in reversed(q.words) if w in request_words().seen)
    sight, when = (so if yes else [one for one in some if one not in so])[0]
    name = name_of(sight.object_id)
    if not sight.states:  # nothing was read of it: that shows neither
        line = f"I have not seen whether the {name} is {word}."
        return MemoryAnswer(lines=(line,), known=False, look=_looking(thing))
    if yes:
        whole = f"all {len(some)} that I have seen are" if several else f"the {name} is"
        return MemoryAnswer(
            lines=(f"Yes, {whole} {word}; {q.knows.seen(sight, when, STATE_TOLD)}.",)
        )
    where = f" {_told(sight, q.knows.room)}" if several and place_of(sight) else ""
    return MemoryAnswer(
        lines=(f"No, the {name}{where} is not {word}; {q.knows.seen(sight, when, STATE_TOLD)}.",)
    )


def _how_it_is(q: _Question) -> MemoryAnswer | None:
    if not (q.asks in ("how", "what") and q.things and q.has("state", "is", "are", "'s")):
        return None
    if not q.has("state") and not q.says(r"\bhow (?:'s|is|are|was|were)\b"):
        return None
    thing = q.things[-1]
    if not (found := q.knows.of(thing)):
        return _not_seen(q)
    sight, when = found[0]
    states = ", ".join(sight.states) or "as it was: I have seen nothing special about it"
    return MemoryAnswer(
        lines=(
            f"The {name_of(sight.object_id)}: {states}; {q.knows.seen(sight, when, STATE_TOLD)}.",
        )
    )


# ----------------------------------------------------------------- where things are


def _when(q: _Question) -> MemoryAnswer | None:
    if q.asks != "when" or not q.things or not q.has("see", "seen"):
        return None
    if not (found := q.knows.of(q.things[0])):
        return _not_seen(q)
    sight, when = found[0]
    told = q.knows.ago(when)
    return MemoryAnswer(
        lines=(f"I saw the {name_of(sight.object_id)} {told}, {_told(sight, q.knows.room)}.",)
    )


def _which_place(q: _Question) -> MemoryAnswer | None:
    """Answer "which cabinet has the plate?", "what drawer is it in?"."""
    if q.asks not in ("which", "what") or len(q.about) != 1 or not q.at or q.near:
        return None
    known = q.knows.of(q.about[0])
    there = [one for one in known if is_at(one[0], q.at)]
    name, place = name_of(q.about[0].types[0]), name_of(q.at[0].types[0])
    lines = [
        f"The {name_of(sight.object_id)} is {_lies(q, sight, when)}."
        for sight, when in (there or known)[:2]
    ]
    none = () if there else (f"In no {place} that I have seen is a {name}.",)
    look = "" if known else _looking(q.about[0])
    return MemoryAnswer(lines=(*none, *lines), known=bool(there), look=look)


def _where(q: _Question) -> MemoryAnswer | None:
    if q.asks != "where" and not q.has("seen", "see"):
        return None
    if not q.things:
        return _not_seen(q) if q.unknown else None
    if q.reader is not None and q.has("go", "goes", "belong", "belongs", "live", "lives"):
        usual = habits(q.knows.past, q.reader)
        place = next((usual[kind] for kind in q.things[0].types if kind in usual), "")
        if place:
            name = name_of(q.things[0].types[0])
            return MemoryAnswer(lines=(f"You told me: the {name} goes {told_place(place)}.",))
    lines: list[str] = []
    carried = [
        one for one in q.things if any(object_types()[k].can("pickupable") for k in one.types)
    ]
    for thing in carried if q.has("are", "were") and carried else q.things[:1]:
        found = q.knows.of(thing)
        own = {owned(q.knows.past).get(kind) for kind in thing.types} if q.has("my") else set()
        mine = [one for one in found if one[0].object_id in own]
        found = mine or found
        several = thing.every or (thing.number or 0) > 1
        seen_s = max((when for _, when in found), default=0.0)
        if not mine and (told := _told_last(q, thing, seen_s)) is not None:
            lines.append(f"You told me {q.knows.ago(told.at_s)}: {told.said.rstrip('.!')}.")
            continue
        for sight, when in found[: _MOST if several else 2]:
            name = f"{'Your' if mine else 'The'} {name_of(sight.object_id)}"
            lines.append(f"{name} is {_told(sight, q.knows.room)}, {q.knows.seen(sight, when)}.")
            moved = [m for m in moves(q.knows.past) if m.object_id == sight.object_id]
            if q.has("was", "were") and moved:
                lines.append(f"Before that it was {told_place(moved[-1].before)}.")
        on_map = [kind for kind in thing.types if kind in q.knows.furniture]
        if not found and on_map:
            where = "; /map shows where" if q.knows.is_here else ""
            lines.append(f"The {name_of(on_map[0])} is in {q.knows.room}{where}.")
    return MemoryAnswer(lines=tuple(lines)) if lines else _not_seen(q)


def _told_last(
    q: _Question, thing: Mention, since_s: float, kind: str = PLACE_TOLD
) -> PastErrand | None:
    """Return what a person told of a thing after it was seen."""
    for past in reversed(q.knows.past):
        if past.status == kind and past.at_s >= since_s and q.reader is not None:
            about = (one for request in q.reader.read(past.said) for one in request.alone[:2])
            if any({*thing.types} & {*one.types} for one in about):
                return past
    return None


def _not_seen(q: _Question) -> MemoryAnswer | None:
    thing = next(iter([*q.about, *q.unknown, *q.at]), None)
    if thing is None:
        return None
    if not thing.types:
        return MemoryAnswer(lines=(f"I know nothing that is called {thing.text}.",), known=False)
    on_map = any(kind in q.knows.furniture for kind in thing.types)
    said = f"I have not seen any {thing.text} {'here' if q.knows.is_here else 'there'}."
    if on_map:
        said = f"The {thing.text} is in {q.knows.room}; how it is I have not seen."
    return MemoryAnswer(
        lines=(f"{said} {_OFFER}" if q.knows.is_here else said,),
        known=False,
        look=_looking(thing),
    )


def _looking(thing: Mention) -> str:
    return f"find the {name_of(thing.types[0])}"


def is_at(sight: SeenObject, places: Sequence[Mention]) -> bool:
    """Return whether a thing lies in or on one of some places; of none it always does."""
    kinds = {without_basin(kind) for place in places for kind in place.types}
    return not kinds or any(without_basin(type_of(one)) in kinds for one in sight.parent_ids)


def _lies(q: _Question, sight: SeenObject, when: float, about: str = PLACE_TOLD) -> str:
    return f"{_told(sight, q.knows.room)}, {q.knows.seen(sight, when, about)}"


def _told(sight: SeenObject, room: str = "this room") -> str:
    place = place_of(sight)
    kind = object_types().get(sight.object_type)
    fixed = not sight.pickupable and (kind is None or not kind.can("pickupable"))
    if place != HAND and (fixed or place is None):
        return f"in {room}"
    return told_place(place)


_KINDS: tuple[Callable[[_Question], MemoryAnswer | None], ...] = (
    _what_it_can,
    _what_was_told,
    _what_is_beside,
    _what_was_done,
    _what_changed,
    _who_did_it,
    _not_looked_into,
    _what_is_held,
    _which_it_was,
    _how_many,
    _what_is_here,
    _when,
    _which_are_so,
    _what_lies_there,
    _which_place,
    _whether,
    _whether_it_was_done,
    _where,
    _what_is_known,
    _how_it_is,
)
