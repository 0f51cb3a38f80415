"""What a planner is tuned on: packs of examples over one scene.

A pack is several (memory, instruction, program) examples of one scene, with or without its map.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from karma.agent.goals.files import SaidRequest
from karma.agent.loading.alfred_sentences import Sentence, StepSentence
from karma.bench.drawing.memories import KnownRoom, Rng, pick
from karma.bench.drawing.phrases import Book
from karma.seeds import stream
from karma.train.planner.held_out import Unseen
from karma.train.planner.hinted import DrawnHints
from karma.train.planner.refusals import draw_near_miss, draw_refusal
from karma.train.planner.samples import TrainingExample, draw, draw_alfred, draw_step
from karma.train.planner.written import draw_written


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerRecipe:
    """All that decides what is drawn, besides the data."""

    seed: int = 0
    examples: int = 4  # per pack with long-term memory; half as many more without it
    mapped: float = 0.6  # share of packs with long-term memory
    written: float = 0.16  # share of what was written by hand, `eval/requests/written.jsonl`
    alfred: tuple[float, float] = (0.45, 0.5)  # share of ALFRED's goals without and with it
    elsewhere: float = 0.25  # share of ALFRED's goals with it that were said in other rooms
    steps_said: float = 0.1  # share of what ALFRED's annotators said of single steps, without it
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
    steps: Sequence[StepSentence] = ()
    written: Sequence[SaidRequest] = ()
    hints: DrawnHints | None = None  # what is told of words that are not known

    @cached_property
    def recorded(self) -> Sequence[KnownRoom]:
        """The rooms in which a sentence of ALFRED's was said."""
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
    """Draw one pack; equal names give equal packs."""
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
    """Draw one example in a room, None where what was drawn cannot be."""
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
    if data.steps and not mapped and roll > 1 - recipe.steps_said:
        return draw_step(rng, room, data.steps)
    return draw(rng, room, data.book, mapped=mapped)
