"""What pages show of figures: results in words, tasks and who solved them, and plots as numbers."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace

from karma.agent.journal.formats import figure_text
from karma.agent.journal.records import ALL, KINDS, EpisodeRecord
from karma.bench.figures.columns import COLUMNS, Figures, without_repeats
from karma.bench.figures.compare import rows_of
from karma.bench.figures.failures import CAUSES, Failure, count
from karma.bench.figures.metrics import Metric
from karma.bench.figures.statistics import Estimate

SHORT = 12  # instructions of an episode that is always shown whole
_SHARES = (
    "subtasks_done", "goals_met", "retrieved", "hits", "hits_later", "re", "rt", "rt_clock",
    "re_toured",
)  # fmt: skip
_OF_SEQUENCES = ("subtasks_done", "hits_later")  # say little more of a short task
_AMOUNTS = ("explorations", "actions", "tour_places", "tour_actions", "planner_calls", "seconds")


def episode_key(record: EpisodeRecord) -> str:
    """Return what names an episode on the page and in its address."""
    return f"{record.row}/{record.task}/{record.seed}"


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


def columns(lines: Sequence[Figures]) -> tuple[Metric, ...]:
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


def _cell(column: Metric, found: Estimate) -> FigureText:
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


LEFT, WIDTH = 128.0, 192.0  # where the scale begins, how long it is
TOP = 12.0
LINE = 11.0  # apart
LETTERS = 18  # of a row's name that fit into one of its two lines


@dataclass(frozen=True, slots=True, kw_only=True)
class Text:
    """A line of a row's name, or a number on the scale."""

    x: float = 0.0
    y: float = 0.0
    text: str
    title: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """One bar, or one piece of a stacked one."""

    x: float
    y: float
    width: float
    height: float
    style: str
    title: str
    inside: str = ""
    after: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dot:
    """One rate with its interval."""

    x: float
    y: float
    low: float | None
    high: float | None
    style: str
    title: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """One figure."""

    title: str
    height: float
    ticks: tuple[Text, ...]
    names: tuple[Text, ...]
    bars: tuple[Bar, ...] = ()
    dots: tuple[Dot, ...] = ()
    key: tuple[str, ...] = ()
    note: str = ""


def success_plot(lines: Sequence[Figures]) -> Plot:
    """Return success rates with their intervals, a line of dots per kind under each row's name.

    Those of sequences are of their instructions.
    """
    rows = list(dict.fromkeys(line.row for line in lines))
    kinds = [kind for kind in KINDS if any(line.kind == kind for line in lines)] or [ALL]
    band = 11.0 * len(kinds) + 12.0
    rates = [
        (line, line.values["subtasks_done" if line.kind == "sequence" else "success"])
        for line in lines
    ]
    dots = [
        Dot(
            x=_at(rate.value),
            y=TOP + rows.index(line.row) * band + 11.0 * (kinds.index(line.kind) + 0.5),
            low=_at(rate.interval.low) if rate.interval else None,
            high=_at(rate.interval.high) if rate.interval else None,
            style=f"s{kinds.index(line.kind) + 1}",
            title=_rate_line(line, rate),
        )
        for line, rate in rates
        if rate.value is not None and line.kind in kinds
    ]
    middle = 11.0 * len(kinds) / 2
    notes = ["Share of the tasks; of sequences, of their instructions."]
    if set(kinds) == {"sequence"}:
        notes = ["Share of the sequences' instructions."]
    elif "sequence" not in kinds:
        notes = ["Share of the tasks."]
    if any(rate.interval for _, rate in rates):
        notes.append("Whiskers: 95 % intervals.")
    return Plot(
        title="Tasks solved",
        height=TOP + band * len(rows) + 16.0,
        ticks=_scale(1.0),
        names=_names(rows, band, middle),
        dots=tuple(dots),
        key=tuple(kinds),
        note=" ".join(notes),
    )


def bar_plot(title: str, values: Sequence[tuple[str, float | None]]) -> Plot:
    """Return one bar per row; rows where nothing was measured have none."""
    lines = [
        (row, [] if value is None else [(value, "s1", f"{row}: {figure_text(value)}")])
        for row, value in values
    ]
    return _bars(title, lines)


def cause_plot(rows: Sequence[str], failures: Sequence[Failure]) -> Plot:
    """Return how many episodes of each row failed, and of what."""
    lines = []
    for row in rows:
        counts = count((one for one in failures if one.row == row), first_only=True)
        styles = {cause: f"s{number}" for number, cause in enumerate(CAUSES, start=1)}
        pieces = [(n, styles[one], f"{row}: {one}: {n}") for one, n in counts.items() if n]
        lines.append((row, pieces))
    note = "Number of episodes, by the cause of the first instruction that failed."
    return _bars("Why episodes failed", lines, key=CAUSES, note=note)


def _bars(
    title: str,
    lines: Sequence[tuple[str, Sequence[tuple[float, str, str]]]],
    *,
    key: tuple[str, ...] = (),
    note: str = "",
) -> Plot:
    """Return a bar per row, of pieces in a row's order: amount, style, title.

    With a key amounts stand inside of pieces that are wide enough, without one after them.
    """
    sums = [sum(amount for amount, _, _ in pieces) for _, pieces in lines]
    most = _round_up(float(max(sums, default=0.0)))
    bars: list[Bar] = []
    for number, (_, pieces) in enumerate(lines):
        begin = LEFT
        for amount, style, words in pieces:
            width = round(WIDTH * amount / most, 1) if most else 0.0
            bars.append(
                Bar(
                    x=begin, y=TOP + number * 24.0 + 2.0, width=width, height=13.0, style=style,
                    title=words,
                    inside=str(amount) if key and width > 14 else "",
                    after="" if key else figure_text(amount, 1 if amount < 100 else 0),
                )
            )  # fmt: skip
            begin += width
    return Plot(
        title=title,
        height=TOP + 24.0 * len(lines) + 16.0,
        ticks=_scale(most),
        names=_names([row for row, _ in lines], 24.0, 8.5),
        bars=tuple(bars),
        key=key,
        note=note,
    )


def _names(rows: Sequence[str], band: float, middle: float) -> tuple[Text, ...]:
    found = []
    for number, row in enumerate(rows):
        lines = _folded(row)
        top = TOP + number * band + middle - LINE * (len(lines) - 1) / 2
        found += [Text(y=top + LINE * n, text=text, title=row) for n, text in enumerate(lines)]
    return tuple(found)


def _folded(name: str) -> list[str]:
    """Return a name in one or two lines that fit.

    >>> _folded("HELPER (furniture in the prompt)")
    ['HELPER (furniture', 'in the prompt)']
    >>> _folded("KARMA")
    ['KARMA']
    """
    return textwrap.wrap(name, LETTERS, max_lines=2, placeholder="…")


def _scale(most: float) -> tuple[Text, ...]:
    return tuple(
        Text(x=LEFT + WIDTH * part, text=f"{most * part:g}")
        for part in ((0.0, 0.25, 0.5, 0.75, 1.0) if most else ())
    )


def _at(rate: float) -> float:
    return round(LEFT + WIDTH * rate, 1)


def _rate_line(line: Figures, rate: Estimate) -> str:
    successes, ends = round((rate.value or 0.0) * rate.number), rate.interval
    text = f"{line.row}, {line.kind}: {successes} of {rate.number}"
    return f"{text}, {figure_text(ends.low)} to {figure_text(ends.high)}" if ends else text


def _round_up(value: float) -> float:
    """Return the next round number: 1, 2, 4, 6, 8 or 10 times a power of ten.

    >>> [_round_up(v) for v in (0.0, 0.03, 3.5, 17.0, 398.0)]
    [0.0, 0.04, 4.0, 20.0, 400.0]
    """
    if value <= 0:
        return 0.0
    power = 1.0
    while power * 10 <= value:
        power *= 10
    while power > value:
        power /= 10
    return next(round(step * power, 9) for step in (1, 2, 4, 6, 8, 10) if step * power >= value)
