"""A request of a resident: what it is drawn from, its truth, and whether an answer is right."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from karma.contracts import Asked, Deed, HomeAnswer, HomeMoment, Sighting
from karma.memory.lived.setting import KnownPlace

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


# ----------------------------------------------------------------- judged by the truth alone


def answered_rightly(
    request: LivedRequest, answer: HomeAnswer, now: Mapping[str, Sighting]
) -> bool:
    """Return whether a question was answered rightly.

    Args:
        request: with the truth when it was asked.
        answer: structured.
        now: truth when it was answered; what was moved meanwhile may be told by either.
    """
    if request.unknown or answer.unknown:
        return request.unknown and answer.unknown
    match request.asked:
        case "place":
            return answer.place_id is not None and answer.place_id in _right_places(request, now)
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


def _right_places(request: LivedRequest, now: Mapping[str, Sighting]) -> set[str | None]:
    return {*request.places, *(now[one].place_id for one in _here(request, now))}


def _here(request: LivedRequest, now: Mapping[str, Sighting]) -> list[str]:
    """Return the things whose place of now is a right answer too: those asked for as of now."""
    if request.before_s is not None:  # it was asked where a thing was
        return []
    return [one for one in request.object_ids if one in now]


def _within(request: LivedRequest, time_s: float | None) -> bool:
    if time_s is None or request.after_s is None or request.before_s is None:
        return False
    return request.after_s <= time_s <= request.before_s
