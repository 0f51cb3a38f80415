"""What a memory's facts say about the thing that a question means.

All designs go through here: the facts that fit the prompt's budget are read as a prompt would be,
and matched with what was said. Nothing is known here that no fact says.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from karma.plugins.homes.memory.setting import (
    KnownPlace,
    has_states,
    is_said_place,
    sighting_text,
    types_meant,
)
from karma.plugins.homes.types import Fact, HomeMemory, HomeQuestion, SaidThing, Sighting

MOST_FACTS = 64  # asked of a memory at once
DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
_TOKEN = re.compile(r"\w+|[^\w\s]")
_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Recollection:
    """The facts that were told for one question, and what they cost."""

    facts: tuple[Fact, ...]
    tokens: int

    def latest(self, object_id: str) -> Fact | None:
        """Return the newest fact about one thing that has not ended."""
        mine = [
            fact
            for fact in self.facts
            if fact.sighting.object_id == object_id and fact.ended_s is None
        ]
        return max(mine, key=lambda fact: fact.sighting.time_s, default=None)


def fact_text(fact: Fact, places: Mapping[str, KnownPlace]) -> str:
    """Return a fact as a line of a prompt.

    >>> from karma.plugins.homes.types import Sighting
    >>> fact_text(Fact(sighting=Sighting(time_s=90_000.0, object_id="a", object_type="Mug",
    ...     place_id=None, room="living_1", position_m=(0, 0, 0)), holds=0.8), {})
    'Tue 01:00 mug, living; 0.80'
    """
    seen = fact.sighting
    words = [clock_text(seen.time_s), sighting_text(seen, places)]
    line = " ".join(words)
    if fact.deed is not None:
        line += f"; {fact.deed.who} {fact.deed.action}"
    return line if fact.holds is None else f"{line}; {fact.holds:.2f}"


def clock_text(time_s: float) -> str:
    """Return a time as day and hour.

    >>> clock_text(3600.0)
    'Mon 01:00'
    """
    day, second = divmod(time_s, _DAY_S)
    minutes = int(second // 60)
    return f"{DAYS[int(day) % 7]} {minutes // 60:02d}:{minutes % 60:02d}"


def recollect(
    memory: HomeMemory,
    question: HomeQuestion,
    places: Mapping[str, KnownPlace],
    *,
    budget_tokens: int,
) -> Recollection:
    """Return as many facts, the most useful first, as the prompt has tokens for.

    Tokens are words and marks, counted alike for all designs.
    """
    told: list[Fact] = []
    spent = 0
    for fact in memory.recall(question, MOST_FACTS):
        tokens = len(_TOKEN.findall(fact_text(fact, places)))
        if spent + tokens > budget_tokens:
            break
        spent += tokens
        told.append(fact)
    return Recollection(facts=tuple(told), tokens=spent)


def fits(
    fact: Fact, said: SaidThing, places: Mapping[str, KnownPlace], *, beside: str | None = None
) -> bool:
    """Return whether a fact is about a thing as it was said.

    `beside`: id of the place where the thing is said to be, with another thing.
    """
    seen = fact.sighting
    types = types_meant(said)
    return (
        (not types or seen.object_type in types)
        and has_states(seen, said)
        and _is_there(seen, said, places)
        and (beside is None or seen.place_id == beside)
        and _happened(fact, said)
    )


def _is_there(seen: Sighting, said: SaidThing, places: Mapping[str, KnownPlace]) -> bool:
    if seen.place_id is not None and seen.place_id in places:
        return is_said_place(places[seen.place_id], said)
    kind = seen.room.rpartition("_")[0]
    return not said.place_types and (not said.room or said.room in (kind, seen.room))


def _happened(fact: Fact, said: SaidThing) -> bool:
    """Return whether a fact is of the time, the person and the deed that were said."""
    deed = fact.deed
    if said.who and (deed is None or deed.who != said.who):
        return False
    if said.action and (deed is None or deed.action != said.action):
        return False
    time_s = fact.sighting.time_s if deed is None else deed.time_s
    if said.after_s is not None and time_s < said.after_s:
        return False
    return said.before_s is None or time_s <= said.before_s


def plain(question: HomeQuestion, said: SaidThing | None = None) -> HomeQuestion:
    """Return the question where a thing is now, without what was said of its past."""
    thing = said or question.thing
    now = replace(
        thing, after_s=None, before_s=None, who="", action="", beside=None, place_types=(), room=""
    )
    return replace(question, asked="place", thing=now, destination=None)


def ids_of(facts: Sequence[Fact]) -> tuple[str, ...]:
    """Return the things that facts are about, the first named first."""
    return tuple(dict.fromkeys(fact.sighting.object_id for fact in facts))
