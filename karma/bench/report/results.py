"""The tables of a page in words: results by row and kind, and of each task who solved it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from karma.agent.journal.formats import figure_text
from karma.agent.journal.records import KINDS, EpisodeRecord
from karma.bench.figures.columns import COLUMNS, Figures, without_repeats
from karma.bench.figures.compare import rows_of
from karma.bench.figures.counterfactual import Saving
from karma.bench.figures.metrics import Metric
from karma.bench.figures.statistics import Estimate
from karma.bench.report.choice import SHORT

_SHARES = (
    "subtasks_done", "goals_met", "retrieved", "hits", "hits_later", "re", "rt", "rt_clock",
    "re_toured",
)  # fmt: skip
_OF_SEQUENCES = ("subtasks_done", "hits_later")  # say little more of a short task
_AMOUNTS = ("explorations", "actions", "tour_places", "tour_actions", "planner_calls", "seconds")


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureText:
    """One figure in words, with its interval or ""."""

    text: str
    span: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultLine:
    """One line."""

    row: str
    kind: str
    is_first: bool  # of its row
    figures: Figures
    values: tuple[FigureText, ...]  # one for each of `columns`


def columns(lines: Sequence[Figures]) -> tuple[Metric | Saving, ...]:
    """Return the columns of the table in which something was measured."""
    has_sequences = any(line.kind == "sequence" for line in lines)
    return tuple(
        COLUMNS[key]
        for key in (*_SHARES, *_AMOUNTS)
        if (has_sequences or key not in _OF_SEQUENCES)
        and any(line.values[key].value is not None for line in lines)
    )


def result_lines(lines: Sequence[Figures]) -> tuple[ResultLine, ...]:
    """Return the table of a run."""
    shown, last, found = columns(lines), "", []
    for line in without_repeats(lines):
        values = tuple(_cell(one, line.values[one.key]) for one in shown)
        first = line.row != last
        found.append(
            ResultLine(row=line.row, kind=line.kind, is_first=first, figures=line, values=values)
        )
        last = line.row
    return tuple(found)


def _cell(column: Metric | Saving, found: Estimate) -> FigureText:
    text = _signed(figure_text(found.value, column.digits))
    if column.key not in _SHARES or found.interval is None:
        return FigureText(text=text)
    low, high = (_signed(figure_text(end)) for end in (found.interval.low, found.interval.high))
    return FigureText(text=text, span=f"{low} to {high}" if "−" in low else f"{low}–{high}")


def _signed(text: str) -> str:
    """Return a figure with a minus that is one.

    >>> _signed("-0.31")
    '−0.31'
    """
    return text.replace("-", "−")


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
        cells=tuple(_task_cell(row, [r for r in mine if r.row == row]) for row in rows),
    )


def _task_cell(row: str, mine: Sequence[EpisodeRecord]) -> TaskCell:
    mine = [record for record in mine if not record.unjudged]
    failed = [record for record in mine if not record.success]
    shown = next(iter(failed or mine), None)
    cell = TaskCell(row=row, episodes=len(mine), successes=len(mine) - len(failed), shown=shown)
    if shown is None:
        return cell
    parts = cell.failed[:SHORT] if cell.is_long else tuple(range(len(shown.subtasks)))
    return replace(cell, parts=parts)
