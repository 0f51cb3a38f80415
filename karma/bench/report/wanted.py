"""Where the things were that unmet goals ask for, by the world's truth and not by memory."""

from collections.abc import Sequence
from dataclasses import dataclass

from karma.agent.goals.goals import alternatives, object_names, parse_goal
from karma.agent.goals.objects import ObjectIndex
from karma.agent.seeing.perceive import truth_of
from karma.contracts import Event, TrueObject
from karma.errors import KarmaError
from karma.household.ids import type_of
from karma.household.places import FLOOR

MOST = 8  # things that are told of one name


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedThing:
    """One thing that a name covers, at one moment."""

    object_id: str
    where: str  # what it is in or on, from the inside out; "in the hand"
    states: tuple[str, ...]
    x_m: float
    z_m: float
    loose: bool  # can be carried


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedName:
    """One name in unmet goals, and what it covers in the room."""

    name: str
    things: tuple[WantedThing, ...]  # at most `MOST`, those that can be carried first
    count: int  # of all


def names_in(goals: Sequence[str]) -> tuple[str, ...]:
    """Return the names of objects in goals, each once; none of a goal that cannot be read."""
    found: dict[str, None] = {}
    for text in goals:
        try:
            found.update(dict.fromkeys(object_names(parse_goal(text))))
        except KarmaError:
            continue  # of somebody else's benchmark
    return tuple(found)


def wanted_in(event: Event, names: Sequence[str]) -> tuple[WantedName, ...]:
    """Return for each name what it covers after an event."""
    index = ObjectIndex(truth_of(event))
    return tuple(_wanted(name, index) for name in names)


def _wanted(name: str, index: ObjectIndex) -> WantedName:
    found = sorted(
        index.named(alternatives(name)), key=lambda one: (not one.pickupable, one.object_id)
    )
    things = tuple(_thing(one, index) for one in found[:MOST])
    return WantedName(name=name, things=things, count=len(found))


def _thing(one: TrueObject, index: ObjectIndex) -> WantedThing:
    x, _, z = one.box_center_m
    return WantedThing(
        object_id=one.object_id,
        where=_where(one, index),
        states=one.states,
        x_m=round(x, 2),
        z_m=round(z, 2),
        loose=one.pickupable,
    )


def _where(one: TrueObject, index: ObjectIndex) -> str:
    """Return what a thing is in or on, and what that is in or on: "Bowl, Fridge (closed)"."""
    if one.object_id in index.held:
        return "in the hand"
    words, seen, here = [], {one.object_id}, one
    while parents := [p for p in here.parent_ids if p in index.by_id and p not in seen]:
        here = index.by_id[parents[0]]
        seen.add(here.object_id)
        if here.object_id in index.held:
            words.append(f"{type_of(here.object_id)} in the hand")
            break
        if words and here.object_type == FLOOR:
            break
        state = [word for word in ("closed", "opened") if word in here.states]
        words.append(type_of(here.object_id) + (f" ({state[0]})" if state else ""))
    return "at " + ", ".join(words) if words else ""
