"""What the page says of each task: who solved it, and one episode of each row to look into."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from karma.agent.journal.records import KINDS, EpisodeRecord
from karma.bench.report.choice import SHORT


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskCell:
    """One task of one row, over the seeds."""

    row: str
    episodes: int
    successes: int
    shown: EpisodeRecord | None  # the first that failed, else the first; None when there is none
    parts: tuple[int, ...] = ()  # instructions of that one which are told: of many, failed ones

    @property
    def failed(self) -> tuple[int, ...]:
        """Numbers of all instructions of the shown episode that failed, from 0."""
        parts = self.shown.subtasks if self.shown else ()
        return tuple(number for number, part in enumerate(parts) if not part.success)

    @property
    def is_long(self) -> bool:
        """Whether the shown episode has too many instructions to tell them all."""
        return self.shown is not None and len(self.shown.subtasks) > SHORT


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskLine:
    """One task."""

    task: str
    kind: str
    scene: str
    instructions: tuple[str, ...]
    cells: tuple[TaskCell, ...]  # one a row
    unjudged: str = ""  # why nobody can be judged by it

    @property
    def is_long(self) -> bool:
        """Whether it has too many instructions to tell them all."""
        return len(self.instructions) > SHORT

    @property
    def words(self) -> str:
        """What is asked for; of a long sequence how it begins."""
        if not self.is_long:
            return " ".join(self.instructions)
        return f"{len(self.instructions)} instructions: {' '.join(self.instructions[:SHORT])} …"


def rows_of(records: Iterable[EpisodeRecord]) -> tuple[str, ...]:
    """Return the rows in the order in which they appear."""
    return tuple(dict.fromkeys(record.row for record in records))


def task_lines(records: Sequence[EpisodeRecord]) -> tuple[TaskLine, ...]:
    """Return one line per task: simple ones first, then in the order in which they appear."""
    rows = rows_of(records)
    by_task: dict[str, list[EpisodeRecord]] = {}
    for record in records:
        by_task.setdefault(record.task, []).append(record)
    lines = [_task_line(task, mine, rows) for task, mine in by_task.items()]
    rank = {kind: number for number, kind in enumerate(KINDS)}
    return tuple(sorted(lines, key=lambda line: rank.get(line.kind, len(rank))))


def _task_line(task: str, mine: Sequence[EpisodeRecord], rows: Sequence[str]) -> TaskLine:
    longest = max(mine, key=lambda record: len(record.subtasks))
    return TaskLine(
        task=task,
        kind=longest.kind,
        scene=longest.scene,
        instructions=tuple(part.instruction for part in longest.subtasks),
        unjudged=longest.unjudged,
        cells=tuple(_cell(row, [r for r in mine if r.row == row]) for row in rows),
    )


def _cell(row: str, mine: Sequence[EpisodeRecord]) -> TaskCell:
    mine = [record for record in mine if not record.unjudged]
    failed = [record for record in mine if not record.success]
    shown = next(iter(failed or mine), None)
    cell = TaskCell(row=row, episodes=len(mine), successes=len(mine) - len(failed), shown=shown)
    if shown is None:
        return cell
    parts = cell.failed[:SHORT] if cell.is_long else tuple(range(len(shown.subtasks)))
    return replace(cell, parts=parts)
