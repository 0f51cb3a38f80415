"""What an episode leaves behind, one JSON line each.

A record is the same in every run of the same experiment. Whatever may differ between two equal
runs, such as times and what a cache held, is in the episode's timing, a line of its own.

An episode that was not run, by no fault of the agent's, is kept apart from records and in no rate,
and is done again: a server that fails, a simulator that is lost, a room that is missing. Where
several in a row were not run, what they need is gone, and the run ends.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import msgspec

from karma.errors import FileError
from karma.files import read_bytes, to_json
from karma.journal.entries import Answer, Call
from karma.journal.folder import NOT_RUN, TURNS, read_lines
from karma.models.session import Spent
from karma.types.completion import Engine, KvState
from karma.types.memory import Tour
from karma.types.planning import RefusedRequest
from karma.types.tasks import Kind

KINDS: tuple[str, ...] = get_args(Kind)
ALL, TRAINED, NOT_TRAINED = "all", "in training", "not in training"  # beside kinds
Key = tuple[str, str, int]  # row, task, seed: what names an episode of a run
SAID = "said"  # the task of a conversation, and its kind


@dataclass(frozen=True, slots=True, kw_only=True)
class OfEpisode:
    """A line about one episode of a run."""

    row: str
    task: str
    seed: int

    @property
    def key(self) -> Key:
        """What names the episode."""
        return self.row, self.task, self.seed


@dataclass(frozen=True, slots=True, kw_only=True)
class SubTaskRecord:
    """One instruction of an episode."""

    instruction: str
    goals: tuple[str, ...]
    unmet: tuple[str, ...]  # goals that did not hold when it ended
    finished: bool  # the last program ran to its end
    answers: tuple[Answer, ...]
    calls: tuple[Call, ...]
    queries: int  # things that can be carried which the goals mention
    hits: int  # of those, in short-term memory when the instruction came
    at_start: tuple[str, ...] = ()  # goals that held already when the task began
    scene: str = ""  # name of the room; "" is the episode's
    hosted: tuple[Spent, ...] = ()  # what hosted models of all roles cost, without its seconds

    @property
    def success(self) -> bool:
        """Whether all its goals held."""
        return not self.unmet

    @property
    def recalled(self) -> tuple[str, ...]:
        """The object ids in the first prompt."""
        return self.answers[0].recalled if self.answers else ()

    @property
    def timed_out(self) -> bool:
        """Whether the clock cut off an answer, so that another run may come out otherwise."""
        return any(answer.finish == "time" for answer in self.answers)

    @property
    def refused(self) -> RefusedRequest | None:
        """Why the planner would not carry it out; None where it tried."""
        return self.answers[-1].refused if self.answers else None


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeRecord(OfEpisode):
    """One task done once by one row."""

    method: str = ""  # its own name, which tells its form too; "" where none came to act
    kind: str  # of the task, or its group in a benchmark of others
    scene: str
    notes: tuple[str, ...]  # what the task's loader could not resolve
    trained: bool | None = None  # its sentences stand in training data; None: not known
    subtasks: tuple[SubTaskRecord, ...]
    error: str = ""  # why it ended early; errors stay in the denominator
    unjudged: str = ""  # why no goal of the task can be met by anybody: it is in no figure
    draw: int = 0  # starts of the seed that were passed over, as something was done in them
    hosted: tuple[Spent, ...] = ()  # by the instruction that the error ended, see `SubTaskRecord`
    tours: tuple[Tour, ...] = ()  # that made the maps it used, one a room; no part of its calls

    @property
    def success(self) -> bool:
        """Whether every sub-task succeeded (KARMA §4.2); a task without goals cannot."""
        asked = any(sub.goals for sub in self.subtasks)
        return asked and not self.error and all(sub.success for sub in self.subtasks)

    @property
    def timed_out(self) -> bool:
        """Whether the clock cut off an answer in it: no run need be equal to another there."""
        return any(sub.timed_out for sub in self.subtasks)

    @property
    def to_do(self) -> bool:
        """Whether any goal was still to be met when the task began."""
        return not self.subtasks or any(set(sub.goals) - set(sub.at_start) for sub in self.subtasks)

    @property
    def rooms(self) -> tuple[str, ...]:
        """The room of each instruction."""
        return tuple(sub.scene or self.scene for sub in self.subtasks)

    def spent(self) -> tuple[Spent, ...]:
        """Return what hosted models cost in it, also where it ended early."""
        return (*(one for sub in self.subtasks for one in sub.hosted), *self.hosted)


def kinds_of(records: Iterable[EpisodeRecord]) -> tuple[str, ...]:
    """Return the kinds and groups of some records: the paper's in its order, then as they come."""
    there = dict.fromkeys(record.kind for record in records)
    return (*(one for one in KINDS if one in there), *(one for one in there if one not in KINDS))


def is_of(record: EpisodeRecord, kind: str) -> bool:
    """Return whether an episode counts for a kind, for all, or for what is in training or not."""
    if kind in (TRAINED, NOT_TRAINED):
        return record.trained is (kind == TRAINED)
    return kind in (record.kind, ALL)


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerTiming:
    """What one planner call took on the machine that did it; None where it is not known."""

    first_token_s: float | None
    total_s: float
    reused_tokens: int | None  # of the prompt, from state kept of an earlier one
    state: KvState | None = None  # where that state came from
    engine: Engine | None = None  # that computed it; None where it is not ours to know


@dataclass(frozen=True, slots=True, kw_only=True)
class SubTaskTiming:
    """What one instruction took."""

    seconds: float
    answers: tuple[AnswerTiming, ...] = ()  # one for each answer of the record
    hosted_s: tuple[float, ...] = ()  # waited, one for each entry of the record's `hosted`


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeTiming(OfEpisode):
    """What one episode took; the same order as its record."""

    subtasks: tuple[SubTaskTiming, ...]
    hosted_s: tuple[float, ...] = ()  # of the instruction that an error ended

    @property
    def seconds(self) -> float:
        """All instructions that came to their end."""
        return sum(sub.seconds for sub in self.subtasks)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayedTiming(OfEpisode):
    """What one episode of a benchmark took."""

    seconds: float


def key_of(record: Any) -> Key:
    """Return what names an episode, by its record."""
    return record.row, record.task, record.seed


def untimed(spent: Iterable[Spent]) -> tuple[Spent, ...]:
    """Return costs as a record keeps them: without the seconds, which no two runs share."""
    return tuple(replace(one, seconds=None) for one in spent)


def waited(spent: Iterable[Spent]) -> tuple[float, ...]:
    """Return the seconds that `untimed` leaves out."""
    return tuple(one.seconds or 0.0 for one in spent)


def spent_by(record: EpisodeRecord, timing: EpisodeTiming | None) -> tuple[Spent, ...]:
    """Return what hosted models cost in an episode, with the seconds if they are known."""
    if timing is None:
        return record.spent()
    seconds = (*(s for sub in timing.subtasks for s in sub.hosted_s), *timing.hosted_s)
    pairs = zip(record.spent(), seconds, strict=True)
    return tuple(replace(one, seconds=s) for one, s in pairs)


def read_records(path: Path) -> list[EpisodeRecord]:
    """Read the records of a run, as `read_lines` does."""
    return read_lines(path, EpisodeRecord)


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """One request or question, and what was said to it."""

    said: str
    status: str  # what became of it: "done", "answered", "refused" ...
    lines: tuple[tuple[str, str], ...]  # of the answer: what kind of line, and its words
    instruction: int | None = None  # which of the episode it is; None: nothing was tried for it


def turns_file(turns: Iterable[Turn]) -> dict[str, bytes]:
    """Return the file that holds a conversation, by its path in the run's folder."""
    return {TURNS: to_json(list(turns), indent=2)}


def read_turns(folder: Path) -> tuple[Turn, ...]:
    """Return the conversation of a run, () where it is none; FileError where it is damaged."""
    path = folder / TURNS
    if not path.exists():
        return ()
    try:
        return msgspec.json.decode(read_bytes(path), type=tuple[Turn, ...])
    except msgspec.MsgspecError as error:
        raise FileError(path, f"is damaged: {error}", fix="talk again") from error


# ----------------------------------------------------------------- episodes that were not run

IN_A_ROW = 3  # after which a run ends


@dataclass(frozen=True, slots=True, kw_only=True)
class NotRun(OfEpisode):
    """One of them, and why."""

    reason: str
    alone: bool = False  # others need not fail as it did


def read_not_run(folder: Path) -> tuple[NotRun, ...]:
    """Read which episodes of a run were not run when it was last at work."""
    return tuple({one.key: one for one in read_lines(folder / NOT_RUN, NotRun)}.values())


def in_words(found: Sequence[NotRun]) -> str:
    """Return how many there are in each row, and each reason once with the first that had it.

    >>> print(in_words([NotRun(row="KARMA", task="a", seed=1, reason="no such room")]))
    1 not run, in no rate (KARMA 1); the same command does it again
      KARMA/a/1: no such room
    """
    if not found:
        return ""
    rows = [one.row for one in found]
    counts = ", ".join(f"{row} {rows.count(row)}" for row in dict.fromkeys(rows))
    first = {one.reason: one for one in reversed(found)}
    them = "them" if len(found) > 1 else "it"
    head = f"{len(found)} not run, in no rate ({counts}); the same command does {them} again"
    reasons = (f"  {'/'.join(map(str, one.key))}: {one.reason}" for one in reversed(first.values()))
    return "\n".join([head, *reasons])
