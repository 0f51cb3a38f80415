"""Draw a request of one kind from a home as it is, with what is right.

A request is drawn only where its words pick out exactly what is meant, in the truth and among what
the robot has seen on its rounds; else another one is tried, and after some tries none is drawn.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np

from karma.household.places import HAND
from karma.household.saying import plural_of
from karma.household.types import object_types
from karma.plugins.homes.lived.request import (
    HomeView,
    LivedKind,
    LivedRequest,
    meant_by,
    place_phrase,
    request_forms,
    room_phrase,
    thing_word,
)
from karma.plugins.homes.types import Asked, Deed, Sighting
from karma.plugins.rules.language.clock import span_of, spans
from karma.plugins.rules.language.lexemes import takes_article

T = TypeVar("T")
TRIES = 24
ERRANDS = 0.5  # share of requests that ask for a deed where both would do
ABOUT_S = 3_600.0  # how exact a time must be told
MOVES = ("PutObject", "PickupObject")
KNOWN_BY = (*MOVES, "CleanObject", "SliceObject", "DirtyObject")


class _NoOccasionError(Exception):
    """This try came to nothing; another one may not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _RequestDraw:
    """One try: the home as it is, and the draws."""

    view: HomeView
    rng: np.random.Generator
    last: Mapping[str, Sighting]  # seen on rounds, by id
    speaker: str

    def pick(self, items: Sequence[T]) -> T:
        """Return one of some things."""
        _need(items)
        return items[int(self.rng.integers(len(items)))]

    @property
    def types(self) -> list[str]:
        """Types of the movable things that the home has."""
        return sorted({one.object_type for one in self.view.now.values()})

    def of_type(self, object_type: str) -> list[Sighting]:
        """Return the things of a type."""
        return [one for one in self.view.now.values() if one.object_type == object_type]

    def is_alone(self, object_type: str) -> bool:
        """Return whether the home has one thing of a type."""
        return len(self.of_type(object_type)) == 1

    def word(self, object_type: str) -> str:
        """Return a word for a type that fits nothing else in the home."""
        found = thing_word(object_type, self.types, self.rng, words=self.view.words)
        _need(found)
        return str(found)

    def request(
        self, kind: LivedKind, asked: Asked, form: str, words: dict[str, str],
        things: Sequence[Sighting | Deed] = (), **truth: Any,
    ) -> LivedRequest:  # fmt: skip
        """Return a request in one of the sentences of a form, about things of one type."""
        text = self.pick(getattr(request_forms(), form).forms).format(**words)
        named = {"object_type": things[0].object_type} if things else {}
        return LivedRequest(
            text=text if text.startswith("I ") else text[0].upper() + text[1:],
            speaker=self.speaker, kind=kind, asked=asked, time_s=self.view.time_s,
            object_ids=tuple(one.object_id for one in things), **named | truth,
        )  # fmt: skip


def _need(occasion: object) -> None:
    """End the try where there is no occasion for the request."""
    if not occasion:
        raise _NoOccasionError


def draw_request(view: HomeView, kind: LivedKind, rng: np.random.Generator) -> LivedRequest | None:
    """Return a request of a kind; None where the home offers none now."""
    last = {seen.object_id: seen for moment in view.seen for seen in moment.seen}
    speaker = view.people[int(rng.integers(len(view.people)))] if view.people else "Ann"
    draw = _RequestDraw(view=view, rng=rng, last=last, speaker=speaker)
    for _ in range(TRIES):
        with suppress(_NoOccasionError):
            return _KINDS[kind](draw)
    return None


# ----------------------------------------------------------------- the thing itself


def _ask_for_the_only(draw: _RequestDraw, kind: LivedKind) -> LivedRequest:
    """Ask for the only thing of its type, still there or not."""
    alone = [
        one
        for one in draw.view.now.values()
        if one.place_id != HAND
        and one.object_id in draw.last
        and (draw.last[one.object_id].place_id == one.place_id) == (kind == "exact")
        and draw.is_alone(one.object_type)
        and one.place_id in draw.view.places
    ]
    thing = draw.pick(alone)
    return _about(draw, kind, _the(draw.word(thing.object_type)), thing)


def _unseen(draw: _RequestDraw) -> LivedRequest:
    """Ask for what this home has none of, and whose words fit nothing that it has."""
    absent = [
        name
        for name, kind in object_types().items()
        if kind.can("pickupable") and name not in draw.types and not kind.made_by_slicing
        and name not in {one.object_type for one in draw.last.values()}
    ]  # fmt: skip
    name = draw.pick(sorted(absent))
    words = {"thing": _the(draw.word(name))}
    return draw.request("unseen", "place", "place", words, object_type=name, unknown=True)


def _attribute(draw: _RequestDraw) -> LivedRequest:
    """Ask for the dirty one, or the clean one, of several."""
    name = draw.pick(draw.types)
    _need(object_types()[name].can("dirtyable"))
    things = draw.of_type(name)
    state = draw.pick(("dirty", "clean"))
    fitting = [one for one in things if ("dirty" in one.states) == (state == "dirty")]
    _need(len(things) > 1 and len(fitting) == 1 and fitting[0].place_id in draw.view.places)
    seen = [draw.last[one.object_id] for one in things if one.object_id in draw.last]
    alike = [one for one in seen if ("dirty" in one.states) == (state == "dirty")]
    _need([one.object_id for one in alike] == [fitting[0].object_id])
    return _about(draw, "attribute", f"the {state} {draw.word(name)}", fitting[0])


def _place(draw: _RequestDraw) -> LivedRequest:
    """Have the one thing of its type that lies at a place brought elsewhere."""
    view = draw.view
    thing = draw.pick([one for one in draw.last.values() if one.object_id in view.now])
    _need(thing.place_id in view.places)
    place = view.places[str(thing.place_id)]
    there = set(meant_by(place, view.places))
    alike = draw.of_type(thing.object_type)
    mine = [one for one in alike if one.place_id in there]
    seen = [
        one.object_id
        for one in draw.last.values()
        if one.object_type == thing.object_type and one.place_id in there
    ]
    _need(len(alike) > 1 and [one.object_id for one in mine] == seen == [thing.object_id])
    said = f"{_the(draw.word(thing.object_type))} {place_phrase(place, view.places)}"
    return _errand(draw, "place", said, mine[0])


# ----------------------------------------------------------------- what happened


def _witnessed(draw: _RequestDraw) -> list[Deed]:
    """Return the deeds of residents that the robot saw on rounds and waits."""
    return [
        moment.deed
        for moment in draw.view.seen
        if moment.deed is not None
        and moment.deed.who in draw.view.people
        and moment.deed.action in KNOWN_BY
    ]


def _event(draw: _RequestDraw) -> LivedRequest:
    """Ask for a thing by what somebody did to it."""
    said, deed = _by_deed(draw)
    now = draw.view.now[deed.object_id]
    _need(now.place_id in draw.view.places)
    return _about(draw, "event", said, now, named=said.startswith("the "))


def _by_deed(draw: _RequestDraw) -> tuple[str, Deed]:
    """Return words for a thing by a deed that picks it out, and the deed."""
    view = draw.view
    deed = draw.pick(_witnessed(draw))
    _need(deed.object_id in view.now)
    span = span_of(deed.time_s, view.time_s)
    if span is None:
        raise _NoOccasionError
    same = {
        one.object_id
        for one in view.log
        if one.who == deed.who and one.action == deed.action
        and one.object_type == deed.object_type and span.after_s <= one.time_s <= span.before_s
    }  # fmt: skip
    _need(same == {deed.object_id})
    word = draw.word(deed.object_type)
    verb = draw.pick(request_forms().did[deed.action])
    return f"{_the(word)} that {_called(draw, deed.who)} {verb} {span.words}", deed


def _called(draw: _RequestDraw, who: str) -> str:
    return "I" if who == draw.speaker else who


def _time(draw: _RequestDraw) -> LivedRequest:
    """Ask where a thing was, when somebody had it, or who moved it."""
    return (_where_then, _when, _who)[int(draw.rng.integers(3))](draw)


def _where_then(draw: _RequestDraw) -> LivedRequest:
    view = draw.view
    span = draw.pick([one for one in spans(view.time_s) if one.before_s < view.time_s - ABOUT_S])
    seen = {
        one.object_id: one
        for moment in view.seen
        if span.after_s <= moment.time_s <= span.before_s
        for one in moment.seen
    }
    thing = draw.pick(sorted(seen.values(), key=lambda one: one.object_id))
    _need(thing.place_id in view.places)
    _need(draw.is_alone(thing.object_type) and thing.object_id in view.now)
    moved = any(
        deed.object_id == thing.object_id and deed.action in MOVES
        and span.after_s <= deed.time_s <= span.before_s
        for deed in view.log
    )  # fmt: skip
    _need(not moved)
    words = {"thing": _the(draw.word(thing.object_type)), "span": span.words}
    return draw.request(
        "time", "place", "place_then", words, [thing], places=(str(thing.place_id),),
        room=thing.room, after_s=span.after_s, before_s=span.before_s,
    )  # fmt: skip


def _when(draw: _RequestDraw) -> LivedRequest:
    view = draw.view
    deed = draw.pick(_witnessed(draw))
    _need(deed.object_id in view.now and draw.is_alone(deed.object_type))
    later = [
        one.time_s
        for one in view.log
        if one.who == deed.who and one.action == deed.action and one.object_id == deed.object_id
    ]
    _need(max(later) == deed.time_s)
    thing, verb = _the(draw.word(deed.object_type)), draw.pick(request_forms().do[deed.action])
    words = {"thing": thing, "who": _called(draw, deed.who), "do": verb}
    ends = {"after_s": deed.time_s - ABOUT_S, "before_s": deed.time_s + ABOUT_S}
    return draw.request("time", "time", "time", words, [deed], **ends)


def _who(draw: _RequestDraw) -> LivedRequest:
    view = draw.view
    _need(len(view.people) > 1)
    deed = draw.pick([one for one in _witnessed(draw) if one.action == "PutObject"])
    _need(deed.object_id in view.now)
    moves = [one for one in view.log if one.object_id == deed.object_id and one.action in MOVES]
    _need(moves[-1].time_s == deed.time_s and draw.is_alone(deed.object_type))
    words = {"thing": _the(draw.word(deed.object_type))}
    return draw.request("time", "who", "who", words, [deed], who=deed.who)


# ----------------------------------------------------------------- several


def _count(draw: _RequestDraw) -> LivedRequest:
    """Ask how many of a type there are in a room or at a place."""
    view = draw.view
    name = draw.pick(draw.types)
    things = draw.of_type(name)
    _need(all(one.object_id in draw.last for one in things))
    thing = draw.pick([one for one in things if one.place_id in view.places])
    place = view.places[str(thing.place_id)]
    if draw.rng.random() < 0.5:
        ids, at = set(meant_by(place, view.places)), place_phrase(place, view.places)
    else:
        ids = {one.place_id for one in view.places.values() if one.room_kind == place.room_kind}
        at = f"in the {room_phrase(place.room_kind)}"
    truth = [one for one in things if one.place_id in ids]
    seen = [draw.last[one.object_id] for one in things]
    _need(len(truth) == sum(one.place_id in ids for one in seen))
    _need(len(truth) > 1 or draw.rng.random() >= 0.6)  # else nearly all counts were one
    word = draw.word(name)
    _need(takes_article(word))
    return draw.request(
        "count", "count", "count", {"things": plural_of(word), "at": at}, truth, object_type=name,
        count=len(truth), places=tuple(sorted(ids)), room=place.room,
    )  # fmt: skip


def _several(draw: _RequestDraw) -> LivedRequest:
    """Have a thing brought to where another thing is; one of them may be known by a deed."""
    view = draw.view
    alone = [
        one
        for one in view.now.values()
        if one.object_id in draw.last and draw.is_alone(one.object_type)
    ]
    other = draw.pick(
        [
            one
            for one in alone
            if one.place_id in view.places and not view.places[str(one.place_id)].openable
        ]
    )
    beside = draw.word(other.object_type)
    _need(takes_article(beside))
    if draw.rng.random() < 0.5:
        said, deed = _by_deed(draw)
        thing = view.now[deed.object_id]
    else:
        thing = draw.pick(alone)
        said = _the(draw.word(thing.object_type))
    _need(thing.object_id != other.object_id)
    place = view.places[str(other.place_id)]
    types = object_types()
    _need(thing.place_id != place.place_id and thing.place_id in view.places)
    _need(types[thing.object_type].fits(types[place.place_type]))
    _need(view.takes(thing.object_id, place.place_id))
    words = {"thing": said, "to": f"where the {beside} is"}
    destinations = (place.place_id,)
    return draw.request("several", "errand", "errand", words, [thing], destinations=destinations)


# ----------------------------------------------------------------- words


def _about(
    draw: _RequestDraw, kind: LivedKind, said: str, thing: Sighting, *, named: bool = True
) -> LivedRequest:
    """Return a question for a thing's place, or an errand with it."""
    if named and draw.rng.random() < ERRANDS:
        return _errand(draw, kind, said, thing)
    truth = {"places": (str(thing.place_id),), "room": thing.room}
    return draw.request(kind, "place", "place", {"thing": said}, [thing], **truth)


def _errand(draw: _RequestDraw, kind: LivedKind, said: str, thing: Sighting) -> LivedRequest:
    """Return an errand with a thing that is not where it shall go yet."""
    view, types = draw.view, object_types()
    goals = [
        place
        for place in view.places.values()
        if not place.openable and types[thing.object_type].fits(types[place.place_type])
    ]
    goal = draw.pick(goals)
    meant = meant_by(goal, view.places)
    _need(thing.place_id not in meant)
    _need(all(view.takes(thing.object_id, place_id) for place_id in meant[:1]))
    words = {"thing": said, "to": place_phrase(goal, view.places)}
    return draw.request(kind, "errand", "errand", words, [thing], destinations=meant)


def _the(word: str) -> str:
    return f"the {word}" if takes_article(word) else word


_KINDS: Mapping[LivedKind, Callable[[_RequestDraw], LivedRequest]] = {
    "exact": partial(_ask_for_the_only, kind="exact"),
    "attribute": _attribute,
    "event": _event,
    "time": _time,
    "place": _place,
    "count": _count,
    "several": _several,
    "changed": partial(_ask_for_the_only, kind="changed"),
    "unseen": _unseen,
}
