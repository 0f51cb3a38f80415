"""Which episodes of a run can be stepped through."""

from collections.abc import Sequence

from karma.bench.records import EpisodeRecord
from karma.errors import KarmaError

DEFAULT = 8


def choose(records: Sequence[EpisodeRecord], wanted: str) -> list[EpisodeRecord]:
    """Return the chosen episodes, in the run's order.

    Args:
        records: of the run.
        wanted: "all"; a number: so many, failures first, taken from the rows in turn; or a task's
            id: all episodes of it.

    Raises:
        KarmaError: it is none of these.
    """
    if wanted == "all":
        return list(records)
    tasks = list(dict.fromkeys(record.task for record in records))
    if wanted in tasks:
        return [record for record in records if record.task == wanted]
    if not wanted.isdecimal():
        raise KarmaError(
            f"--episodes {wanted!r}: neither a number nor a task of the run\n"
            f"  To fix: all, a number, or one of {', '.join(tasks[:6])}"
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
