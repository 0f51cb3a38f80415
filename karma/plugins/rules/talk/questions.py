"""Questions answered from memory: where, whether, how many, when, what lies there, what was done.

What was seen is told with its age; what was not seen is not guessed, and the answer offers to look.
Nothing is done for a question.
"""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

from karma.agent.seeing.perceive import place_of
from karma.assistant.replies import MemoryAnswer
from karma.assistant.session_log import PLACE_TOLD, STATE_TOLD
from karma.household.containment import has_door
from karma.household.ids import root_id
from karma.household.pieces import base_type
from karma.household.places import HAND
from karma.household.saying import name_of, told_place
from karma.household.states import NEEDS
from karma.household.types import object_types
from karma.journal.formats import plural
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.language.request_words import request_words
from karma.plugins.rules.object_finder import is_so
from karma.plugins.rules.talk import log_answers
from karma.plugins.rules.talk.asking import ASKING, AskedQuestion, can_hold
from karma.plugins.rules.talk.history import habits, looked_into
from karma.plugins.rules.talk.remembering import (
    MOST,
    Remembering,
    Sight,
    answer,
    few,
    last_first,
    unknown,
)
from karma.plugins.rules.types import Mention, Request
from karma.types.observation import SeenObject

_POURED = ("water", "coffee", "wine", "liquid")
_OFFER = 'Say "go and see", or /look, and I look for it.'
_OF_ANOTHER = re.compile(
    r"^\W*(?:and |or )?(?:what about|how about|and|or)\b(?P<rest>.*)\?\W*$", re.IGNORECASE
)


def answered(request: Request, knows: Remembering, reader: RequestReader) -> MemoryAnswer | None:
    """Return the answer to a question, None where it is not understood."""
    asked = AskedQuestion(request, knows, reader)
    found = next((found for kind in _KINDS if (found := kind(asked)) is not None), None)
    if found is None or found.look or not asked.things:
        return found
    old = any(knows.is_old(when) for _, when in knows.of(asked.things[0])[:1])
    return replace(found, look=_looking(asked.things[0])) if old else found


def of_another(text: str, question: str, reader: RequestReader) -> str:
    """Return "and the mug?" as the question before it, asked of the mug; else the text itself.

    `question` is what was asked last, "" where it was none.
    """
    if not question or not _OF_ANOTHER.match(text):
        return text
    new, old = reader.read(text), reader.read(question)
    named = [one for request in old for one in request.alone if one.start >= 0]
    fresh = [one for request in new for one in request.alone if not one.vague]
    rest = re.findall(r"[a-z]+", _OF_ANOTHER.sub(r"\g<rest>", text).lower())
    whole = {*rest} & {*ASKING, "is", "are", "was", "did", "do", "s"}
    if whole or len(new) != 1 or len(fresh) != 1 or not named:
        return text
    before, instead = old[0].whole, new[0].whole[fresh[0].start : fresh[0].end]
    return before[: named[0].start] + instead + before[named[0].end :]


# ----------------------------------------------------------------- how things are


def _how_many(q: AskedQuestion) -> MemoryAnswer | None:
    if not (q.asks == "how" and q.has("many")):
        return None
    if not q.things:
        return _not_seen(q)
    if not q.about and not q.unknown:
        return _what_lies_there(q, counted=True)
    pieces = q.has(*request_words().pieces)
    known = q.knows.pieces_of(q.things[0]) if pieces else q.knows.of(q.things[0])
    found = [one for one in known if q.knows.lies_at(one[0], q.at if q.about else ())]
    if q.state:
        found = [one for one in found if _is_so(q, q.state, one[0])]
    if not pieces:  # what was cut is one thing, wherever its pieces are
        found = [*{root_id(one[0].object_id): one for one in reversed(found)}.values()][::-1]
    if not found:
        return unknown("None that I have seen.", look=_looking(q.things[0]))
    places = [f"{_place(q, one[0])} ({q.knows.seen(*one)})" for one in found[:MOST]]
    return answer(f"{len(found)} that I have seen: {', '.join(places)}.")


def _what_is_here(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "what is here?", and "what is in the kitchen?" there: the last that was seen first."""
    asks = q.asks in ("what", "which") or q.has("anything", "something")
    named = q.things or q.state or not all(one.anything for one in q.unknown)
    if not asks or not q.has("here") or named:
        return None
    found = last_first(one for one in q.knows.sights.values() if one[0].pickupable)
    if not found:
        return unknown("I have seen nothing yet that can be carried.")
    told = few(found, lambda one: f"{_the(one[0])} {_place(q, one[0])} ({q.knows.seen(*one)})")
    return answer(f"I have seen {told}.")


def _what_lies_there(q: AskedQuestion, *, counted: bool = False) -> MemoryAnswer | None:
    """Answer "what is in the fridge?", "is there anything on it?", "is the drawer empty?"."""
    empty = q.state == "empty" and not q.at and any(map(can_hold, q.about[:1]))
    whether = q.asks == "" and q.open and not q.about and bool(q.at)
    asks = q.asks in ("what", "which", "who") and bool(q.at) and not q.about
    if not (empty or whether or asks or counted) or q.has("state", "done", "do"):
        return None
    place = (q.at or q.about)[-1]
    if q.beside:
        return unknown(f"I do not keep what is under or beside the {place.text}.")
    known = q.knows.of(place)
    at = (one for one in q.knows.sights.values() if q.knows.lies_at(one[0], [place]))
    lying = [one for one in at if one[0].pickupable]
    where = told_place(known[0][0].object_id if known else place.types[0])
    if not lying:
        return _nothing_there(q, place, where, empty=empty)
    told = few(last_first(lying), lambda one: f"{_the(one[0])} ({q.knows.seen(*one)})")
    lead = "No. " if empty else "Yes. " if whether else f"{len(lying)}. " if counted else ""
    return answer(f"{lead}{where[0].upper()}{where[1:]}: {told}.")


def _nothing_there(
    q: AskedQuestion, place: Mention, where: str, *, empty: bool
) -> MemoryAnswer | None:
    """Return that nothing was seen at a place, and whether that says anything."""
    ids = {sight.object_id for sight, _ in q.knows.of(place)}
    unopened = has_door(place.types[0]) and not ids & looked_into(q.knows.past)
    if empty and unopened:
        return unknown(f"I have not looked into the {place.text}.", look=_looking(place))
    if empty:
        return None if ids else _not_seen(q)
    shut = " I have not looked into it." if unopened else ""
    if ids:
        return unknown(f"I have seen nothing {where}.{shut}")
    return unknown(f"I have seen nothing {where}.{shut} {_OFFER}", look=_looking(place))


def _which_are_so(q: AskedQuestion) -> MemoryAnswer | None:
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
        if one[0].states
        and (need is None or kinds or object_types()[base_type(one[0].object_type)].can(need))
        if not kinds or kinds & {one[0].object_type, base_type(one[0].object_type)}
    ]
    so = [one for one in known if _is_so(q, q.state, one[0])]
    every = q.has("everything", "all") and q.asks == ""
    told = [one for one in known if one not in so] if every else so
    word = q.state_word
    if not told:
        none = f"Yes, all that I have seen is {word}." if every else "Nothing that I have seen."
        return answer(none, known=bool(known))
    names = few(last_first(told), lambda one: f"{_the(one[0])} ({_lies(q, *one, STATE_TOLD)})")
    lead = f"No, not {word}: " if every else "Yes: " if q.asks == "" else f"{word.capitalize()}: "
    return answer(f"{lead}{names}.")


def _is_so(q: AskedQuestion, state: str, sight: SeenObject) -> bool:
    """Return whether a thing was seen in a state; empty is only what was looked into."""
    if state not in ("empty", "filled") or not object_types()[sight.object_type].can("receptacle"):
        return is_so(state, sight)
    parents = (parent for one, _ in q.knows.sights.values() for parent in one.parent_ids)
    if any(parent.startswith(sight.object_id) for parent in parents):  # in it, or in its basin
        return state == "filled"
    shut = has_door(sight.object_type) and sight.object_id not in looked_into(q.knows.past)
    return not shut and is_so(state, sight)


def _what_is_known(q: AskedQuestion) -> MemoryAnswer | None:
    """Answer "what have you seen so far?", "what do you remember?"."""
    knows = q.has("seen", "remember", "know", "memory") and q.has("you", "your")
    if q.asks != "what" or not knows or q.things or q.has("not", "'t", "never"):
        return None
    carried = [sight for sight, _ in q.knows.sights.values() if sight.pickupable]
    counts = Counter(name_of(one.object_id) for one in carried)
    names = ", ".join(plural(count, name) for name, count in sorted(counts.items()))
    told = f"I have seen {plural(len(carried), 'thing')} that can be carried"
    return answer(f"{told}: {names}. /memory and /map show more.")


def _what_is_held(q: AskedQuestion) -> MemoryAnswer | None:
    own = re.search(r"\byour hands?\b", " ".join(q.words))  # not "the hand towel"
    if not (own or q.has("holding", "hold", "carrying")) or q.asks in ("where", "when"):
        return None
    held = [one for one, _ in q.knows.sights.values() if place_of(one) == HAND]
    if not held:
        return answer("Nothing." if q.asks == "what" else "No, nothing.")
    kinds = {kind for thing in q.things for kind in thing.types}
    so = q.asks == "what" or not kinds or base_type(held[0].object_type) in kinds
    lead = "" if q.asks == "what" else "Yes: " if so else "No: "
    return answer(f"{lead}I hold {_the(held[0])}.")


def _whether(q: AskedQuestion) -> MemoryAnswer | None:
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
    several = len(q.about) > 1 and "or" not in q.words
    if places and (several or q.beside or q.first in ("was", "were")):
        return None
    found = q.knows.of(thing)
    if not found:
        told = _told_last(q, thing, -1.0, STATE_TOLD) if q.state else ""
        return answer(told) if told else _not_seen(q)
    there = [one for one in found if q.knows.lies_at(one[0], places)]
    if q.state and (there or not places):  # "is the mug on the table dirty?"
        return _state_told(q, thing, there if places else found)
    if "there" in q.words[:3] or places or had or q.has("here"):
        if (thing.number or 0) > 1 or q.has("than"):
            return answer(f"{len(there)} that I have seen.")
        sight, when = (there or found)[0]
        yes = "Yes" if there else "No, not that I saw"
        either = "or" in q.words and len(places) > 1 and bool(there)
        lead = f"The {name_of(sight.object_id)}" if either else f"{yes}: {_the(sight)}"
        return answer(f"{lead} is {_lies(q, sight, when)}.")
    return None


def _state_told(
    q: AskedQuestion, thing: Mention, found: Sequence[Sight], state: str = ""
) -> MemoryAnswer:
    """Return whether what was seen of a thing shows a state; of several, which do."""
    plural = thing.every or (thing.number or 0) > 1
    any_of_them = q.has("any", "either")
    plural = plural or any_of_them
    several = plural and len(found) > 1
    some = found if several else found[:1]
    so = [one for one in some if _is_so(q, state or q.state, one[0])]
    yes = bool(so) if any_of_them else len(so) == len(some)
    word = state or next(w for w in reversed(q.words) if w in request_words().seen)
    sight, when = (so if yes else [one for one in some if one not in so])[0]
    name, seen = name_of(sight.object_id), q.knows.seen(sight, when, STATE_TOLD)
    if not sight.states:  # nothing was read of it: that shows neither
        return unknown(f"I have not seen whether the {name} is {word}.", look=_looking(thing))
    if plural and not so and several:
        return answer(f"No, none of the {len(some)} that I have seen is {word}; {seen}.")
    if plural and not so:
        return answer(f"No, the one {name} that I have seen is not {word}; {seen}.")
    if not plural:
        lead = f"{'Yes' if yes else 'No'}, the {name} is {'' if yes else 'not '}{word}; {seen}."
        other = (
            one for one, _ in found[1:] if one.states and _is_so(q, state or q.state, one) != yes
        )
        lines = [f"It is otherwise with {_the(one)} {_place(q, one)}." for one in other]
        return answer(lead, *lines[:2])
    if yes:
        every = several and len(so) == len(some)
        count = "both" if len(some) == 2 else f"all {len(some)}"
        whole = f"{count} that I have seen are" if every else f"the {name} is"
        return answer(f"Yes, {whole} {word}; {seen}.")
    where = f" {_place(q, sight)}" if several and place_of(sight) else ""
    return answer(f"No, the {name}{where} is not {word}; {seen}.")


def _how_it_is(q: AskedQuestion) -> MemoryAnswer | None:
    if not (q.asks in ("how", "what") and q.things and q.has("state", "is", "are", "'s")):
        return None
    if not q.has("state") and not q.says(r"\bhow (?:'s|is|are|was|were)\b"):
        return None
    thing = q.things[-1]
    if not (found := q.knows.of(thing)):
        return _not_seen(q)
    sight, when = found[0]
    states = ", ".join(sight.states) or "as it was: I have seen nothing special about it"
    seen = q.knows.seen(sight, when, STATE_TOLD)
    return answer(f"The {name_of(sight.object_id)}: {states}; {seen}.")


# ----------------------------------------------------------------- where things are


def _when(q: AskedQuestion) -> MemoryAnswer | None:
    if q.asks != "when" or not q.things or not q.has("see", "seen"):
        return None
    if not (found := q.knows.of(q.things[0])):
        return _not_seen(q)
    sight, when = found[0]
    return answer(f"I saw {_the(sight)} {q.knows.ago(when)}, {_place(q, sight)}.")


def _where(q: AskedQuestion) -> MemoryAnswer | None:
    which = q.asks in ("which", "what") and bool(q.about and q.at) and not q.beside
    if q.asks != "where" and not which and not q.has("seen", "see"):
        return None
    if not q.things:
        return _not_seen(q) if q.unknown else None
    if q.has("go", "goes", "belong", "belongs", "live", "lives"):
        usual = habits(q.knows.past, q.reader)
        place = next((usual[kind] for kind in q.things[0].types if kind in usual), "")
        if place:
            name = name_of(q.things[0].types[0])
            return answer(f"You told me: the {name} goes {told_place(place)}.")
    lines: list[str] = []
    carried = [
        one for one in q.things if any(object_types()[k].can("pickupable") for k in one.types)
    ]
    for thing in carried if q.has("are", "were") and carried else q.things[:1]:
        found = q.knows.of(thing)
        several = thing.every or (thing.number or 0) > 1
        seen_s = max((when for _, when in found), default=0.0)
        if told := _told_last(q, thing, seen_s):
            lines.append(told)
            continue
        for sight, when in found[: MOST if several else 2]:
            lines.append(f"The {name_of(sight.object_id)} is {_lies(q, sight, when)}.")
        on_map = [kind for kind in thing.types if kind in q.knows.furniture]
        if not found and on_map:
            lines.append(f"The {name_of(on_map[0])} is in this room; /map shows where.")
    return answer(*lines) if lines else _not_seen(q)


def _told_last(q: AskedQuestion, thing: Mention, since_s: float, kind: str = PLACE_TOLD) -> str:
    """Return what a person told of a thing after it was seen; "" for nothing."""
    for past in reversed(q.knows.past):
        if past.status == kind and past.at_s >= since_s:
            about = (one for request in q.reader.read(past.said) for one in request.alone[:2])
            if any({*thing.types} & {*one.types} for one in about):
                return f"You told me {q.knows.ago(past.at_s)}: {past.said.rstrip('.!')}."
    return ""


def _not_seen(q: AskedQuestion) -> MemoryAnswer | None:
    thing = next(iter([*q.about, *q.unknown, *q.at]), None)
    if thing is None:
        return None
    if not thing.types:
        return unknown(f"I know nothing that is called {thing.text}.")
    on_map = any(kind in q.knows.furniture for kind in thing.types)
    said = f"I have not seen any {thing.text} here."
    if on_map:
        they = ("are", "they are") if thing.every or len(q.knows.of(thing)) > 1 else ("is", "it is")
        said = f"The {thing.text} {they[0]} in this room; how {they[1]} I have not seen."
    return unknown(f"{said} {_OFFER}", look=_looking(thing))


def _looking(thing: Mention) -> str:
    return f"find the {name_of(thing.types[0])}"


def _the(sight: SeenObject) -> str:
    return f"the {name_of(sight.object_id)}"


def _lies(q: AskedQuestion, sight: SeenObject, when: float, about: str = PLACE_TOLD) -> str:
    return f"{_place(q, sight)}, {q.knows.seen(sight, when, about)}"


def _place(q: AskedQuestion, sight: SeenObject) -> str:
    """Return where a thing is, in words; of what nobody moves, that it is in the room."""
    place = place_of(sight)
    if (whole := q.knows.whole_of(sight)) is not None:
        return f"at the {name_of(whole)}"
    kind = object_types().get(sight.object_type)
    fixed = not sight.pickupable and (kind is None or not kind.can("pickupable"))
    return "in this room" if place != HAND and (fixed or place is None) else told_place(place)


_KINDS: tuple[Callable[[AskedQuestion], MemoryAnswer | None], ...] = (
    log_answers.what_it_can,
    log_answers.what_was_told,
    log_answers.what_was_done,
    _what_is_held,
    _how_many,
    _what_is_here,
    _when,
    _which_are_so,
    _what_lies_there,
    _whether,
    log_answers.whether_it_was_done,
    _where,
    _what_is_known,
    _how_it_is,
)
