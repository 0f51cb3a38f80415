"""Requests of tool mode's training chats, and what solves each."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import get_args

from karma.agent.planning.expert import NamedThing
from karma.files import read_toml
from karma.household.ids import root_id, type_of
from karma.household.pieces import base_type
from karma.household.saying import name_of, plural_of, told_place
from karma.household.types import object_types
from karma.household.uses import without_basin
from karma.plugins.rules.language.lexemes import lexicon, pick_common
from karma.plugins.training.drawing.drawn_tasks import Kind, draw_task
from karma.plugins.training.drawing.memories import KnownRoom, Rng, pick
from karma.plugins.training.drawing.requests import WITH_PAIRS, filled
from karma.plugins.training.packs import Data, in_room, with_other_things
from karma.plugins.training.refusals import draw_refusal
from karma.plugins.training.tool_teacher import Lesson, Things
from karma.types.observation import TrueObject
from karma.types.planning import EndKind
from karma.types.tasks import Goal

SHARES = {
    "tasks": 0.34, "alfred": 0.24, "written": 0.16, "question": 0.12, "refusal": 0.07,
    "absent": 0.03, "unplaced": 0.04,
}  # of requests, by where they come from  # fmt: skip
TRIES = 40


@cache
def tool_phrases() -> Mapping[str, tuple[str, ...]]:
    """Return the phrases of `tool_requests.toml`."""
    return read_toml(Path(__file__).with_suffix(".toml"), dict[str, tuple[str, ...]])


@dataclass(frozen=True, kw_only=True)
class ToolRequests:
    """Samples requests in a room; `objects` are the world's at this moment."""

    rng: Rng
    room: KnownRoom
    data: Data
    objects: Sequence[TrueObject]

    def draw(self, source: str) -> Sequence[Lesson]:
        """Return a request of a source, with those that follow from it; () if there is none."""
        draw: Callable[[], Sequence[Lesson]] = getattr(self, f"_{source}")
        for _ in range(TRIES):
            lessons = draw()
            if lessons and all(self.data.unseen.admits(lesson.text) for lesson in lessons):
                return lessons
        return ()

    def _tasks(self) -> Sequence[Lesson]:
        kind = pick(self.rng, get_args(Kind))
        steps = draw_task(self.rng, self.room, self.data.book, kind, WITH_PAIRS) or ()
        return [Lesson(kind=kind, text=step.text, goals=step.goals) for step in steps]

    def _alfred(self) -> Sequence[Lesson]:
        if not self.data.alfred:
            return ()
        said = pick(self.rng, self.data.said(self.room) or self.data.alfred)
        return self._possible("alfred", said.text, said.wanted)

    def _written(self) -> Sequence[Lesson]:
        if not self.data.written:
            return ()
        said = pick(self.rng, self.data.written)
        if not said.goals:
            return [_refused(said.kind, said.text)]
        landmarks = self.room.landmarks
        text, goals = with_other_things(self.rng, said.text, said.wanted, landmarks)
        return self._possible("written", text, in_room(goals, landmarks) or ())

    def _possible(self, kind: str, text: str, goals: Sequence[Goal]) -> Sequence[Lesson]:
        """Return a request whose objects the room has, or ()."""
        names = {base_type(name) for goal in goals for name in goal.arguments}
        here = {*self.room.movables, *self.room.landmarks}
        several = {goal.arguments[0] for goal in goals if goal.count > 1}
        if not (names & object_types().keys() <= here and several <= set(self.room.several)):
            return ()
        return [Lesson(kind=kind, text=text, goals=tuple(goals))] if goals else ()

    def _refusal(self) -> Sequence[Lesson]:
        found = draw_refusal(self.rng, self.room, self.data.book, mapped=True)
        kind = found.kind.removeprefix("refuse_")
        return [_refused(kind, found.sentence)] if kind != "unclear" else ()

    def _absent(self) -> Sequence[Lesson]:
        """Ask for an object of a known type that is not in the room."""
        kind = pick(self.rng, sorted(lexicon()))
        if kind in self.room.movables or not object_types()[kind].can("pickupable"):
            return ()
        word = self._word(kind)
        slots = {"x": f"the {word}", "x0": word, "x2": "it"}
        text = filled(self.data.book.pick(self.rng, "hold"), slots)
        reply = f"I searched everywhere and found no {name_of(kind)}."
        asked = Lesson(kind="absent", text=text or "", search=f"find({kind})", end="refuse",
                       reply=reply)  # fmt: skip
        return [asked] if text else ()

    def _unplaced(self) -> Sequence[Lesson]:
        """Return a request that lacks its place, and the answer that gives it."""
        steps = draw_task(self.rng, self.room, self.data.book, "simple") or ()
        goals = steps[0].goals if steps else ()
        if len(goals) != 1 or goals[0].predicate not in ("ON", "INSIDE"):
            return ()
        word, where = name_of(goals[0].arguments[0]), told_place(goals[0].arguments[1])
        phrases = tool_phrases()
        first, then = (pick(self.rng, phrases[name]) for name in ("unplaced", "placed"))
        reply = f"Where shall I put the {word}?"
        return [
            Lesson(kind="unplaced", text=first.format(word), end="ask", reply=reply),
            Lesson(kind="placed", text=then.format(where), goals=goals),
        ]

    def _question(self) -> Sequence[Lesson]:
        """Ask for the place or state of an object, or for what lies in or on furniture."""
        kinds = Counter(one.object_type for one in self.objects)
        known = [one for one in self.objects if one.object_type in lexicon()]
        one = pick(self.rng, [one for one in known if kinds[one.object_type] == 1])
        kind, can = one.object_type, object_types()[one.object_type].can
        name, place = f"The {name_of(kind)}", next(iter(one.parent_ids), "")
        if one.pickupable and can("dirtyable") and self.rng.random() < 0.5:
            state = "dirty" if "dirty" in one.states else "clean"
            is_shown = _shows(kind, lambda thing: ("dirty" in thing.states) == (state == "dirty"))
            return [self._asked("dirty", kind, f"{name} is {state}.", is_shown=is_shown)]
        if one.pickupable and type_of(place) in object_types():
            holder, reply = without_basin(type_of(place)), f"{name} is {told_place(place)}."
            is_shown = _shows(kind, lambda thing: thing.place_type == holder)
            return [self._asked("where", kind, reply, is_shown=is_shown)]
        if kind in self.room.landmarks and can("toggleable"):
            state = "on" if "on" in one.states else "off"
            return [self._asked("on", kind, f"{name} is {state}.", tool="go")]
        if kind not in self.room.landmarks or not can("receptacle"):
            return ()
        lying = [each for each in self.objects if each.pickupable and each.parent_ids]
        roots = [(root_id(each.parent_ids[-1]), name_of(each.object_type)) for each in lying]
        names = sorted(word for root, word in roots if root == one.object_id)
        reply = _listed(told_place(kind), names)
        return [self._asked("contents", kind, reply, tool="look", word=told_place(kind))]

    def _asked(
        self, form: str, kind: str, reply: str, *, tool: str = "find", word: str = "",
        is_shown: Callable[[Things], bool] | None = None,
    ) -> Lesson:  # fmt: skip
        text = pick(self.rng, tool_phrases()[form]).format(word or self._word(kind))
        return Lesson(kind="question", text=text, search=f"{tool}({kind})", is_shown=is_shown,
                      end="tell", reply=reply)  # fmt: skip

    def _word(self, kind: str) -> str:
        return pick_common(self.rng, self.data.book.things[kind].names)


def _refused(kind: str, text: str) -> Lesson:
    end: EndKind = "ask" if kind == "unclear" else "refuse"
    (reply,) = tool_phrases()[kind]
    return Lesson(kind=f"{end}_{kind}", text=text, end=end, reply=reply)


def _shows(kind: str, fits: Callable[[NamedThing], bool]) -> Callable[[Things], bool]:
    """Return a check whether objects of a type that are told of are as they should be."""
    return lambda things: any(one.object_type == kind and fits(one) for one in things.values())


def _listed(where: str, words: Sequence[str]) -> str:
    """Return what is somewhere as a sentence.

    >>> _listed("in the sink", ["apple", "egg", "egg"]), _listed("on the desk", [])
    ('In the sink: apple, 2 eggs.', 'On the desk: nothing.')
    """
    counts = Counter(words).items()
    each = [word if count == 1 else f"{count} {plural_of(word)}" for word, count in counts]
    return f"{where.capitalize()}: {', '.join(each) or 'nothing'}."


# ----------------------------------------------------------------- mistakes


def slipped(rng: Rng, lines: Sequence[str]) -> list[str]:
    """Return an answer with a mistake: a tool that there is not, a letter or an `open` missing."""
    calls = [number for number, line in enumerate(lines) if '("' not in line]
    if not calls:
        return list(lines)
    at = pick(rng, calls)
    tool, _, names = lines[at].partition("(")
    cut = int(rng.integers(1, max(2, len(names) - 1)))
    other = pick(rng, tool_phrases()["tools"])
    wrong = pick(rng, (f"{other}({names}", f"{tool}({names[:cut]}{names[cut + 1 :]}"))
    opened = [number for number in calls if lines[number].startswith("open(")]
    if opened and rng.random() < 0.5:
        return [*lines[: opened[0]], *lines[opened[0] + 1 :]]
    return [*lines[:at], wrong, *lines[at + 1 :]]
