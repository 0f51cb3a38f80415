"""Sample training examples: a room, a memory and a request, with the expert's program.

No simulator runs: the samples are an agent's knowledge (area nodes, recalled units, held
object), rendered by `karma.agent.planning.prompt` as for planning.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from karma.agent.planning.expert import ExpertView, NamedThing
from karma.agent.planning.plain_program import plain_program
from karma.agent.planning.prompt import compact
from karma.household.ids import short_type
from karma.household.pieces import base_type
from karma.household.places import HAND, likest
from karma.household.types import object_types
from karma.plugins.training.drawing.memories import (
    KnownRoom,
    Rng,
    known_facts,
    names_of,
    pick,
    place_type,
)
from karma.plugins.training.drawing.phrases import Book
from karma.plugins.training.drawing.referring_expressions import Situation
from karma.plugins.training.drawing.requests import WITH_PAIRS, Ask, one_ask, pick_kind, wrapped
from karma.plugins.training.goal_sentences import Sentence, program_of
from karma.plugins.training.past import draw_failure, live_memory, with_twins
from karma.types.memory import MemoryUnit
from karma.types.planning import PlanRequest, SkillCall

RECALLED = 0.75  # share of prompts with a few units, as recall leaves them, not all
FEW = 3  # units then
ALIKE = 0.5  # share of those in which the other ones are as like it as can be
FRESH = 0.2  # share of prompts with a map in which nothing is remembered
TWINS = 0.2  # share of memories with a second or third object of a type
VAGUE = 0.7  # share of draws in which a remembered thing is mostly not called by its name
TYPOS = 0.04  # share of sentences with a letter wrong
LONGEST = 40  # lines of a program


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingExample:
    """A (memory, instruction) -> program pair as text."""

    kind: str
    stable: str
    changing: str
    program: str
    facts: PlanRequest = field(default=PlanRequest(instruction=""), compare=False, repr=False)

    @property
    def sentence(self) -> str:
        """The instruction."""
        return self.changing.partition("\n")[0].removeprefix("#task ")


def draw(
    rng: Rng,
    room: KnownRoom,
    book: Book,
    *,
    mapped: bool,
    told: Callable[[Rng, Situation, str], str] | None = None,
) -> TrainingExample:
    """Sample an example.

    `told` rewords the sentence.
    """
    while True:
        facts, held = draw_facts(rng, room, mapped=mapped)
        scene = situation(rng, room, facts, book, mapped=mapped)
        ask = _draw_ask(rng, scene)
        if ask is None:
            continue
        if rng.random() < RECALLED:
            facts = _recalled(rng, scene, ask)
            scene = replace(scene, facts=facts)
        view = view_of(scene, held)
        calls = tuple(plain_program(ask.goals, view))
        if not calls or len(calls) > LONGEST:
            continue
        text = told(rng, scene, ask.text) if told is not None else ask.text
        text = misspelt(rng, text) if rng.random() < TYPOS else text
        about = frozenset(base_type(short_type(name)) for g in ask.goals for name in g.arguments)
        failure = draw_failure(rng, scene, calls, wanted=about)
        facts = replace(facts, instruction=text, error=failure.error)
        return example_of(ask.kind, facts, program_text(failure.calls))


def _recalled(rng: Rng, scene: Situation, ask: Ask) -> PlanRequest:
    """Return the facts with the request's units and a few others, as recall does.

    All units stay if a unit would get another name among the few.
    """
    named = {argument for goal in ask.goals for argument in goal.arguments}
    meant = [unit for unit in scene.units if scene.names[unit.object_id] in named]
    others = [unit for unit in scene.units if unit not in meant]
    rng.shuffle(others)
    if meant and rng.random() < ALIKE:
        others.sort(key=lambda unit: -max(_likeness(unit, other) for other in meant))
    kept = {unit.object_id for unit in (*meant, *others[: max(FEW - len(meant), 0)])}
    few = replace(scene.facts, units=tuple(unit for unit in scene.units if unit.object_id in kept))
    names = names_of(few)
    return few if all(names[kept_id] == scene.names[kept_id] for kept_id in kept) else scene.facts


def _likeness(unit: MemoryUnit, other: MemoryUnit) -> int:
    """Return the likeness of two units: type, receptacles, location, states and history."""
    first, second = (object_types()[base_type(u.object_type)] for u in (unit, other))
    return (
        3 * (first.name == second.name)
        + (first.goes_in == second.goes_in)
        + (unit.place_id == other.place_id)
        + len({*unit.states} & {*other.states})
        + (unit.handled == other.handled)
    )


def draw_alfred(
    rng: Rng, room: KnownRoom, sentences: Sequence[Sentence], *, mapped: bool
) -> TrainingExample | None:
    """Sample an example with a sentence of ALFRED; return None if the room has no such place.

    Short-term memory is mostly empty: the prompt holds the sentence, and the map if there is one.

    With long-term memory (`mapped`) the room should be the one of the sentences.
    """
    sentence = pick(rng, sentences)
    wanted = sentence.facts
    if mapped and wanted.place not in room.landmarks:
        place = likest(wanted.place, room.landmarks)
        if place is None:
            return None
        wanted = replace(wanted, place=place)
        sentence = replace(sentence, facts=wanted)
    facts, held = draw_facts(rng, room, mapped=mapped)
    if rng.random() < 0.8:
        facts, held = replace(facts, units=(), held_id=None, held_type=None), None
    book = Book(templates={}, adjectives={}, just={}, around={}, references={})
    scene = situation(rng, room, facts, book, mapped=mapped)
    known = {base_type(unit.object_type) for unit in facts.units}
    if known & {wanted.thing, wanted.movable} and (wanted.task == "two" or wanted.sliced):
        return None
    calls = program_of(sentence, view_of(scene, held))
    if not calls or len(calls) > LONGEST:
        return None
    text = misspelt(rng, sentence.text) if rng.random() < TYPOS else sentence.text
    return example_of("alfred", replace(facts, instruction=text), program_text(calls))


def program_text(calls: Sequence[SkillCall]) -> str:
    """Return a program, a line per call."""
    return "".join(f"{call}\n" for call in calls)


def example_of(kind: str, facts: PlanRequest, program: str) -> TrainingExample:
    """Return the example of some knowledge and its answer."""
    prompt = compact(facts).prompt
    return TrainingExample(
        kind=kind, stable=prompt.stable, changing=prompt.changing, program=program, facts=facts
    )


def draw_facts(rng: Rng, room: KnownRoom, *, mapped: bool) -> tuple[PlanRequest, MemoryUnit | None]:
    """Sample an agent's knowledge without an instruction, and the held unit."""
    units, held = live_memory(rng, room)
    if rng.random() < TWINS:
        units = with_twins(rng, room, units)
    if mapped and rng.random() < FRESH:
        units, held = (), None
    if rng.random() < 0.15:
        units = units[-3:]  # a recall of few
    if held is not None and (rng.random() < 0.15 or held not in units):
        units = ()  # without short-term memory the robot still feels what it holds
    return known_facts(room.areas if mapped else (), units, held), held


def situation(
    rng: Rng,
    room: KnownRoom,
    facts: PlanRequest,
    book: Book,
    *,
    mapped: bool,
) -> Situation:
    """Return the situation for sampling a request."""
    vague = 1.0 if rng.random() < VAGUE else 0.0
    names = names_of(facts)
    return Situation(room=room, facts=facts, names=names, book=book, mapped=mapped, vague=vague)


def misspelt(rng: Rng, text: str) -> str:
    """Drop, double or swap a letter of a longer word."""
    words = text.split(" ")
    long = [number for number, word in enumerate(words) if len(word) > 4]
    if not long:
        return text
    at = pick(rng, long)
    word = words[at]
    place = int(rng.integers(1, len(word) - 1))
    words[at] = pick(
        rng,
        (
            word[:place] + word[place + 1 :],
            word[:place] + word[place] + word[place:],
            word[:place] + word[place + 1] + word[place] + word[place + 2 :],
        ),
    )
    return " ".join(words)


def _draw_ask(rng: Rng, scene: Situation) -> Ask | None:
    ask = one_ask(rng, scene, pick_kind(rng, WITH_PAIRS))
    return replace(ask, text=wrapped(rng, scene.book, ask.text)) if ask is not None else None


def view_of(scene: Situation, held: MemoryUnit | None) -> ExpertView:
    """Return the expert's view of the same knowledge that the prompt states."""
    things = tuple(_thing(scene, unit) for unit in reversed(scene.units))
    return ExpertView(
        things=things,
        areas=scene.room.areas if scene.mapped else (),
        held=_thing(scene, held) if held else None,
    )


def _thing(scene: Situation, unit: MemoryUnit) -> NamedThing:
    place = unit.place_id if unit.place_id != HAND else None
    return NamedThing(
        name=scene.names[unit.object_id],
        object_type=unit.object_type,
        states=unit.states,
        place=scene.names.get(place) if place else None,
        place_type=place_type(scene.units, place) if place else None,
    )
