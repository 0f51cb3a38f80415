"""The interface through which a plug-in carries out an instruction with the agent."""

from collections.abc import Callable, Collection, Generator, Mapping
from dataclasses import dataclass
from typing import Protocol

from karma.agent.attempts import Attempts
from karma.types.events import AgentEvent, Found, SkillResult
from karma.types.memory import MemoryUnit
from karma.types.observation import SeenObject
from karma.types.planning import Advice, End, SkillCall
from karma.types.tasks import SubTask

LOOK_OVER = "LookOver"  # a call: look at everything on a surface or in a container
SURVEY = "Survey"  # a call: look around from every place of the map, and open nothing
NO_ADVICE = Advice()


@dataclass(frozen=True, slots=True, kw_only=True)
class Remembered:
    """The agent's memory of the current room."""

    units: tuple[MemoryUnit, ...]  # of short-term memory, the last used last
    fixtures: Mapping[str, str]  # id -> type of the map's furniture
    types: frozenset[str]  # of all known objects
    held: SeenObject | None
    left: Mapping[str, str]  # id of an opened or running object -> skill that undoes it
    taken: Mapping[str, str]  # id -> receptacle it was taken from


class InstructionSession(Protocol):
    """The agent while it carries out an instruction; an executor acts through it only."""

    def do(
        self, subtask: SubTask, advice: Advice = NO_ADVICE
    ) -> Generator[AgentEvent, None, Attempts]:
        """Plan and act until a program succeeds or the attempts are used up."""

    def call(
        self, call: SkillCall, aside: Collection[str] = (), *, reported: bool = False
    ) -> SkillResult:
        """Run a skill, `LOOK_OVER` or `SURVEY`; a search ignores the ids in `aside`.

        The effects of a `reported` call are lines of the report.
        """

    def seen(self) -> Mapping[str, SeenObject]:
        """Return the latest sight of each object of the room that is not known to be gone."""

    def remembered(self) -> Remembered:
        """Return the memory of the room, and the doors and switches left open or on."""

    def say(self, text: str, found: Found) -> None:
        """Add a line to the report: a state, and the evidence for it."""


Executor = Callable[[InstructionSession], Generator[AgentEvent, None, bool | End]]
"""Carries out an instruction; returns whether it finished, or how it ended."""
