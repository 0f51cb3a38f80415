"""What happens while an instruction is carried out: answers, results, the report."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from karma.types.completion import Completion
from karma.types.memory import MemoryChange, MemoryUnit, Recalled, Tour
from karma.types.planning import End, FailedProgram, Prompt, RefusedRequest, SkillCall


@dataclass(frozen=True, slots=True, kw_only=True)
class SkillResult:
    """What one skill did; a refusal of the world is a value with a reason."""

    call: SkillCall
    ok: bool
    reason: str = ""
    detail: str = ""  # a refusal in full, with ids: the blocker, what is there, what would help
    actions: int = 0  # world steps taken
    explorations: int = 0  # area nodes visited in search of an object
    object_ids: tuple[str, ...] = ()  # what the names resolved to


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """One planner call: what was recalled, asked, answered, and whether it parsed."""

    prompt: Prompt
    completion: Completion
    calls: tuple[SkillCall, ...]
    names: Mapping[str, str]  # what short names in the calls stand for (name -> object id)
    recalled: tuple[Recalled, ...] = ()  # of short-term memory, the best first
    units: tuple[MemoryUnit, ...] = ()  # in the prompt, the last used last
    refused: RefusedRequest | None = None  # in place of calls: the request, not the answer
    error: str = ""  # why the answer was refused; quoted in the next prompt
    failure: FailedProgram | None = None  # the same with the program, for planners that can read it
    dropped: tuple[str, ...] = ()  # lines of the answer that were no part of the program
    examples: tuple[str, ...] = ()  # instructions of the worked examples that were retrieved


@dataclass(frozen=True, slots=True, kw_only=True)
class Review:
    """An answer after its checker."""

    answer: Plan
    wrong: str = ""  # why its program is not carried out
    own: Plan | None = None  # the checker's program in its place
    may_refuse: bool = True  # False: the next answer has to be a program


Found = Literal["seen", "done", "otherwise", "unseen"]  # done: by the agent's deed, out of sight


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """What a program was to bring about, held against what the agent has seen, never the truth."""

    text: str  # "the apple is in the fridge"
    found: Found
    note: str = ""  # what was seen in its place

    def __str__(self) -> str:
        """Return it as people are told."""
        said = {"done": "done, not seen", "otherwise": "no", "unseen": "not seen"}
        note = f", {self.note}" if self.note else ""
        return f"{self.text}: {said.get(self.found, self.found)}{note}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The last thing a method yields for an instruction."""

    finished: bool  # every skill of the last program succeeded, and all that the first was to do
    resident: tuple[MemoryUnit, ...]  # short-term memory before the instruction
    handled_ids: tuple[str, ...]  # in the order of use
    kept: tuple[MemoryUnit, ...] = ()  # short-term memory after it
    tour: Tour | None = None  # that made the map in use, now or earlier; no part of the episode
    checks: tuple[Check, ...] = ()  # of its programs, where the method looks back
    change: MemoryChange | None = None  # what memory has learnt, where anything was done
    end: End | None = None  # in the model's words or by facts, in tool and goal mode


AgentEvent = Plan | SkillResult | Outcome
"""What happens while an instruction is carried out: an answer, a call's result, the report."""
