"""What the nano planner is trained on: packs of examples over one scene, and its tokens.

A pack is the scene's stable text once and several (memory, instruction, program) examples after it.
Each example attends to the stable text and itself only, at the positions it has when asked alone,
so a pack trains exactly what inference does.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from karma.agent.program import SKILLS
from karma.contracts import REFUSAL_KINDS
from karma.household.places import landmark_types
from karma.household.types import object_types
from karma.infer.llama.gguf_export import new_tokenizer
from karma.seeds import stream
from karma.tasks.drawing.alfred import Sentence, StepSentence
from karma.tasks.drawing.memories import KnownRoom, Rng, pick
from karma.tasks.drawing.phrases import Book
from karma.tasks.requests import SaidRequest
from karma.training.planner.held_out import Unseen
from karma.training.planner.hinted import DrawnHints
from karma.training.planner.refusals import draw_near_miss, draw_refusal
from karma.training.planner.samples import TrainingExample, draw, draw_alfred, draw_step
from karma.training.planner.written import draw_written

END = "<|end|>"
PAD = "<|pad|>"
TYPES = tuple(sorted(object_types()))
WHOLE = (
    *(f"{skill.name}(robot, '" for skill in SKILLS),
    "', '", "', ['", "'])\n", "')\n", " @", " *\n",
    "#areas\n", "#memory\n", "#held ", "#task ", "#program\n", "#error ",
    *(f"node_{number}" for number in range(1, 33)), *(f"_{number}" for number in range(2, 10)),
    *TYPES, *(f" {name}" for name in sorted(landmark_types())),
    "#words ", "refuse('", *(f"{kind}')\n" for kind in REFUSAL_KINDS),
)  # pieces of the notation that are one token each, so names stand alone  # fmt: skip
_PIECES = re.compile("|".join(re.escape(text) for text in sorted(WHOLE, key=len, reverse=True)))


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerRecipe:
    """All that decides the weights, besides the data."""

    seed: int = 0
    vocabulary: int = 4096
    hidden: int = 320
    layers: int = 6
    heads: int = 5
    feed_forward: int = 896
    context: int = 2048
    start: str = ""  # a GGUF whose weights and tokenizer to begin with, below models/; "" is none
    kept: float = 0.5  # share of the start's weights in what is exported (Wortsman et al. 2022)
    packs: int = 32  # per step
    examples: int = 4  # per pack with long-term memory; half as many more without it
    steps: int = 1200
    warmup: int = 100
    decay: int = 400  # last steps, in which the learning rate falls to zero
    learning_rate: float = 5e-4
    weight_decay: float = 0.05
    mapped: float = 0.6  # share of packs with long-term memory
    alfred: tuple[float, float] = (0.4, 0.5)  # share of ALFRED's goals without and with it
    elsewhere: float = 0.0  # share of ALFRED's goals with memory that were said in other rooms
    steps_said: float = 0.2  # share of what ALFRED's annotators said of single steps, without it
    plans: float = 0.4  # share of packs with long-term memory in rooms where ALFRED was recorded
    refused: float = 0.13  # share of requests that are refused
    near_misses: float = 0.08  # share of those that only sound like it
    written: float = 0.0  # share of what was written by hand, `eval/requests/written.jsonl`
    half: bool = False  # matrices in bfloat16, where the processor has instructions for it


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


def corpus(recipe: PlannerRecipe, data: Data, packs: int) -> Iterator[str]:
    """Yield texts to train the tokenizer on."""
    for number in range(packs):
        pack = draw_pack(recipe, data, "corpus", str(number))
        yield pack[0].stable
        for example in pack:
            yield example.changing
            yield example.program


def make_tokenizer(recipe: PlannerRecipe, data: Data, packs: int) -> Any:
    """Train the tokenizer on the corpus, the notation's fixed pieces being tokens of their own."""
    from tokenizers import AddedToken

    bare = new_tokenizer(
        (piece for text in corpus(recipe, data, packs) for piece in _PIECES.split(text)),
        recipe.vocabulary - len(WHOLE),
        [END, PAD],
    )
    bare.add_tokens([AddedToken(text, normalized=False, special=False) for text in WHOLE])
    return bare
