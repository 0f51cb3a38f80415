"""Nouns of homes with residents: what happens there, what is asked, and what a memory answers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import msgspec

from karma.types.planning import Meaning
from karma.types.space import Vec3


@dataclass(frozen=True, slots=True, kw_only=True)
class Deed:
    """One world action of somebody in a home: a line of the log of truth.

    Times are seconds since the midnight before the first day, a Monday.
    """

    time_s: float
    who: str  # a resident's name, or "robot"
    action: str  # AI2-THOR's name of it
    object_id: str
    object_type: str
    place_id: str | None = None  # receptacle it was taken from, put in or on, or stands in
    room: str = ""  # name of the room
    states: tuple[str, ...] = ()  # words of `State` that are true of the object afterwards
    activity: str = ""  # what it was a part of: "cook", "wash up", "tidy"


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """One object as it was seen at one time, or believed to have been."""

    time_s: float
    object_id: str
    object_type: str
    place_id: str | None  # the nearest receptacle it is in or on; "hand" when held
    room: str
    position_m: Vec3
    states: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class HomeMoment:
    """All that the robot learns at one time: what a memory of a lived-in home is made of."""

    time_s: float
    room: str  # that the robot is in
    seen: tuple[Sighting, ...] = ()
    looked_over: tuple[str, ...] = ()  # receptacles of which it has seen all that is in or on them
    looked_since_s: float | None = None  # since when; None: in this one view
    deed: Deed | None = None  # its own, or a resident's that it saw


@dataclass(frozen=True, slots=True, kw_only=True)
class SaidThing:
    """Something that a question speaks of, as it was read from its words."""

    phrase: str  # "the dirty cup"
    types: tuple[Meaning, ...] = ()  # object types that it may mean, the nearest first
    states: tuple[str, ...] = ()  # words of `State` that it has
    place_types: tuple[str, ...] = ()  # receptacle types that it is, or was, in or on
    room: str = ""  # kind of the room, e.g. "kitchen"; "" not said
    after_s: float | None = None  # when what is said of it was so
    before_s: float | None = None
    who: str = ""  # of the deed that it is known by; "" none is said
    action: str = ""  # AI2-THOR's name of that deed; "" none is said
    beside: "SaidThing | None" = None  # it is, or was, where that other thing is, or was
    ids: tuple[str, ...] = ()  # which things it was found to mean; () not known


Asked = Literal["place", "state", "time", "count", "who", "errand"]


@dataclass(frozen=True, slots=True, kw_only=True)
class HomeQuestion:
    """A request of a resident as it was read: what is asked, of what."""

    text: str
    speaker: str  # whom "I" stands for
    time_s: float  # when it was said
    asked: Asked
    thing: SaidThing
    destination: SaidThing | None = None  # of an errand: where the thing is to be
    unread: tuple[str, ...] = ()  # words that were not understood: nothing is answered without them


@dataclass(frozen=True, slots=True, kw_only=True)
class Fact:
    """What a memory says in answer to a question: a sighting, and how sure it is of it."""

    sighting: Sighting
    deed: Deed | None = None  # that it came about by, where the memory knows one
    holds: float | None = None  # chance that it is still so; None: the memory has no notion of it
    ended_s: float | None = None  # when the memory learnt that it was so no more; None: not so


@dataclass(frozen=True, slots=True, kw_only=True)
class LikelyPlace:
    """Where a thing may be looked for."""

    place_id: str
    chance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class HomeAnswer:
    """A structured answer; `unknown` stands alone."""

    place_id: str | None = None
    place_type: str = ""
    room: str = ""
    states: tuple[str, ...] = ()
    time_s: float | None = None
    count: int | None = None
    who: str = ""
    unknown: bool = False
    unread: tuple[str, ...] = ()  # words of the question that were not understood
    sure: float | None = None  # chance of being right, where that is known


class HomeMemory(Protocol):
    """What a robot keeps of a home where people live: a row of the table of memory designs.

    Made as `made(setting)`, see `karma.plugins.homes.memory.setting.MemorySetting`.
    """

    def take_in(self, moment: HomeMoment) -> None:
        """Learn from one moment; moments come in the order of their times."""

    def recall(self, question: HomeQuestion, k: int) -> Sequence[Fact]:
        """Return at most k facts, the most useful first; the prompt takes as many as fit."""

    def likely_places(self, question: HomeQuestion) -> Sequence[LikelyPlace]:
        """Return where to look for the question's thing, the best first; () without an opinion."""

    def size_bytes(self) -> int:
        """Return how much it keeps."""

    def close(self) -> None:
        """Let go of what it holds."""


class HomeCard(msgspec.Struct, frozen=True, kw_only=True):
    """What stands at the door."""

    scene: str  # what the world is reset to: a name, or a file wherever one stands
    people: int = 0  # who live there while the agent is away
    seed: int = 0  # of their days
