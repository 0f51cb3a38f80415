"""What a day in a home leaves behind."""

from dataclasses import dataclass


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
