"""Whole conversations, and a judge of each turn that goes by the world's true state."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from karma.assistant.agent import Agent
from karma.assistant.replies import AgentReply
from karma.errors import KarmaError
from karma.goals.goals import GoalTracker, parse_goal
from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.places import HAND
from karma.household.saying import name_of
from karma.household.types import object_types
from karma.household.uses import without_basin
from support.judging import tracking, watched

Verdict = Literal[
    "right", "does not know", "refused", "wrong, said so", "wrong, said done", "wrong answer", "–"
]
VERDICTS: tuple[Verdict, ...] = Verdict.__args__  # type: ignore[attr-defined]
_IS: Mapping[str, Callable[[Mapping[str, Any]], bool]] = {
    "open": lambda one: one["isOpen"],
    "closed": lambda one: not one["isOpen"],
    "on": lambda one: one["isToggled"],
    "off": lambda one: not one["isToggled"],
    "dirty": lambda one: one["isDirty"],
    "clean": lambda one: not one["isDirty"],
    "sliced": lambda one: one["isSliced"] or one["objectType"].endswith("Sliced"),
    "filled": lambda one: one["isFilledWithLiquid"],
    "empty": lambda one: not one["isFilledWithLiquid"],
    "broken": lambda one: one["isBroken"],
    "hot": lambda one: one["temperature"] == "Hot",
    "cold": lambda one: one["temperature"] == "Cold",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """What is said, and what is to come of it."""

    text: str
    wanted: tuple[str, ...]  # any of these will do

    @property
    def kind(self) -> str:
        """Whether it is an errand, a question, or neither."""
        word = self.wanted[0].split()[0]
        if word in ("where", "is", "in", "yes", "no", "says"):
            return "question"
        return word if word in ("told", "nothing") else "errand"


@dataclass(frozen=True, slots=True, kw_only=True)
class Talk:
    """One conversation."""

    number: int
    scene: str
    turns: tuple[Turn, ...]


def read_talks(path: Path) -> list[Talk]:
    """Return the conversations of a file."""
    found: list[Talk] = []
    for number, block in enumerate(re.split(r"^@ ", path.read_text(), flags=re.MULTILINE)[1:], 1):
        scene, *lines = block.strip().splitlines()
        parts = (line.partition(" => ") for line in lines)
        turns = tuple(Turn(text=text, wanted=tuple(w.split(" or "))) for text, _, w in parts)
        found.append(Talk(number=number, scene=scene, turns=turns))
    return found


class TalkJudge:
    """Says a turn to an agent, and looks at its world."""

    def __init__(self, agent: Agent) -> None:
        self.agent, self.world = agent, agent._world
        self.began = {one["objectId"]: one["parentReceptacles"] for one in self.objects}

    @property
    def objects(self) -> list[dict[str, Any]]:
        return self.world.last_event.metadata["objects"]

    def turn(self, turn: Turn) -> tuple[Verdict, str]:
        """Say a turn; returns its verdict, and what was said to it."""
        goals = [
            tuple(parse_goal(goal) for goal in wanted.split(";")) if "(" in wanted else ()
            for wanted in turn.wanted
        ]
        trackers = [tracking(self.world, turn.text, some) for some in goals]
        with watched(self.world, *trackers) as changed:
            try:
                reply = self.agent.do(turn.text)
            except KarmaError as error:
                return "refused", str(error)
        found = [
            self._verdict(wanted, reply, changed(), tracker, some)
            for wanted, tracker, some in zip(turn.wanted, trackers, goals, strict=True)
        ]
        return min(found, key=VERDICTS.index), repr(reply)

    def _verdict(
        self, wanted: str, reply: AgentReply, changed: bool, tracker: GoalTracker, goals: Any
    ) -> Verdict:
        word, silent = wanted.split()[0], reply.status in ("refused", "asked", "answered")
        if goals or word == "back":
            if silent and not changed:
                return "refused"
            if reply.status != "done":
                return "wrong, said so"
            so = self._is_back(wanted.split()[1]) if word == "back" else not tracker.unmet(
                goals, self.world.last_event
            )  # fmt: skip
            return "right" if so else "wrong, said done"
        if changed:
            return "wrong, said done" if reply.status == "done" else "wrong, said so"
        if word == "nothing":
            return "right"
        if reply.status != "answered":
            return "refused"
        if word == "told":
            return "right"
        answers = [part.answer for part in reply.parts if part.answer is not None]
        text = " ".join(line for one in answers for line in one.lines)
        so = self._is_true(wanted, text)
        unknown = not any(one.known for one in answers) and word != "no"
        return "right" if so else "does not know" if unknown else "wrong answer"

    def _of(self, kind: str) -> list[dict[str, Any]]:
        return [one for one in self.objects if base_type(one["objectType"]) == kind]

    def _is_back(self, kind: str) -> bool:
        return all(
            one["parentReceptacles"] == self.began[one["objectId"]] for one in self._of(kind)
        )

    def _is_true(self, wanted: str, text: str) -> bool:
        word, _, rest = wanted.partition(" ")
        low = text.lower()
        if word in ("yes", "no"):
            return low.startswith(word)
        if word == "says":
            return rest in low
        if word == "is":
            kind, state = rest.split()
            so = [bool(_IS[state](one)) for one in self._of(kind)]
            return (low.startswith("yes") and any(so)) or (low.startswith("no") and not all(so))
        if word == "where":
            return self._places_are_true(rest, low)
        kind, _, named = rest.partition(":")
        there = {base_type(one["objectType"]) for one in self.objects if kind in self._places(one)}
        said = {
            name for name, one in object_types().items()
            if one.can("pickupable") and name != kind
            and re.search(rf"\bthe {re.escape(name_of(name).lower())}\b", low)
        }  # fmt: skip
        return {*named.split()} <= said and {*map(name_of, said)} <= {*map(name_of, there)}

    def _places(self, one: Mapping[str, Any]) -> set[str]:
        if one["isPickedUp"]:
            return {HAND}
        return {without_basin(type_of(name)) for name in one["parentReceptacles"] or ()}

    def _places_are_true(self, kind: str, low: str) -> bool:
        """Return whether each sentence that tells where it is names a place that has one."""
        there = {
            name_of(place).lower() if place != HAND else place
            for one in self._of(kind) for place in self._places(one)
        }  # fmt: skip
        told = [part for part in re.split(r"\.\s+|\.$", low) if " is " in f" {part} "]
        fixed = not object_types()[kind].can("pickupable")
        named = [any(re.search(rf"\b{re.escape(p)}\b", part) for p in there) for part in told]
        return bool(told) and (all(named) or (fixed and "in this room" in low))
