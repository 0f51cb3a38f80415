"""Episodes that were not run, by no fault of the agent's: kept apart from records, done again.

A server that fails, a simulator that is lost, a room that is missing: such an episode is in no
rate. Where several in a row were not run, what they need is gone, and the run ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from karma.agent.journal.folder import read_lines
from karma.agent.journal.records import OfEpisode

FILE = "not_run.jsonl"  # of a run's folder
IN_A_ROW = 3  # after which a run ends


@dataclass(frozen=True, slots=True, kw_only=True)
class NotRun(OfEpisode):
    """One of them, and why."""

    reason: str
    alone: bool = False  # others need not fail as it did


def read_not_run(folder: Path) -> tuple[NotRun, ...]:
    """Read which episodes of a run were not run when it was last at work."""
    return tuple({one.key: one for one in read_lines(folder / FILE, NotRun)}.values())


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
