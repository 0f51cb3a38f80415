"""Trajectories of tool mode: conversations of an expert in rooms of the embedded world.

Each request is a chat in the words of the tool loop: system message, what is seen and remembered,
answers with calls, their results, an end. A chat is kept if the world confirms it: all goals hold,
or nothing has changed and the end is the right one.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, get_args

from karma import registry
from karma.agent.karma import KarmaMethod
from karma.agent.loop import KarmaAgent
from karma.agent.planning.planner import Planner
from karma.agent.planning.prompt import TOOLS
from karma.agent.seeing.perceive import truth_of
from karma.agent.settings import KarmaSettings
from karma.files import to_json, write_atomic
from karma.goals.files import SaidRequest
from karma.goals.goals import GoalTracker, WatchedWorld
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.saying import name_of, preposition, told_place
from karma.household.types import object_types
from karma.household.uses import without_basin
from karma.models.scripted import MetadataVision
from karma.plugins.rooms.generate import build_scene
from karma.plugins.rules.language.lexemes import lexicon, pick_common
from karma.plugins.training.drawing.drawn_tasks import Kind, draw_task
from karma.plugins.training.drawing.memories import KnownRoom, Rng, pick, room_of, weighted
from karma.plugins.training.drawing.phrases import Book
from karma.plugins.training.drawing.referring_expressions import with_article
from karma.plugins.training.drawing.requests import filled
from karma.plugins.training.goal_sentences import Sentence
from karma.plugins.training.packs import Unseen, in_room, with_other_things
from karma.plugins.training.refusals import draw_refusal
from karma.plugins.training.task_files import ORDER
from karma.plugins.training.tool_teacher import Lesson, Things, ToolTeacher
from karma.seeds import stream
from karma.types.events import Outcome
from karma.types.observation import TrueObject
from karma.types.planning import EndKind
from karma.types.roles import Recall, World
from karma.types.space import SceneRef
from karma.types.tasks import SubTask
from karma.world.core.scene import Scene

SHARES = {
    "tasks": 0.32, "alfred": 0.24, "written": 0.16, "question": 0.12, "refusal": 0.08,
    "absent": 0.03, "unclear": 0.05,
}  # of requests, by where they come from  # fmt: skip
MAX_UNITS = 3  # of these, in a conversation
SLIPS = 0.15  # share of conversations with a mistake in first answers
NO_MAP = 0.1  # share of conversations without long-term memory
LONGEST = 6  # answers in a chat
TRIES = 40
_FIRST_ROOM = 2000  # rooms of their own, beside those of `generated_rooms`
_ENDS: Mapping[str, tuple[EndKind, str]] = {
    "deed": ("refuse", "I cannot do that with one arm and the things of this room."),
    "thing": ("refuse", "There is no such object here."),
    "place": ("refuse", "There is no such place here."),
    "impossible": ("refuse", "That is not possible with such an object."),
    "negated": ("refuse", "You ask me not to, and I leave it as it is."),
    "language": ("refuse", "I understand English only."),
    "unclear": ("ask", "Which object do you mean, and what shall I do with it?"),
}  # of what is not carried out, by its kind


@dataclass(frozen=True, kw_only=True)
class Material:
    """Input of trajectories: phrases, sentences, AI2-THOR's floor plans, a recall."""

    book: Book
    recall: Recall
    unseen: Unseen
    alfred: Sequence[Sentence] = ()
    written: Sequence[SaidRequest] = ()
    plans: Sequence[Scene] = ()
    generated: int = 300  # rooms

    @cached_property
    def sentences_by_plan(self) -> Mapping[str, Sequence[Sentence]]:
        """ALFRED's sentences by floor plan."""
        found: dict[str, list[Sentence]] = {}
        for sentence in self.alfred:
            found.setdefault(sentence.floor_plan, []).append(sentence)
        return found

    def room(self, rng: Rng, seed: int) -> Scene:
        """Sample a room: a floor plan with sentences, or a generated room."""
        if self.plans and rng.random() < 0.5:
            return pick(rng, self.plans)
        number = int(rng.integers(self.generated))
        return build_scene(ORDER[number % len(ORDER)], _FIRST_ROOM + number, seed)


def draw_chats(material: Material, folder: Path, seed: int, name: str) -> Iterator[dict[str, Any]]:
    """Yield the chats of a conversation; equal seeds and names give equal chats.

    `folder` takes the room's file.
    """
    rng = stream(seed, "trajectories", name)
    scene = material.room(rng, seed)
    path = folder / f"{scene.name}.json"
    write_atomic(path, to_json(scene))
    world = registry.load("worlds", "embedded")()
    world.reset(str(path))
    _move_objects(world, rng)
    stage = _Stage(rng=rng, room=room_of(scene, scene.name, keep=1.0), material=material)
    teacher = ToolTeacher({}, slip=partial(slipped, rng) if rng.random() < SLIPS else list)
    tracker = GoalTracker()
    watched = WatchedWorld(world, tracker)
    settings = KarmaSettings(long_term=rng.random() > NO_MAP)
    method = KarmaMethod(Planner(teacher, TOOLS), material.recall, MetadataVision(), settings)
    agent = method.begin(watched, SceneRef.of(str(path)), seed=0, folder=folder)
    tracker.start(world.last_event)
    for number in range(1 + int(rng.integers(MAX_UNITS))):
        for lesson in stage.lessons(weighted(rng, SHARES), world, is_first=not number):
            chat = _chat(teacher, agent, tracker, world, lesson)
            if chat is None:
                return  # what follows may be about what was not done
            yield chat


def _move_objects(world: World, rng: Rng) -> None:
    """Put half of the movable objects elsewhere, where the room allows it."""
    objects = truth_of(world.last_event).objects
    loose = sorted(one.object_id for one in objects if one.pickupable)
    used = sorted({parent for one in objects if one.pickupable for parent in one.parent_ids})
    moved = [str(one) for one in rng.permutation(loose)[: len(loose) // 2]]
    world.step(
        "InitialRandomSpawn", randomSeed=int(rng.integers(1 << 30)), objectIds=moved,
        receptacleObjectIds=used, forceVisible=False, placeStationary=True,
    )  # fmt: skip


def _chat(
    teacher: ToolTeacher, agent: KarmaAgent, tracker: GoalTracker, world: World, lesson: Lesson
) -> dict[str, Any] | None:
    """Let the teacher carry out a request; return its chat, or None if the world denies it."""
    subtask = SubTask(instruction=lesson.text, goals=lesson.goals)
    if lesson.goals and not tracker.unmet(lesson.goals, world.last_event):
        return None
    tracker.begin_subtask(subtask, world.last_event)
    teacher.lessons, before = {lesson.text.strip(): lesson}, _states(world)
    teacher.answers.clear()
    outcome = list(agent.do(subtask))[-1]
    answers = list(teacher.answers)
    assert isinstance(outcome, Outcome)
    ended = outcome.end is not None and outcome.end.kind == lesson.end
    confirmed = not tracker.unmet(lesson.goals, world.last_event) if lesson.goals else (
        before == _states(world)
    )  # fmt: skip
    if not (ended and confirmed) or len(answers) > LONGEST:
        return None
    messages = [_message("system", answers[0].prompt.stable)]
    for answer in answers:
        weight = {"weight": 0} if answer.is_slip else {}
        messages.append(_message("user", answer.prompt.changing))
        messages.append({**_message("assistant", answer.text), **weight})
    return {"kind": lesson.kind, "messages": messages}


def _message(role: str, content: str) -> dict[str, Any]:
    return {"role": role, "content": content}


def _states(world: World) -> dict[str, Any]:
    return {
        one.object_id: (one.states, one.parent_ids) for one in truth_of(world.last_event).objects
    }


# ----------------------------------------------------------------- requests


@dataclass(frozen=True, kw_only=True)
class _Stage:
    """Samples the requests of a conversation in a room."""

    rng: Rng
    room: KnownRoom
    material: Material

    def lessons(self, source: str, world: World, *, is_first: bool) -> Sequence[Lesson]:
        """Return requests of a source that training may hold; () if the room offers none."""
        kinds: Mapping[str, Callable[[], Sequence[Lesson]]] = {
            "tasks": self._tasks, "alfred": self._alfred, "written": self._written,
            "question": partial(self._question, world), "refusal": self._refusal,
            "absent": self._absent, "unclear": partial(self._unclear, is_first=is_first),
        }  # fmt: skip
        for _ in range(TRIES):
            found = kinds[source]()
            texts = [lesson.text for lesson in found]
            if found and all(map(self.material.unseen.admits, texts)):
                return found
        return ()

    def _tasks(self) -> Sequence[Lesson]:
        kind = pick(self.rng, get_args(Kind))
        steps = draw_task(self.rng, self.room, self.material.book, kind) or ()
        return [Lesson(kind=kind, text=step.text, goals=step.goals) for step in steps]

    def _alfred(self) -> Sequence[Lesson]:
        own = self.material.sentences_by_plan.get(self.room.name, ())
        if not self.material.alfred:
            return ()
        said = pick(self.rng, own or self.material.alfred)
        names = {base_type(name) for goal in said.wanted for name in goal.arguments}
        here = {*self.room.movables, *self.room.landmarks}
        if not names & object_types().keys() <= here:
            return ()
        return [Lesson(kind="alfred", text=said.text, goals=said.wanted)]

    def _written(self) -> Sequence[Lesson]:
        said = pick(self.rng, self.material.written)
        if not said.goals:
            kind, (end, reply) = said.kind, _ENDS[said.kind]
            return [Lesson(kind=f"{end}_{kind}", text=said.text, end=end, reply=reply)]
        text, goals = with_other_things(self.rng, said.text, said.wanted, self.room.landmarks)
        goals = in_room(goals, self.room.landmarks) or ()
        names = {base_type(name) for goal in goals for name in goal.arguments}
        movable = {n for n in names & object_types().keys() if object_types()[n].can("pickupable")}
        if not goals or not movable <= set(self.room.movables):
            return ()
        return [Lesson(kind="written", text=text, goals=goals)]

    def _refusal(self) -> Sequence[Lesson]:
        found = draw_refusal(self.rng, self.room, self.material.book, mapped=True)
        kind = found.kind.removeprefix("refuse_")
        if kind == "unclear":
            return ()
        end, reply = _ENDS[kind]
        return [Lesson(kind=found.kind, text=found.sentence, end=end, reply=reply)]

    def _absent(self) -> Sequence[Lesson]:
        """Ask for an object of a known type that is not in the room."""
        kinds = [
            kind for kind in sorted(lexicon())
            if object_types()[kind].can("pickupable") and kind not in self.room.movables
        ]  # fmt: skip
        kind = pick(self.rng, kinds)
        word = pick_common(self.rng, self.material.book.things[kind].names)
        slots = {"x": with_article(self.rng, word), "x0": word, "x2": "it"}
        text = filled(self.material.book.pick(self.rng, "hold"), slots)
        reply = f"I searched everywhere and found no {name_of(kind)}."
        return [
            Lesson(kind="absent", text=text, search=f"find({kind})", end="refuse", reply=reply)
        ] if text else ()  # fmt: skip

    def _unclear(self, *, is_first: bool) -> Sequence[Lesson]:
        """Return a request that lacks its place, or its object, and one that says it."""
        steps = draw_task(self.rng, self.room, self.material.book, "simple") or ()
        if not is_first or len(steps) != 1:
            return ()
        (step,) = steps
        (goal, *more) = step.goals
        if more or goal.predicate not in ("ON", "INSIDE"):
            end, reply = _ENDS["unclear"]
            vague = pick(self.rng, ("Move it.", "Do the other one.", "Take it over there.",
                                    "Can you fix that?", "The other one, please."))  # fmt: skip
            return [
                Lesson(kind="unclear", text=vague, end=end, reply=reply),
                Lesson(kind="simple", text=step.text, goals=step.goals),
            ]
        word, place = (name_of(name) for name in goal.arguments)
        asked = pick(self.rng, ("Put the {}", "Move the {}", "Can you put the {}?", "Put away the {}"))
        where = f"{preposition(goal.arguments[1])} the {place}"
        answer = pick(self.rng, ("{}", "{}, please", "It goes {}.", "Put it {}."))
        return [
            Lesson(kind="unclear", text=asked.format(word), end="ask",
                   reply=f"Where shall I put the {word}?"),
            Lesson(kind="clarified", text=answer.format(where), goals=step.goals),
        ]  # fmt: skip

    def _question(self, world: World) -> Sequence[Lesson]:
        """Ask where an object is, whether it is dirty, or what lies in or on a receptacle."""
        objects = truth_of(world.last_event).objects
        movable = [one for one in objects if one.pickupable and self._is_only(one, objects)]
        if not movable:
            return ()
        if self.rng.random() < 0.35:
            return self._contents(objects)
        one = pick(self.rng, movable)
        word = pick_common(self.rng, self.material.book.things[one.object_type].names)
        place = next(iter(one.parent_ids), "")
        if not place or type_of(place) not in object_types():
            return ()
        text = pick(self.rng, ("Where is the {}?", "where did I leave the {}", "Where's my {}?",
                               "Do you know where the {} is?"))  # fmt: skip
        reply = f"The {name_of(one.object_type)} is {told_place(place)}."
        is_shown = partial(_is_at, one.object_type, without_basin(type_of(place)))
        if object_types()[one.object_type].can("dirtyable") and self.rng.random() < 0.4:
            text = pick(self.rng, ("Is the {} clean?", "is the {} dirty?", "Do I have to wash the {}?"))
            reply = f"The {name_of(one.object_type)} is {'dirty' if 'dirty' in one.states else 'clean'}."
            is_shown = partial(_is_dirty, one.object_type, "dirty" in one.states)
        return [
            Lesson(kind="question", text=text.format(word), search=f"find({one.object_type})",
                   is_shown=is_shown, end="tell", reply=reply)
        ]  # fmt: skip

    def _contents(self, objects: Sequence[TrueObject]) -> Sequence[Lesson]:
        holders = [
            one for one in objects
            if one.object_type in self.room.landmarks and "receptacle" in
            object_types()[one.object_type].capabilities and self._is_only(one, objects)
        ]  # fmt: skip
        if not holders:
            return ()
        holder = pick(self.rng, holders)
        inside = sorted(
            name_of(one.object_type)
            for one in objects
            if one.pickupable and any(p.startswith(holder.object_id) for p in one.parent_ids)
        )
        where = f"{preposition(holder.object_type)} the {name_of(holder.object_type)}"
        text = pick(self.rng, ("What is {}?", "what's {}", "Is there anything {}?",
                               "Tell me what is {}."))  # fmt: skip
        return [
            Lesson(kind="question", text=text.format(where), search=f"look({holder.object_type})",
                   end="tell", reply=f"{_listed(inside)} {where}.")
        ]  # fmt: skip

    @staticmethod
    def _is_only(one: TrueObject, objects: Sequence[TrueObject]) -> bool:
        return sum(one.object_type == other.object_type for other in objects) == 1


def _is_at(kind: str, place: str, things: Things) -> bool:
    return any(one.object_type == kind and one.place_type == place for one in things.values())


def _is_dirty(kind: str, is_dirty: bool, things: Things) -> bool:
    ones = [one for one in things.values() if one.object_type == kind]
    return any(("dirty" in one.states) == is_dirty for one in ones)


def _listed(words: Sequence[str]) -> str:
    """Return words as a list.

    >>> _listed([]), _listed(["apple"]), _listed(["apple", "egg", "egg"])
    ('Nothing is', 'An apple is', 'An apple, 2 eggs are')
    """
    if not words:
        return "Nothing is"
    counted = [_counted(word, words.count(word)) for word in dict.fromkeys(words)]
    text = ", ".join(counted)
    return f"{text[0].upper()}{text[1:]} {'is' if len(words) == 1 else 'are'}"


def _counted(word: str, count: int) -> str:
    from karma.household.saying import plural_of

    if count > 1:
        return f"{count} {plural_of(word)}"
    return f"{'an' if word[0] in 'aeiou' else 'a'} {word}"


# ----------------------------------------------------------------- mistakes


def slipped(rng: Rng, lines: Sequence[str]) -> list[str]:
    """Return an answer with a mistake in it that a model makes, so that a call of it fails."""
    spoiled = list(lines)
    calls = [n for n, line in enumerate(lines) if not line.startswith(tuple(get_args(EndKind)))]
    if not calls:
        return spoiled
    at = pick(rng, calls)
    opened = [n for n in calls if lines[n].startswith("open(")]
    roll = rng.random()
    if opened and roll < 0.4:  # what is closed is not opened first
        spoiled.pop(pick(rng, opened))
    elif roll < 0.7:  # a letter of a name is missing
        tool, _, names = spoiled[at].partition("(")
        cut = int(rng.integers(1, max(2, len(names) - 1)))
        spoiled[at] = f"{tool}({names[:cut]}{names[cut + 1 :]}"
    else:  # a tool that there is not
        tool, _, names = spoiled[at].partition("(")
        spoiled[at] = f"{pick(rng, ('move', 'grab', 'use', 'turn', 'insert'))}({names}"
    return spoiled
