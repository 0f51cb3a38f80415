"""Examples of the sentences that were written by hand, as they stand and with other things in them.

A written sentence says how people ask; which things they ask about is drawn: a thing's name gives
way to that of another which its goals allow. "Pop the apple in the fridge" teaches "pop", and not
apples.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from karma.agent.goals.files import SaidRequest
from karma.agent.planning.expert import ExpertView
from karma.agent.planning.goal_lines import plain_program
from karma.bench.drawing.memories import KnownRoom, Rng, pick
from karma.bench.drawing.requests import suits
from karma.contracts import Goal, MemoryUnit, PlanRequest, RefusedRequest
from karma.household import uses
from karma.household.containment import goes_in
from karma.household.pieces import EGG, base_type, is_piece
from karma.household.places import HAND, landmark_types, likest
from karma.household.states import deed_for
from karma.household.types import object_types
from karma.language.lexemes import lexicon, pick_common
from karma.train.planner.samples import (
    LONGEST,
    TYPOS,
    TrainingExample,
    draw_facts,
    example_of,
    misspelt,
    program_text,
)

OTHER_THINGS = 0.7  # share of sentences in which a thing gives way to another
EMPTY = 0.4  # share of prompts in which nothing is remembered
_KINDS = {"cleaned": "clean", "heated": "heat", "cooled": "cool", "cooked": "cook"}
_KINDS |= {"sliced": "slice", "filled": "fill", "broken": "break"}  # state -> kind of request
_ABLE = {"TOGGLEON": "toggleable", "TOGGLEOFF": "toggleable"}
_ABLE |= {"OPEN": "openable", "CLOSED": "openable"}


def draw_written(
    rng: Rng, room: KnownRoom, sentences: Sequence[SaidRequest], *, mapped: bool
) -> TrainingExample | None:
    """Draw one example with a written sentence, None where the room has none of its places."""
    said = pick(rng, sentences)
    text, goals = said.text, said.wanted
    if goals and rng.random() < OTHER_THINGS:
        text, goals = with_other_things(rng, text, goals, room.landmarks if mapped else ())
    if mapped and (here := _in_room(goals, room.landmarks)) is not None:
        goals = here
    elif mapped:
        return None
    about = frozenset(base_type(name) for goal in goals for name in goal.arguments)
    facts = _without(rng, draw_facts(rng, room, mapped=mapped)[0], about)
    text = misspelt(rng, text) if rng.random() < TYPOS else text
    facts = replace(facts, instruction=text)
    if not goals:
        answer = f"{RefusedRequest(kind=said.kind)}\n"  # type: ignore[arg-type]
        return example_of(f"refuse_{said.kind}", facts, answer)
    calls = plain_program(goals, ExpertView())
    return example_of("written", facts, program_text(calls)) if 0 < len(calls) <= LONGEST else None


def _without(rng: Rng, facts: PlanRequest, about: frozenset[str]) -> PlanRequest:
    """Return what is known without what the sentence is about: it goes by its type's name then."""
    if rng.random() < EMPTY:
        return replace(facts, units=(), held_id=None, held_type=None)

    def kept(unit: MemoryUnit) -> bool:
        return base_type(unit.object_type) not in about and unit.place_id != HAND

    return replace(facts, units=tuple(filter(kept, facts.units)), held_id=None, held_type=None)


def _in_room(goals: Sequence[Goal], landmarks: Sequence[str]) -> tuple[Goal, ...] | None:
    """Return goals with what a room has in place of what it lacks; None where nothing is like it.

    Who is asked for a desk where there is none uses the likest thing.
    """
    here: dict[str, str | None] = {
        name: likest(name, landmarks)
        for goal in goals
        for name in goal.arguments
        if name in landmark_types() and name not in landmarks
    }
    if None in here.values():
        return None
    return tuple(
        replace(goal, arguments=tuple(here.get(name) or name for name in goal.arguments))
        for goal in goals
    )


def with_other_things(
    rng: Rng, text: str, goals: Sequence[Goal], landmarks: Sequence[str] = ()
) -> tuple[str, tuple[Goal, ...]]:
    """Put other things' names into a sentence and its goals, where the goals allow it.

    `landmarks`: what the room has; () for all.
    """
    goals = tuple(goals)
    for kind in sorted({name for goal in goals for name in goal.arguments} & lexicon().keys()):
        if rng.random() < 0.25 or any(goal.count > 1 for goal in goals):
            continue
        named = _named(text, kind)
        others = [
            other
            for other in _alike(kind)
            if all(_allows(goal, kind, other) for goal in goals)
            and (not landmarks or other in landmarks or other not in landmark_types())
            and all(other not in goal.arguments for goal in goals)
        ]
        if named is None or not others:
            continue
        other = pick(rng, others)
        text = named.sub(pick_common(rng, lexicon()[other].names), text)
        goals = tuple(
            replace(g, arguments=tuple(other if one == kind else one for one in g.arguments))
            for g in goals
        )
    return text, goals


def _named(text: str, kind: str) -> re.Pattern[str] | None:
    """Return what finds a type's name in a sentence, the longest that stands there."""
    names = sorted(lexicon()[kind].names, key=len, reverse=True)
    for name in names:
        pattern = re.compile(rf"\b{re.escape(name)}\b", re.IGNORECASE)
        if pattern.search(text):
            return pattern
    return None


@cache
def _alike(kind: str) -> tuple[str, ...]:
    """Return the types that may take a type's place: carried or not as it is, and no pieces."""
    movable = "pickupable" in object_types()[kind].capabilities
    return tuple(
        other
        for other in sorted(lexicon())
        if other != kind
        and not is_piece(other)
        and not is_piece(kind)
        and ("pickupable" in object_types()[other].capabilities) == movable
        and (movable or other in landmark_types())
    )


def _allows(goal: Goal, kind: str, other: str) -> bool:
    """Return whether a goal about a type can be met with another in its place."""
    if kind not in goal.arguments:
        return not any(is_piece(one) and base_type(one) == kind for one in goal.arguments)
    if goal.predicate in ("ON", "INSIDE"):
        thing, place = (other if one == kind else one for one in goal.arguments)
        return goes_in(thing, place)
    if goal.predicate == "STATE":
        state = deed_for(goal.arguments[1]) or ""
        return other != EGG and state in _KINDS and suits(_KINDS[state], other)
    if goal.predicate == "HOLDON":
        return True
    able = _ABLE.get(goal.predicate, "")
    switched = able == "toggleable" and uses.BURNER in (kind, other)
    return not switched and able in object_types()[other].capabilities
