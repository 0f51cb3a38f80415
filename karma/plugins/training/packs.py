"""Sample training packs: examples of a planner in the same scene.

A pack has (memory, instruction, program) examples of a scene, with or without its map. In sentences
written by hand, names of objects are exchanged for others that the goals allow: "pop the apple in
the fridge" teaches "pop", not apples.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

from karma.agent.planning.expert import ExpertView
from karma.agent.planning.plain_program import plain_program
from karma.goals.files import SaidRequest
from karma.household import uses
from karma.household.containment import goes_in
from karma.household.pieces import EGG, base_type, is_piece
from karma.household.places import HAND, landmark_types, likest
from karma.household.states import deed_for
from karma.household.types import object_types
from karma.plugins.alfred.sentences import plain
from karma.plugins.rules.language.lexemes import lexicon, pick_common, unseen_lexemes
from karma.plugins.training.drawing.memories import KnownRoom, Rng, pick
from karma.plugins.training.drawing.phrases import Book
from karma.plugins.training.drawing.requests import suits
from karma.plugins.training.goal_sentences import Sentence
from karma.plugins.training.hinted import DrawnHints
from karma.plugins.training.refusals import draw_near_miss, draw_refusal
from karma.plugins.training.samples import (
    LONGEST,
    TYPOS,
    TrainingExample,
    draw,
    draw_alfred,
    draw_facts,
    example_of,
    misspelt,
    program_text,
)
from karma.seeds import stream
from karma.types.memory import MemoryUnit
from karma.types.planning import PlanRequest, RefusedRequest
from karma.types.tasks import Goal


@dataclass(frozen=True, kw_only=True)
class Unseen:
    """Sentences that examples may not repeat, besides held-out lexemes."""

    sentences: frozenset[str] = frozenset()  # as `plain` has them

    def admits(self, sentence: str) -> bool:
        """Return whether an example may say a sentence."""
        return not unseen_lexemes().found_in(sentence) and plain(sentence) not in self.sentences


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerRecipe:
    """Sampling parameters."""

    seed: int = 0
    examples: int = 4  # per pack with long-term memory; half as many more without it
    mapped: float = 0.6  # share of packs with long-term memory
    written: float = 0.16  # share of what was written by hand, `eval/requests/written.jsonl`
    alfred: tuple[float, float] = (0.45, 0.5)  # share of ALFRED's goals without and with it
    elsewhere: float = 0.25  # share of ALFRED's goals with it that were said in other rooms
    plans: float = 0.4  # share of packs with long-term memory in rooms where ALFRED was recorded
    refused: float = 0.11  # share of requests that are refused
    near_misses: float = 0.08  # share of those that only sound like it


@dataclass(frozen=True, kw_only=True)
class Data:
    """Where examples come from."""

    rooms: Sequence[KnownRoom]
    book: Book
    unseen: Unseen = field(default_factory=Unseen)
    alfred: Sequence[Sentence] = ()
    written: Sequence[SaidRequest] = ()
    hints: DrawnHints | None = None  # hints of unknown words

    @cached_property
    def recorded(self) -> Sequence[KnownRoom]:
        """The rooms of ALFRED's sentences."""
        return tuple(room for room in self.rooms if self.said(room))

    def said(self, room: KnownRoom) -> Sequence[Sentence]:
        """Return ALFRED's sentences of a room."""
        return self._by_plan.get(room.name, ())

    @cached_property
    def _by_plan(self) -> Mapping[str, Sequence[Sentence]]:
        found: dict[str, list[Sentence]] = {}
        for sentence in self.alfred:
            found.setdefault(sentence.floor_plan, []).append(sentence)
        return found


def draw_pack(recipe: PlannerRecipe, data: Data, *name: str) -> list[TrainingExample]:
    """Sample a pack; equal names give equal packs."""
    rng = stream(recipe.seed, "planner", *name)
    mapped = bool(rng.random() < recipe.mapped)
    recorded = data.recorded if mapped and rng.random() < recipe.plans else ()
    room = pick(rng, recorded or data.rooms)
    found: list[TrainingExample] = []
    wanted = recipe.examples if mapped else recipe.examples * 3 // 2
    while len(found) < wanted:
        example = _draw_one(rng, recipe, data, room, mapped=mapped)
        if example is not None and data.unseen.admits(example.sentence):
            found.append(example if data.hints is None else data.hints.told(rng, example))
    return found


def _draw_one(
    rng: Rng, recipe: PlannerRecipe, data: Data, room: KnownRoom, *, mapped: bool
) -> TrainingExample | None:
    """Sample an example in a room; return None if the sample is impossible."""
    if data.written and rng.random() < recipe.written:
        return draw_written(rng, room, data.written, mapped=mapped)
    if (roll := rng.random()) < recipe.refused:
        return draw_refusal(rng, room, data.book, mapped=mapped)
    if roll < recipe.refused + recipe.near_misses:
        return draw_near_miss(rng, room, data.book, mapped=mapped)
    here = mapped and rng.random() > recipe.elsewhere
    said, roll = data.said(room) if here else data.alfred, rng.random()
    if said and roll < recipe.alfred[mapped]:
        return draw_alfred(rng, room, said, mapped=mapped)
    return draw(rng, room, data.book, mapped=mapped)


OTHER_THINGS = 0.7  # share of sentences in which a thing gives way to another
EMPTY = 0.4  # share of prompts in which nothing is remembered
_KINDS = {"cleaned": "clean", "heated": "heat", "cooled": "cool", "cooked": "cook"}
_KINDS |= {"sliced": "slice", "filled": "fill", "broken": "break"}  # state -> kind of request
_ABLE = {"TOGGLEON": "toggleable", "TOGGLEOFF": "toggleable"}
_ABLE |= {"OPEN": "openable", "CLOSED": "openable"}


def draw_written(
    rng: Rng, room: KnownRoom, sentences: Sequence[SaidRequest], *, mapped: bool
) -> TrainingExample | None:
    """Sample an example with a written sentence; return None if the room lacks its receptacle."""
    said = pick(rng, sentences)
    text, goals = said.text, said.wanted
    if goals and rng.random() < OTHER_THINGS:
        text, goals = with_other_things(rng, text, goals, room.landmarks if mapped else ())
    if mapped and (here := in_room(goals, room.landmarks)) is not None:
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
    """Return the knowledge without the sentence's objects, which go by their types then."""
    if rng.random() < EMPTY:
        return replace(facts, units=(), held_id=None, held_type=None)

    def kept(unit: MemoryUnit) -> bool:
        return base_type(unit.object_type) not in about and unit.place_id != HAND

    return replace(facts, units=tuple(filter(kept, facts.units)), held_id=None, held_type=None)


def in_room(goals: Sequence[Goal], landmarks: Sequence[str]) -> tuple[Goal, ...] | None:
    """Return goals with the nearest fixtures of a room; None if a fixture has no stand-in."""
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
    """Exchange objects in a sentence and its goals where the goals allow it.

    `landmarks`: what the room has; () for all.
    """
    goals = tuple(goals)
    for kind in sorted({name for goal in goals for name in goal.arguments} & lexicon().keys()):
        if rng.random() < 0.25 or any(goal.count > 1 for goal in goals):
            continue
        named = _name_pattern(text, kind)
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
            replace(g, arguments=tuple(other if name == kind else name for name in g.arguments))
            for g in goals
        )
    return text, goals


def _name_pattern(text: str, kind: str) -> re.Pattern[str] | None:
    """Return the pattern of a type's longest name in a sentence, or None."""
    names = sorted(lexicon()[kind].names, key=len, reverse=True)
    for name in names:
        pattern = re.compile(rf"\b{re.escape(name)}\b", re.IGNORECASE)
        if pattern.search(text):
            return pattern
    return None


@cache
def _alike(kind: str) -> tuple[str, ...]:
    """Return the types that may replace a type: movable as it is, and no pieces."""
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
        return not any(is_piece(name) and base_type(name) == kind for name in goal.arguments)
    if goal.predicate in ("ON", "INSIDE"):
        thing, place = (other if name == kind else name for name in goal.arguments)
        return goes_in(thing, place)
    if goal.predicate == "STATE":
        state = deed_for(goal.arguments[1]) or ""
        return other != EGG and state in _KINDS and suits(_KINDS[state], other)
    if goal.predicate == "HOLDON":
        return True
    able = _ABLE.get(goal.predicate, "")
    switched = able == "toggleable" and uses.BURNER in (kind, other)
    return not switched and able in object_types()[other].capabilities
