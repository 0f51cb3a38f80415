"""A request of a resident with its truth, and what requests are drawn from."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from karma.contracts import Asked, Deed, HomeMoment, Sighting
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
