"""Requests of residents: their words, when they come, what is right, and what a day came to."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, get_args

import msgspec
import numpy as np

from karma.files import read_toml
from karma.household.places import ON_TOP
from karma.household.types import in_words
from karma.plugins.homes.memory.setting import KnownPlace
from karma.plugins.homes.types import Asked, Deed, HomeAnswer, HomeMoment, Sighting
from karma.plugins.rules.language.lexemes import lexicon, pick_common, types_called, unseen_lexicon
from karma.seeds import stream

FORMS = Path(__file__).with_name("forms.toml")

LivedKind = Literal[
    "exact",  # a thing named plainly, still where it was last seen
    "attribute",  # its state tells it from others of its type
    "event",  # known by what somebody did to it
    "time",  # where it was, when somebody had it, who
    "place",  # known by where it is
    "count",
    "several",  # two memories are needed
    "changed",  # named plainly, and no more where it was last seen
    "unseen",  # there is none in this home: right is to say so
]

Words = Literal["known", "held-out", "plain"]  # names of training, names never trained, commonest


@dataclass(frozen=True, slots=True, kw_only=True)
class LivedRequest:
    """A request and what is right."""

    text: str
    speaker: str
    kind: LivedKind
    asked: Asked
    time_s: float  # when it was said
    object_type: str = ""  # of what is meant; "" where words name no type
    object_ids: tuple[str, ...] = ()  # any of these is meant
    places: tuple[str, ...] = ()  # ids of receptacles that are right answers
    room: str = ""  # of those
    after_s: float | None = None  # a time within these is a right answer
    before_s: float | None = None
    count: int | None = None
    who: str = ""
    unknown: bool = False  # right is to say that it is not known
    destinations: tuple[str, ...] = ()  # of an errand: ids of receptacles, any of them


@dataclass(frozen=True, slots=True, kw_only=True)
class HomeView:
    """All that requests are drawn from at one time; deeds and moments of before, none of after."""

    time_s: float
    people: tuple[str, ...]
    places: Mapping[str, KnownPlace]
    log: Sequence[Deed]  # the truth
    seen: Sequence[HomeMoment]  # what the robot learnt on rounds and waits, whatever its memory
    now: Mapping[str, Sighting]  # the truth of movable things
    start: Mapping[str, Sighting]  # the same at the first midnight
    takes: Callable[[str, str], bool]  # whether a place, by id, has room for a thing, by id
    words: Words = "known"


# ----------------------------------------------------------------- sentences, verbs and names


class _FormsOfKind(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    forms: tuple[str, ...]


class RequestForms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of `forms.toml`."""

    place: _FormsOfKind
    errand: _FormsOfKind
    place_then: _FormsOfKind
    time: _FormsOfKind
    who: _FormsOfKind
    count: _FormsOfKind
    did: Mapping[str, tuple[str, ...]]  # action -> verbs, past
    do: Mapping[str, tuple[str, ...]]  # action -> verbs, after "did"


@cache
def request_forms() -> RequestForms:
    """Return the table, read once."""
    return read_toml(FORMS, RequestForms)


def thing_word(
    object_type: str, present: Iterable[str], rng: np.random.Generator, *, words: Words
) -> str | None:
    """Return a word for a type that fits no other type of the home; None if there is none."""
    if words == "plain":
        return in_words(object_type)
    table = unseen_lexicon() if words == "held-out" else lexicon()
    entry = table.get(object_type)
    if entry is None:
        return in_words(object_type)
    others = set(present) - {object_type}
    names = tuple(
        one
        for one in entry.names
        if not others & set(types_called(one)) and not one.startswith("the ")
    )
    return pick_common(rng, names) if names else None


def place_phrase(place: KnownPlace, places: Mapping[str, KnownPlace]) -> str:
    """Return a place as people say it: its kind, and its room where others have one too.

    >>> here = KnownPlace(place_id="a", place_type="CoffeeTable", room="living_1",
    ...     room_kind="living", openable=False)
    >>> place_phrase(here, {"a": here})
    'on the coffee table'
    """
    return f"{'on' if place.place_type in ON_TOP else 'in'} the {_called(place, places)}"


def _called(place: KnownPlace, places: Mapping[str, KnownPlace]) -> str:
    name = in_words(place.place_type)
    rooms = {one.room for one in places.values() if one.place_type == place.place_type}
    if len(rooms) == 1:
        return name
    return f"{name} in the {room_phrase(place.room_kind)}"


def room_phrase(kind: str) -> str:
    """Return a kind of room as people say it."""
    return "living room" if kind == "living" else kind


def meant_by(place: KnownPlace, places: Mapping[str, KnownPlace]) -> tuple[str, ...]:
    """Return the ids of all places that its phrase may mean."""
    rooms = {one.room for one in places.values() if one.place_type == place.place_type}
    return tuple(
        one.place_id
        for one in places.values()
        if one.place_type == place.place_type
        and (len(rooms) == 1 or one.room_kind == place.room_kind)
    )


# ----------------------------------------------------------------- judged by the truth alone


def answered_rightly(
    request: LivedRequest, answer: HomeAnswer, now: Mapping[str, Sighting]
) -> bool:
    """Return whether a question was answered rightly.

    The request has the truth when it was asked, `now` when it was answered: what was moved
    meanwhile may be told by either.
    """
    if request.unknown or answer.unknown:
        return request.unknown and answer.unknown
    match request.asked:
        case "place":
            right = {*request.places, *(now[one].place_id for one in _here(request, now))}
            return answer.place_id is not None and answer.place_id in right
        case "count":
            return answer.count == request.count
        case "who":
            return answer.who == request.who
        case "time":
            return _within(request, answer.time_s)
        case _:
            return False


def room_right(request: LivedRequest, answer: HomeAnswer, now: Mapping[str, Sighting]) -> bool:
    """Return whether at least the room of an answer is right."""
    if request.unknown or answer.unknown:
        return request.unknown and answer.unknown
    rooms = {request.room} | {now[one].room for one in _here(request, now)}
    return bool(answer.room) and answer.room in rooms


def done(request: LivedRequest, now: Mapping[str, Sighting]) -> bool:
    """Return whether an errand is done: what was meant is where it was to be."""
    return any(
        now[one].place_id in request.destinations for one in request.object_ids if one in now
    )


def _here(request: LivedRequest, now: Mapping[str, Sighting]) -> list[str]:
    """Return the things whose place of now is a right answer too: those asked for as of now."""
    if request.before_s is not None:  # it was asked where a thing was
        return []
    return [one for one in request.object_ids if one in now]


def _within(request: LivedRequest, time_s: float | None) -> bool:
    if time_s is None or request.after_s is None or request.before_s is None:
        return False
    return request.after_s <= time_s <= request.before_s


# ----------------------------------------------------------------- when they come


DAY_S = 86_400.0
HOUR_S = 3_600.0
MOST_PEOPLE = 4
ROUNDS_H = (9.0, 17.5)  # when the robot walks through all rooms
REQUESTS_H = (9.75, 21.75)  # within which it is asked
KINDS: tuple[LivedKind, ...] = get_args(LivedKind)


@dataclass(frozen=True, slots=True, kw_only=True)
class DayItem:
    """Something that the robot is to do at a time."""

    time_s: float
    what: str  # "round", "wait" or "request"
    kind: LivedKind | None = None  # of a request
    room: str = ""  # to wait in


def drawn_people(seed: int, home: int, rooms: int) -> int:
    """Return how many people live in a home: small homes have fewer."""
    most = min(MOST_PEOPLE, 1 + rooms // 2)
    return int(stream(seed, "lived", "people", str(home)).integers(1, most + 1))


def day_plan(
    seed: int, home: int, day: int, rooms: tuple[str, ...], requests: int
) -> tuple[DayItem, ...]:
    """Return what a day asks of the robot, in order.

    Kinds take turns, so that a week has as many of each; the room to wait in changes every hour.
    """
    rng = stream(seed, "lived", "day", str(home), str(day))
    start = day * DAY_S
    plan = [DayItem(time_s=start + hour * HOUR_S, what="round") for hour in ROUNDS_H]
    for waits_h in range(7, 23):
        room = rooms[int(rng.integers(len(rooms)))]
        plan.append(DayItem(time_s=start + (waits_h + 0.1) * HOUR_S, what="wait", room=room))
    first, last = REQUESTS_H
    hours = sorted(float(hour) for hour in rng.uniform(first, last, size=requests))
    turn = [KINDS[(day * requests + number) % len(KINDS)] for number in range(requests)]
    order = rng.permutation(requests)
    for hour, which in zip(hours, order, strict=True):
        kind = turn[int(which)]
        plan.append(DayItem(time_s=start + hour * HOUR_S, what="request", kind=kind))
    return tuple(sorted(plan, key=lambda one: one.time_s))


# ----------------------------------------------------------------- what a day leaves behind


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedDoubt:
    """What a memory thought of one of its facts, and what was so."""

    holds: float | None  # None: the design has no notion of it
    was_so: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ServedRequest:
    """One request and what came of it; counts of actions are of the world's."""

    kind: str
    asked: str
    text: str
    time_s: float
    right: bool
    unknown: bool  # it said that it does not know, or gave up
    room_right: bool | None  # of a question for a place: at least the room was right
    actions: int
    places: int  # looked at
    wasted: int  # of them, in vain
    believed: int  # of them, because memory said so
    stale: int  # of these, in vain
    stale_actions: int  # spent on those
    repairs: int  # plans made anew
    tokens: int  # of facts
    recalls: int
    read: bool  # the reader found what is asked, and the type that is meant
    knew: bool | None = None  # memory had the thing where it was when asked for; None: none is
    known_s: float | None = None  # when the robot saw it there last; None: it did not
    doubts: tuple[CheckedDoubt, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class LivedRecord:
    """One day of one row in one home; the same in every run of the same experiment."""

    row: str
    task: str  # "usual/home_003/day_2"
    seed: int
    success: bool  # every request of the day was served rightly
    end: str
    setting: str
    home: int
    day: int
    rooms: int
    people: int
    things: int  # movable
    moved: float  # share of them that residents moved that day
    requests: tuple[ServedRequest, ...]
    missing: int  # requests that the home had no occasion for
    round_actions: int
    memory_bytes: int
    units: int  # that short-term memory may have
    error: str = ""
