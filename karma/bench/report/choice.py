"""Which episodes of a run can be stepped through, and which instructions of long ones."""

import re
from collections.abc import Sequence

from karma.agent.journal.records import EpisodeRecord
from karma.errors import KarmaError

SHORT = 12  # instructions of an episode that is always shown whole
TOGETHER, LEAST = 200, 8  # instructions of all long episodes of a page; of each, at least


def episode_key(record: EpisodeRecord) -> str:
    """Return what names an episode on the page and in its address."""
    return f"{record.row}/{record.task}/{record.seed}"


def choose(records: Sequence[EpisodeRecord], wanted: str) -> list[EpisodeRecord]:
    """Return the chosen episodes, in the run's order.

    What is wanted is "all"; a number: so many, failures first, taken from the rows in turn; a
    task's id: all episodes of it; or an episode's key, "ROW/TASK/SEED".

    Raises:
        KarmaError: it is none of these.
    """
    if wanted == "all":
        return list(records)
    tasks = list(dict.fromkeys(record.task for record in records))
    if wanted in tasks:
        return [record for record in records if record.task == wanted]
    if one := [record for record in records if episode_key(record) == wanted]:
        return one
    if not wanted.isdecimal():
        raise KarmaError(
            f"--episodes {wanted!r}: neither a number nor a task nor an episode of the run\n"
            f"  To fix: all, a number, ROW/TASK/SEED, or one of {', '.join(tasks[:6])}"
            + (f" and {len(tasks) - 6} more" if len(tasks) > 6 else "")
        )
    failed = _in_turn([record for record in records if not record.success])
    solved = _in_turn([record for record in records if record.success])
    kept = {id(record) for record in [*failed, *solved][: int(wanted)]}
    return [record for record in records if id(record) in kept]


def _in_turn(records: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
    """Return the first of each row, then the second of each, and so on."""
    rows: dict[str, list[EpisodeRecord]] = {}
    for record in records:
        rows.setdefault(record.row, []).append(record)
    longest = max(map(len, rows.values()), default=0)
    return [mine[turn] for turn in range(longest) for mine in rows.values() if turn < len(mine)]


def choose_instructions(records: Sequence[EpisodeRecord], wanted: str) -> list[tuple[int, ...]]:
    """Return the numbers of the instructions that are shown of each episode, from 0.

    What is wanted is "all"; numbers from 1 and spans of them such as "1-40,77"; or "auto": all of
    short episodes; of long ones those that failed first and then others, spread evenly, so that the
    page stays usable.

    Raises:
        KarmaError: it is none of these, or no episode has such an instruction.
    """
    counts = [len(record.subtasks) + bool(record.error) for record in records]
    if wanted == "all":
        return [tuple(range(count)) for count in counts]
    if wanted != "auto":
        numbers = _numbers(wanted, max(counts, default=0))
        return [tuple(n for n in numbers if n < count) for count in counts]
    long = sum(count > SHORT for count in counts)
    share = max(LEAST, TOGETHER // long) if long else 0
    return [
        tuple(range(count)) if count <= max(SHORT, share) else _worth(record, count, share)
        for record, count in zip(records, counts, strict=True)
    ]


def _worth(record: EpisodeRecord, count: int, share: int) -> tuple[int, ...]:
    """Return so many instructions: those that failed before the others."""
    failed = [
        n for n in range(count) if n == len(record.subtasks) or not record.subtasks[n].success
    ]
    shown = _spread(failed, share)
    others = sorted(set(range(count)) - set(failed))
    return tuple(sorted((*shown, *_spread(others, share - len(shown)))))


def _spread(numbers: Sequence[int], most: int) -> list[int]:
    """Return at most so many of the numbers, evenly spread, the first among them.

    >>> _spread(range(10), 4)
    [0, 2, 5, 7]
    """
    if len(numbers) <= most:
        return list(numbers)
    return [numbers[n * len(numbers) // most] for n in range(most)]


def _numbers(wanted: str, most: int) -> list[int]:
    """Return the numbers from 0 that a text names from 1."""
    found: set[int] = set()
    for piece in map(str.strip, wanted.split(",")):
        span = re.fullmatch(r"(\d+)(?:-(\d+))?", piece, re.ASCII)
        first, last = (int(span[1]), int(span[2] or span[1])) if span else (0, 0)
        if not 1 <= first <= min(last, most):
            raise KarmaError(
                f"--instructions {wanted!r}: {piece!r} names none of 1 to {most}\n"
                f"  To fix: auto, all, or numbers and spans such as 1-{min(most, 25)}"
            )
        found.update(range(first - 1, min(last, most)))
    return sorted(found)
