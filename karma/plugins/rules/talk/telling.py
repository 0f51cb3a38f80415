"""What a person tells: where a thing is, and how. It is believed until eyes know better."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from karma.agent.experience import unit_of
from karma.agent.seeing.perceive import place_of
from karma.assistant.replies import MemoryAnswer
from karma.assistant.session_log import PLACE_TOLD, STATE_TOLD
from karma.household.places import HAND
from karma.household.saying import name_of, told_place
from karma.household.states import ENDS, SAID_AS
from karma.plugins.rules.deeds import deed_kind
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.language.request_words import base_of_deed, deed_verbs, request_words
from karma.plugins.rules.talk.history import can_lie_in, habits_in
from karma.plugins.rules.talk.offers import offer_against
from karma.plugins.rules.talk.remembering import Remembering, answer, unknown
from karma.plugins.rules.types import Mention, Request
from karma.types.memory import MemoryChange

_BELOW = re.compile(r"\b(?:under|underneath|below|beneath|behind|above|over)\b", re.IGNORECASE)
_NOT_NOW = frozenset(
    ("no", "was", "were", "used", "should", "belongs", "belong", "goes", "go", "will", "or",
     "maybe", "if")
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class ToldPlace:
    """Where or how a thing is, by a person's words, and what that leaves in memory."""

    answer: MemoryAnswer
    change: MemoryChange | None  # None: eyes know better
    about: str = PLACE_TOLD


def told_of(
    request: Request, knows: Remembering, scene: str, reader: RequestReader
) -> ToldPlace | None:
    """Return what a statement says of a thing's place or state, or where it always goes.

    None where it says no such thing. Of a thing that was seen the believed place moves there, if
    one such place is known. `scene` is the name of the room.
    """
    change = MemoryChange(scene=scene, at_s=knows.now_s)
    if habits := habits_in(request.text, reader):
        usual = ", ".join(
            f"the {thing.text} {'go' if thing.every else 'goes'} {told_place(place.types[0])}"
            for thing, place in habits
        )
        return ToldPlace(answer(f"I will remember: {usual}."), change)
    if (told := _state_told(request, knows, change)) is not None:
        return told
    thing, place = _thing_and_place(request)
    if thing is None or place is None:
        return None
    if _BELOW.search(request.text):  # no memory has a place for it but the words
        return ToldPlace(answer("I will remember that you said so."), change)
    found, places = knows.of(thing), knows.of(place)
    name, where = name_of(thing.types[0]), told_place(place.types[0])
    if found and place_of(found[0][0]) == HAND:
        return ToldPlace(answer(f"I have the {name} in my hand."), None)
    if found and len(places) == 1:
        there = places[0][0]
        moved = replace(
            found[0][0],
            parent_ids=(there.object_id,),
            position_m=there.position_m,
            box_center_m=there.box_center_m,
            region=None,
            silhouette=(),
        )
        line = unit_of(moved, (), handled=False, image=None, scene=scene)
        change = replace(change, seen=(moved,), remembered=(line,))
    return ToldPlace(answer(f"I will remember: the {name} is {where}."), change)


def _state_told(request: Request, knows: Remembering, change: MemoryChange) -> ToldPlace | None:
    """Return what "the mug is clean now" and "I washed the plate" leave in memory."""
    words = [word.strip(".,!;") for word in request.text.lower().replace("n't", " n't").split()]
    named = [one for one in request.alone if one.types]
    state = _state_said(words)
    if len(named) != 1 or not state or _otherwise() & {*words}:
        return None
    found, name = knows.of(named[0]), name_of(named[0].types[0])
    offer = offer_against(request)
    if len(found) > 1 and not offer:
        which = f"I have seen {len(found)} of them: which {name}, and where is it?"
        return ToldPlace(unknown(which), None)
    if not found and not offer:
        line = f"I will remember that you said so; I have seen no {name} yet."
        return ToldPlace(answer(line), change, STATE_TOLD)
    if len(found) != 1:
        return None
    sight = found[0][0]
    line = f"I will remember: the {name} is {SAID_AS.get(state, state)}."
    change = replace(change, seen=(replace(sight, states=_with(sight.states, state)),))
    asks = [f"Should I {offer}?"] if offer else []  # "the plate is filthy" may ask for it
    return ToldPlace(answer(line, *asks, look=offer), change, STATE_TOLD)


def _state_said(words: Sequence[str]) -> str:
    """Return the state that words say a thing is in, "" for none.

    >>> _state_said("i just washed the plate".split()), _state_said("i wash the plate".split())
    ('cleaned', '')
    """
    if words[:1] in (["i"], ["we"], ["i've"], ["we've"]):
        bases = ((word, base_of_deed(word)) for word in words[1:4])
        done = (base for word, base in bases if base and (word != base or word in ("cut", "shut")))
        return deed_kind(deed_verbs().get(next(done, ""), "")).leaves
    seen = request_words().seen if {"is", "are", "'s"} & {*words} else {}
    return next((seen[word] for word in reversed(words) if word in seen), "")


def _with(states: Sequence[str], state: str) -> tuple[str, ...]:
    """Return states with one that has come, as a look shows them: none for "empty"."""
    shown = {"clean": "cleaned", "empty": ""}.get(state, state)
    ended = {"empty": "filled"}.get(state) or ENDS.get(shown)
    kept = [one for one in states if one != ended]
    return tuple(sorted({*kept, shown} - {""}))


def _otherwise() -> frozenset[str]:
    """Return the words by which a statement is not of what is so now."""
    lists = request_words()
    return _NOT_NOW | lists.habits | lists.negations | lists.needs


def _thing_and_place(request: Request) -> tuple[Mention | None, Mention | None]:
    words = request.text.lower().replace("n't", " n't").split()
    named = [one for one in request.alone if one.types]
    if len(named) != 2 or _otherwise() & {word.strip(".,!") for word in words}:
        return None, None
    thing, place = named
    return (thing, place) if can_lie_in(thing, place) else (None, None)
