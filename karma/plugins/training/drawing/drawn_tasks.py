"""Sample tasks: sequences of requests in a room, from our task grammar.

* simple: a request that names its objects.
* composite: two to four requests about the same few objects, named or "it".
* complex: three to five requests; later requests describe earlier objects in vague words that only
  short-term memory can resolve (KARMA section 4: "unspecific object references").

Rules record the effects of a request; the expert shows in the world whether a task can be done.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from karma.household.ids import short_type
from karma.household.pieces import base_type
from karma.household.places import HAND
from karma.plugins.training.drawing.memories import (
    KnownRoom,
    RequestHistory,
    Rng,
    known_facts,
    names_of,
    pick,
    subject,
)
from karma.plugins.training.drawing.phrases import Book
from karma.plugins.training.drawing.referring_expressions import Situation
from karma.plugins.training.drawing.requests import KINDS, Ask, one_ask, pick_kind, wrapped
from karma.types.tasks import Goal

Kind = Literal["simple", "composite", "complex"]
FOLLOW_UPS = tuple(kind for kind in KINDS if kind not in ("coffee", "toast", "break"))
LASTING = {"cleaned": "clean", "sliced": "sliced", "cooked": "cooked"}
TRIES = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnRequest:
    """Sub-task: a sentence and its goals."""

    kind: str
    text: str
    goals: tuple[Goal, ...]


class TaskDraft:
    """Task under construction: its requests and the memory after them."""

    def __init__(
        self, rng: Rng, room: KnownRoom, book: Book, kinds: Mapping[str, float] = KINDS
    ) -> None:
        self._rng, self._room, self._book, self._kinds = rng, room, book, kinds
        self._history = RequestHistory()
        self.steps: list[DrawnRequest] = []

    def ask(self, *, vague: bool, about_known: bool) -> bool:
        """Add a request; return False if none was found.

        `vague`: known objects are described by kind, state, location or history.
        """
        for _ in range(TRIES):
            kind = pick(self._rng, FOLLOW_UPS) if about_known else pick_kind(self._rng, self._kinds)
            ask = one_ask(self._rng, self._situation(vague=vague), kind)
            if (
                ask is None
                or self._pointless(ask)
                or about_known != (self._history.known(subject(ask.goals[0])) is not None)
            ):
                continue
            text = wrapped(self._rng, self._book, ask.text)
            if any(step.text == text for step in self.steps):
                continue
            goals = tuple(dict.fromkeys((*map(_by_type, ask.goals), *self._same(ask))))
            self.steps.append(DrawnRequest(kind=kind, text=text, goals=goals))
            self._history.apply(ask.goals)
            return True
        return False

    # ------------------------------------------------------------- parts

    def _situation(self, *, vague: bool) -> Situation:
        facts = known_facts(self._room.areas, self._history.units, self._history.held)
        return Situation(
            room=self._room, facts=facts, names=names_of(facts), book=self._book,
            mapped=True, strict=True, vague=1.0 if vague else -1.0,
        )  # fmt: skip

    def _pointless(self, ask: Ask) -> bool:
        """Return whether a goal already holds."""
        for goal in ask.goals:
            unit = self._history.known(subject(goal))
            if unit is None:
                continue
            if goal.predicate == "HOLDON" and unit.place_id == HAND:
                return True
            if goal.predicate == "ON" and (unit.place_id or "").startswith(goal.arguments[1]):
                return True
            state = {"clean": "cleaned"}.get(goal.arguments[-1], goal.arguments[-1])
            if goal.predicate == "STATE" and state in unit.states:
                return True
        return False

    def _same(self, ask: Ask) -> Iterator[Goal]:
        """Yield the lasting states of a known object, which rule out another of its type."""
        unit = self._history.known(subject(ask.goals[0]))
        if unit is None or any(goal.arguments[-1] == "broken" for goal in ask.goals):
            return
        for state, word in LASTING.items():
            if state in unit.states:
                yield Goal(predicate="STATE", arguments=(base_type(unit.object_type), word))


def _by_type(goal: Goal) -> Goal:
    """Return a goal with object types in place of names."""
    return replace(goal, arguments=tuple(short_type(word) for word in goal.arguments))


def draw_task(
    rng: Rng, room: KnownRoom, book: Book, kind: Kind, kinds: Mapping[str, float] = KINDS
) -> Sequence[DrawnRequest] | None:
    """Sample a task; return None if the room offers too few requests.

    `kinds` of requests have weights; `WITH_PAIRS` has two of a kind among them.
    """
    story = TaskDraft(rng, room, book, kinds)
    if kind == "simple":
        plan = [(False, False)]
    elif kind == "composite":
        plan = [(False, False)] + [(False, True)] * int(rng.integers(1, 4))
    else:
        plan = [(False, False)] * int(rng.integers(2, 4))
        plan += [(True, True)] * int(rng.integers(1, 3))
    done = all(story.ask(vague=vague, about_known=known) for vague, known in plan)
    return tuple(story.steps) if done else None
