"""Assign a cause to each failed sub-task, by the rules of docs/metrics.md.

The rules read the record; where the step log is at hand they also know what memory held.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from karma.agent.planning.refused import sentence
from karma.bench.figures.metrics import Need, TimedEpisode, needs, related_needs, types_of
from karma.journal.entries import Call, Ended, Enter, Entry, Instruction
from karma.journal.records import SubTaskRecord
from karma.types.memory import MemoryUnit

Cause = Literal["planner", "refused", "recall", "evicted", "not stored", "skill", "world", "error"]
CAUSES: tuple[Cause, ...] = get_args(Cause)

_LOST = re.compile(
    r"could not find |gave up after |not at its remembered place|into view and reach|^no \S*\||"
    r"^no \S+ there$|no place was found"
)
_MISPLANNED = re.compile(
    r"^the hand |^no \S+ is known|in the closed |cannot be |already (broken|sliced)|"
    r"must be \w+ to |does not have the property|must have the property|"
    r"not a receptacle|isn't a receptacle|is not an? \w+ object|\bfirst\.?$|has no sub-goal"
)  # what the program should have known, or done before
_NAME = re.compile(r"'([^']+)'")


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """A sub-task that failed, and why."""

    row: str
    task: str
    kind: str
    seed: int
    number: int  # of the sub-task, from 0
    instruction: str
    cause: Cause
    why: str
    is_first: bool  # of its episode: later ones may follow from it


@dataclass(frozen=True, slots=True, kw_only=True)
class _Memory:
    """Types of its room that short-term memory held: when the sub-task began, and ever before."""

    held: frozenset[str] = frozenset()
    ever: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Case:
    """A failed sub-task with the inputs of the rules."""

    sub: SubTaskRecord
    related: tuple[Need, ...]
    memory: _Memory | None  # None without a step log
    recalled: frozenset[str] = field(init=False)
    named: frozenset[str] = field(init=False)  # types that the skill calls name

    def __post_init__(self) -> None:
        object.__setattr__(self, "recalled", types_of(self.sub.recalled))
        names = (name for call in self.sub.calls for name in _NAME.findall(call.text))
        object.__setattr__(self, "named", types_of(names))

    def of_memory(self, need: Need) -> Cause:
        """Return why memory did not bring a thing into the prompt."""
        if self.memory is None:
            wanted = {kind for need in needs(self.sub.goals) for kind in need}
            return "recall" if len(wanted & self.recalled) < self.sub.hits else "evicted"
        if need & self.memory.held:
            return "recall"
        return "evicted" if need & self.memory.ever else "not stored"


def failures(episode: TimedEpisode, steps: Sequence[Entry] | None = None) -> tuple[Failure, ...]:
    """Return the failed sub-tasks of an episode with their causes, in order.

    The episode is one of `episodes_of`, so that what an error kept from being tried is in it.
    """
    record = episode.record
    memories = _memories(steps) if steps is not None else {}
    found: list[Failure] = []
    tried = [bool(sub.answers or sub.calls or sub.finished) for sub in record.subtasks]
    begun = max((number for number, one in enumerate(tried, start=1) if one), default=0)
    for number, related in enumerate(related_needs(record)):
        sub = record.subtasks[number]
        if sub.success:
            continue
        if record.error and number >= begun:
            cause: Cause = "world" if record.error.startswith("WorldLost") else "error"
            why = record.error
        else:
            memory = None if steps is None else memories.get(number, _Memory())
            cause, why = _cause(_Case(sub=sub, related=related, memory=memory))
        found.append(
            Failure(
                row=record.row,
                task=record.task,
                kind=record.kind,
                seed=record.seed,
                number=number,
                instruction=sub.instruction,
                cause=cause,
                why=why,
                is_first=not found,
            )
        )
    return tuple(found)


def count(found: Iterable[Failure]) -> Mapping[Cause, int]:
    """Return for how many episodes each cause explains the first failure, in a fixed order."""
    counts = Counter(failure.cause for failure in found if failure.is_first)
    return {cause: counts[cause] for cause in CAUSES}


# ----------------------------------------------------------------- the rules, first that applies


def _cause(case: _Case) -> tuple[Cause, str]:
    sub = case.sub
    if sub.refused is not None:
        return "refused", f"{sentence(sub.refused)} ({sub.refused.kind}, by {sub.refused.by})"
    if sub.answers and sub.answers[-1].error and not sub.finished:
        return "planner", f"no program: {sub.answers[-1].error}"
    missed = (need for need in needs(sub.unmet) if need in case.related)  # as an earlier one did
    for need in missed:
        if not need & case.named and not need & case.recalled:
            return case.of_memory(need), f"the program names no {_words(need)}"
    broken = next((call for call in sub.calls[-1:] if not call.ok), None)
    if broken is not None:
        return _of_call(case, broken)
    if not sub.answers and not sub.calls:
        return "planner", "nothing was tried"
    unnamed = [need for need in needs(sub.unmet) if not need & case.named]
    which = f"named no {_words(unnamed[0])}" if unnamed else "ran to its end"
    return "planner", f"the program {which} and left {', '.join(sub.unmet)}"


def _of_call(case: _Case, call: Call) -> tuple[Cause, str]:
    """Return the cause that the last, refused skill call shows."""
    why = f"{call.text}: {call.reason}"
    if _LOST.search(call.reason):
        wanted = types_of(_NAME.findall(call.text))
        for need in case.related:
            if need & wanted and not need & case.recalled:
                return case.of_memory(need), why
        return "skill", why
    return ("planner" if _MISPLANNED.search(call.reason) else "world"), why


def _memories(steps: Sequence[Entry]) -> dict[int, _Memory]:
    """Return the types in memory at the start of each sub-task and before, of its room."""
    room, number = "", 0
    ever: dict[str, frozenset[str]] = {}
    found = {}

    def types_in(memory: Sequence[MemoryUnit]) -> frozenset[str]:
        return types_of(unit.object_id for unit in memory if unit.scene in ("", room))

    for step in steps:
        if isinstance(step, Enter):
            room = step.scene
        elif isinstance(step, Instruction):
            number = step.number
        elif isinstance(step, Ended):
            held = types_in(step.resident)
            before = ever.get(room, frozenset()) | held
            found[number] = _Memory(held=held, ever=before)
            ever[room] = before | types_in(step.kept)
    return found


def _words(need: Need) -> str:
    return " or ".join(sorted(need))
