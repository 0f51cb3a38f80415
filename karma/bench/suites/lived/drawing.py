"""Draw a request of one kind from a home as it is, with what is right.

A request is drawn only where its words pick out exactly what is meant, in the truth and among what
the robot has seen on its rounds; else another one is tried, and after some tries none is drawn.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from karma.bench.suites.lived.forms import (
    meant_by,
    of_type,
    place_phrase,
    request_forms,
    room_phrase,
    thing_word,
)
from karma.bench.suites.lived.request import HomeView, LivedKind, LivedRequest
from karma.contracts import Deed, Sighting
from karma.household.places import HAND
from karma.household.saying import plural_of
from karma.household.types import object_types
from karma.language.clock import span_of, spans
from karma.language.lexemes import takes_article
from karma.memory.lived.setting import KnownPlace

T = TypeVar("T")
TRIES = 24
ERRANDS = 0.5  # share of requests that ask for a deed where both would do
ABOUT_S = 3_600.0  # how exact a time must be told
KNOWN_BY = ("PutObject", "PickupObject", "CleanObject", "SliceObject", "DirtyObject")


@dataclass(frozen=True, slots=True, kw_only=True)
class _RequestDraw:
    """One try: the home as it is, and the draws."""

    view: HomeView
    rng: np.random.Generator
    last: Mapping[str, Sighting]  # seen on rounds, by id

    def pick(self, items: Sequence[T]) -> T | None:
        """Return one of some things; None of none."""
        return items[int(self.rng.integers(len(items)))] if items else None

    @property
    def types(self) -> list[str]:
        """Types of the movable things that the home has."""
        return sorted({one.object_type for one in self.view.now.values()})


def draw_request(view: HomeView, kind: LivedKind, rng: np.random.Generator) -> LivedRequest | None:
    """Return a request of a kind; None where the home offers none now."""
    last = {seen.object_id: seen for moment in view.seen for seen in moment.seen}
    draw = _RequestDraw(view=view, rng=rng, last=last)
    speaker = draw.pick(view.people) or "Ann"
    for _ in range(TRIES):
        found = _KINDS[kind](draw, speaker)
        if found is not None:
            return found
    return None


# ----------------------------------------------------------------- the thing itself


def _exact(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    return _named(draw, speaker, "exact")


def _changed(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    return _named(draw, speaker, "changed")


def _named(draw: _RequestDraw, speaker: str, kind: LivedKind) -> LivedRequest | None:
    """Ask for the only thing of its type, still there or not."""
    now = draw.view.now
    alone = [
        one
        for one in now.values()
        if one.place_id != HAND
        and one.object_id in draw.last
        and (draw.last[one.object_id].place_id == one.place_id) == (kind == "exact")
        and len(of_type(now, one.object_type)) == 1
        and one.place_id in draw.view.places
    ]
    thing = draw.pick(alone)
    if thing is None:
        return None
    word = thing_word(thing.object_type, draw.types, draw.rng, words=draw.view.words)
    return (word and _about(draw, speaker, kind, _the(word), (thing,))) or None


def _unseen(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    """Ask for what this home has none of, and whose words fit nothing that it has."""
    types = object_types()
    absent = [
        name
        for name, kind in types.items()
        if kind.can("pickupable") and name not in draw.types and not kind.made_by_slicing
        and name not in {one.object_type for one in draw.last.values()}
    ]  # fmt: skip
    name = draw.pick(sorted(absent))
    if name is None:
        return None
    word = thing_word(name, draw.types, draw.rng, words=draw.view.words)
    if word is None:
        return None
    text = _say(draw, "place", thing=_the(word))
    return LivedRequest(
        text=text, speaker=speaker, kind="unseen", asked="place", time_s=draw.view.time_s,
        object_type=name, unknown=True,
    )  # fmt: skip


def _attribute(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    """Ask for the dirty one, or the clean one, of several."""
    name = draw.pick(draw.types)
    if name is None or not object_types()[name].can("dirtyable"):
        return None
    things = of_type(draw.view.now, name)
    state = draw.pick(("dirty", "clean"))
    fitting = [one for one in things if ("dirty" in one.states) == (state == "dirty")]
    if len(things) < 2 or len(fitting) != 1 or fitting[0].place_id not in draw.view.places:
        return None
    seen = [draw.last[one.object_id] for one in things if one.object_id in draw.last]
    alike = [one for one in seen if ("dirty" in one.states) == (state == "dirty")]
    if [one.object_id for one in alike] != [fitting[0].object_id]:
        return None
    word = thing_word(name, draw.types, draw.rng, words=draw.view.words)
    if word is None:
        return None
    return _about(draw, speaker, "attribute", f"the {state} {word}", (fitting[0],))


def _place(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    """Have the one thing of its type that lies at a place brought elsewhere."""
    view = draw.view
    thing = draw.pick([one for one in draw.last.values() if one.object_id in view.now])
    if thing is None or thing.place_id not in view.places:
        return None
    phrase = view.places[str(thing.place_id)]
    there = set(meant_by(phrase, view.places))
    alike = of_type(view.now, thing.object_type)
    mine = [one for one in alike if one.place_id in there]
    seen = [
        one
        for one in draw.last.values()
        if one.object_type == thing.object_type and one.place_id in there
    ]
    if len(alike) < 2 or len(mine) != 1 or [one.object_id for one in seen] != [thing.object_id]:
        return None
    if mine[0].object_id != thing.object_id:
        return None
    word = thing_word(thing.object_type, draw.types, draw.rng, words=view.words)
    if word is None:
        return None
    said = f"{_the(word)} {place_phrase(phrase, view.places)}"
    return _errand(draw, speaker, "place", said, (mine[0],))


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


def _event(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    """Ask for a thing by what somebody did to it."""
    found = _by_deed(draw, speaker)
    if found is None:
        return None
    said, deed = found
    now = draw.view.now.get(deed.object_id)
    if now is None or now.place_id not in draw.view.places:
        return None
    return _about(draw, speaker, "event", said, (now,), named=said.startswith("the "))


def _by_deed(draw: _RequestDraw, speaker: str) -> tuple[str, Deed] | None:
    """Return words for a thing by a deed that picks it out, and the deed."""
    view = draw.view
    deed = draw.pick(_witnessed(draw))
    if deed is None or deed.object_id not in view.now:
        return None
    span = span_of(deed.time_s, view.time_s)
    if span is None:
        return None
    same = {
        one.object_id
        for one in view.log
        if one.who == deed.who and one.action == deed.action
        and one.object_type == deed.object_type and span.after_s <= one.time_s <= span.before_s
    }  # fmt: skip
    if same != {deed.object_id}:
        return None
    word = thing_word(deed.object_type, draw.types, draw.rng, words=view.words)
    if word is None:
        return None
    who = "I" if deed.who == speaker else deed.who
    verb = draw.pick(request_forms().did[deed.action])
    return f"{_the(word)} that {who} {verb} {span.words}", deed


def _time(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    """Ask where a thing was, when somebody had it, or who moved it."""
    which = int(draw.rng.integers(3))
    return (_where_then, _when, _who)[which](draw, speaker)


def _where_then(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    view = draw.view
    span = draw.pick([one for one in spans(view.time_s) if one.before_s < view.time_s - ABOUT_S])
    if span is None:
        return None
    seen = {
        one.object_id: one
        for moment in view.seen
        if span.after_s <= moment.time_s <= span.before_s
        for one in moment.seen
    }
    thing = draw.pick(sorted(seen.values(), key=lambda one: one.object_id))
    if thing is None or thing.place_id not in view.places:
        return None
    if len(of_type(view.now, thing.object_type)) != 1 or thing.object_id not in view.now:
        return None
    if any(
        deed.object_id == thing.object_id and deed.action in ("PickupObject", "PutObject")
        and span.after_s <= deed.time_s <= span.before_s
        for deed in view.log
    ):  # fmt: skip
        return None
    word = thing_word(thing.object_type, draw.types, draw.rng, words=view.words)
    if word is None:
        return None
    return LivedRequest(
        text=_say(draw, "place_then", thing=_the(word), span=span.words),
        speaker=speaker, kind="time", asked="place", time_s=view.time_s,
        object_type=thing.object_type, object_ids=(thing.object_id,), places=(str(thing.place_id),),
        room=thing.room, after_s=span.after_s, before_s=span.before_s,
    )  # fmt: skip


def _when(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    view = draw.view
    deed = draw.pick(_witnessed(draw))
    if deed is None or deed.object_id not in view.now:
        return None
    if len(of_type(view.now, deed.object_type)) != 1:
        return None
    later = [
        one.time_s
        for one in view.log
        if one.who == deed.who and one.action == deed.action and one.object_id == deed.object_id
    ]
    if max(later) != deed.time_s:
        return None
    word = thing_word(deed.object_type, draw.types, draw.rng, words=view.words)
    if word is None:
        return None
    who = "I" if deed.who == speaker else deed.who
    verb = draw.pick(request_forms().do[deed.action])
    return LivedRequest(
        text=_say(draw, "time", thing=_the(word), who=who, do=str(verb)),
        speaker=speaker, kind="time", asked="time", time_s=view.time_s,
        object_type=deed.object_type, object_ids=(deed.object_id,),
        after_s=deed.time_s - ABOUT_S, before_s=deed.time_s + ABOUT_S,
    )  # fmt: skip


def _who(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    view = draw.view
    if len(view.people) < 2:
        return None
    deed = draw.pick([one for one in _witnessed(draw) if one.action == "PutObject"])
    if deed is None or deed.object_id not in view.now:
        return None
    moves = [
        one
        for one in view.log
        if one.object_id == deed.object_id and one.action in ("PutObject", "PickupObject")
    ]
    if moves[-1].time_s != deed.time_s or len(of_type(view.now, deed.object_type)) != 1:
        return None
    word = thing_word(deed.object_type, draw.types, draw.rng, words=view.words)
    if word is None:
        return None
    return LivedRequest(
        text=_say(draw, "who", thing=_the(word)),
        speaker=speaker, kind="time", asked="who", time_s=view.time_s,
        object_type=deed.object_type, object_ids=(deed.object_id,), who=deed.who,
    )  # fmt: skip


# ----------------------------------------------------------------- several


def _count(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    """Ask how many of a type there are in a room or at a place."""
    view = draw.view
    name = draw.pick(draw.types)
    if name is None:
        return None
    things = of_type(view.now, name)
    if any(one.object_id not in draw.last for one in things):
        return None
    thing = draw.pick([one for one in things if one.place_id in view.places])
    if thing is None:
        return None
    place = view.places[str(thing.place_id)]
    if draw.rng.random() < 0.5:
        ids, at = set(meant_by(place, view.places)), place_phrase(place, view.places)
    else:
        ids = {one.place_id for one in view.places.values() if one.room_kind == place.room_kind}
        at = f"in the {room_phrase(place.room_kind)}"
    truth = [one for one in things if one.place_id in ids]
    seen = [draw.last[one.object_id] for one in things]
    if len(truth) != sum(one.place_id in ids for one in seen):
        return None
    if len(truth) < 2 and draw.rng.random() < 0.6:  # else nearly all counts were one
        return None
    word = thing_word(name, draw.types, draw.rng, words=view.words)
    if word is None or not takes_article(word):
        return None
    return LivedRequest(
        text=_say(draw, "count", things=plural_of(word), at=at),
        speaker=speaker, kind="count", asked="count", time_s=view.time_s, object_type=name,
        object_ids=tuple(one.object_id for one in truth), count=len(truth),
        places=tuple(sorted(ids)), room=place.room,
    )  # fmt: skip


def _several(draw: _RequestDraw, speaker: str) -> LivedRequest | None:
    """Have a thing brought to where another thing is; one of them may be known by a deed."""
    view = draw.view
    other = draw.pick(
        [
            one
            for one in view.now.values()
            if one.object_id in draw.last and one.place_id in view.places
            and len(of_type(view.now, one.object_type)) == 1
            and not view.places[str(one.place_id)].openable
        ]
    )  # fmt: skip
    if other is None:
        return None
    beside = thing_word(other.object_type, draw.types, draw.rng, words=view.words)
    if beside is None or not takes_article(beside):
        return None
    said: str | None = None
    thing: Sighting | None = None
    if draw.rng.random() < 0.5:
        found = _by_deed(draw, speaker)
        if found is not None:
            said, thing = found[0], view.now.get(found[1].object_id)
    else:
        alone = [
            one
            for one in view.now.values()
            if one.object_id in draw.last and len(of_type(view.now, one.object_type)) == 1
        ]
        thing = draw.pick(alone)
        if thing is not None:
            word = thing_word(thing.object_type, draw.types, draw.rng, words=view.words)
            said = _the(word) if word else None
    if thing is None or said is None or thing.object_id == other.object_id:
        return None
    place = view.places[str(other.place_id)]
    types = object_types()
    if thing.place_id == place.place_id or thing.place_id not in view.places:
        return None
    if not types[thing.object_type].fits(types[place.place_type]):
        return None
    if not view.takes(thing.object_id, place.place_id):
        return None
    return LivedRequest(
        text=_say(draw, "errand", thing=said, to=f"where the {beside} is"),
        speaker=speaker, kind="several", asked="errand", time_s=view.time_s,
        object_type=thing.object_type, object_ids=(thing.object_id,),
        destinations=(place.place_id,),
    )  # fmt: skip


# ----------------------------------------------------------------- words


def _about(
    draw: _RequestDraw, speaker: str, kind: LivedKind, said: str, things: tuple[Sighting, ...],
    *, named: bool = True,
) -> LivedRequest | None:  # fmt: skip
    """Return a question for a thing's place, or an errand with it."""
    if named and draw.rng.random() < ERRANDS:
        return _errand(draw, speaker, kind, said, things)
    thing = things[0]
    return LivedRequest(
        text=_say(draw, "place", thing=said),
        speaker=speaker, kind=kind, asked="place", time_s=draw.view.time_s,
        object_type=thing.object_type, object_ids=tuple(one.object_id for one in things),
        places=tuple(str(one.place_id) for one in things), room=thing.room,
    )  # fmt: skip


def _errand(
    draw: _RequestDraw, speaker: str, kind: LivedKind, said: str, things: tuple[Sighting, ...]
) -> LivedRequest | None:
    """Return an errand with things that are not where they shall go yet."""
    view, thing = draw.view, things[0]
    goal = draw.pick(_goals(view, thing))
    if goal is None:
        return None
    meant = meant_by(goal, view.places)
    if any(one.place_id in meant for one in things):
        return None
    if not all(view.takes(thing.object_id, place_id) for place_id in meant[:1]):
        return None
    return LivedRequest(
        text=_say(draw, "errand", thing=said, to=place_phrase(goal, view.places)),
        speaker=speaker, kind=kind, asked="errand", time_s=view.time_s,
        object_type=thing.object_type, object_ids=tuple(one.object_id for one in things),
        destinations=meant,
    )  # fmt: skip


def _goals(view: HomeView, thing: Sighting) -> list[KnownPlace]:
    types = object_types()
    return [
        place
        for place in view.places.values()
        if not place.openable and types[thing.object_type].fits(types[place.place_type])
    ]


def _say(draw: _RequestDraw, form: str, **words: str) -> str:
    """Return a sentence of one of the forms."""
    forms = getattr(request_forms(), form).forms
    text = str(forms[int(draw.rng.integers(len(forms)))]).format(**words)
    return text[0].upper() + text[1:] if not text.startswith("I ") else text


def _the(word: str) -> str:
    return f"the {word}" if takes_article(word) else word


_KINDS: Mapping[LivedKind, Callable[[_RequestDraw, str], LivedRequest | None]] = {
    "exact": _exact,
    "attribute": _attribute,
    "event": _event,
    "time": _time,
    "place": _place,
    "count": _count,
    "several": _several,
    "changed": _changed,
    "unseen": _unseen,
}
