"""What a plug-in sees of an agent that carries out an instruction."""

from collections.abc import Callable, Collection, Generator, Mapping
from dataclasses import dataclass
from typing import Protocol

from karma.agent.attempts import Attempts
from karma.contracts import (
    Advice,
    AgentEvent,
    Found,
    MemoryUnit,
    SeenObject,
    SkillCall,
    SkillResult,
    SubTask,
)

LOOK_OVER = "LookOver"  # a call: look at all that is on a surface or in a container
SURVEY = "Survey"  # a call: look around from every place of the map, and open nothing
NO_ADVICE = Advice()


@dataclass(frozen=True, slots=True, kw_only=True)
class Remembered:
    """What the agent remembers of the room that it is in."""

    units: tuple[MemoryUnit, ...]  # of short-term memory, the last used last
    fixtures: Mapping[str, str]  # id -> type of the map's furniture
    types: frozenset[str]  # of all objects that it knows of
    held: SeenObject | None
    left: Mapping[str, str]  # id of what it opened or switched on -> skill that undoes that
    taken: Mapping[str, str]  # id -> place that it was taken from


class Session(Protocol):
    """An agent with one instruction: what carries that out acts through this alone."""

    def do(
        self, subtask: SubTask, advice: Advice = NO_ADVICE
    ) -> Generator[AgentEvent, None, Attempts]:
        """Plan and act until a program succeeds or the attempts are used up."""

    def call(self, call: SkillCall, aside: Collection[str] = ()) -> SkillResult:
        """Run one skill, `LOOK_OVER` or `SURVEY`; a search passes over the ids `aside`."""

    def seen(self) -> Mapping[str, SeenObject]:
        """Return the latest sight of each object of the room that is not known to be gone."""

    def remembered(self) -> Remembered:
        """Return what is remembered of the room, and what was left open or on."""

    def say(self, text: str, found: Found) -> None:
        """Put a line into the report: what is so, and by what that is known."""


Executor = Callable[[Session], Generator[AgentEvent, None, bool]]
"""Carries out an instruction; returns whether all of it was done."""
