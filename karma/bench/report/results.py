"""The table of results: a line per row and kind, in words."""

from collections.abc import Iterator
from dataclasses import dataclass

from karma.agent.journal.formats import figure_text
from karma.bench.figures.columns import COLUMNS, Figures, without_repeats
from karma.bench.figures.statistics import Estimate
from karma.bench.figures.tables import Result
from karma.bench.report.plots import Rate

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
class Heading:
    """One column: its title, and what it says in few words."""

    title: str
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultLine:
    """One line."""

    row: str
    kind: str
    is_first: bool  # of its row
    rate: Rate
    values: tuple[FigureText, ...]  # one for each of `columns`


def columns(result: Result) -> tuple[Heading, ...]:
    """Return the columns in which something was measured."""
    return tuple(Heading(title=COLUMNS[key].title, says=COLUMNS[key].says) for key in _keys(result))


def rates(result: Result) -> tuple[Rate, ...]:
    """Return the success rates of a run; those of sequences are of their instructions."""
    return tuple(
        _rate(line, "subtasks_done" if line.kind == "sequence" else "success")
        for line in result.figures
    )


def result_lines(result: Result) -> tuple[ResultLine, ...]:
    """Return the table of a run."""
    return tuple(_lines(result))


def _lines(result: Result) -> Iterator[ResultLine]:
    keys, last = _keys(result), ""
    for line in without_repeats(result.figures):
        yield ResultLine(
            row=line.row,
            kind=line.kind,
            is_first=line.row != last,
            rate=_rate(line),
            values=tuple(_cell(key, line.values[key]) for key in keys),
        )
        last = line.row


def _keys(result: Result) -> list[str]:
    has_sequences = any(line.kind == "sequence" for line in result.figures)
    return [
        key
        for key in (*_SHARES, *_AMOUNTS)
        if (has_sequences or key not in _OF_SEQUENCES)
        and any(line.values[key].value is not None for line in result.figures)
    ]


def _cell(key: str, found: Estimate) -> FigureText:
    text = _signed(figure_text(found.value, COLUMNS[key].digits))
    if key not in _SHARES or found.interval is None:
        return FigureText(text=text)
    low, high = (_signed(figure_text(end)) for end in (found.interval.low, found.interval.high))
    return FigureText(text=text, span=f"{low} to {high}" if "−" in low else f"{low}–{high}")


def _signed(text: str) -> str:
    """Return a figure with a minus that is one.

    >>> _signed("-0.31")
    '−0.31'
    """
    return text.replace("-", "−")


def _rate(line: Figures, key: str = "success") -> Rate:
    found = line.values[key]
    return Rate(
        row=line.row,
        kind=line.kind,
        episodes=line.episodes if key == "success" else found.number,
        successes=round((found.value or 0.0) * found.number),
        rate=found.value,
        low=found.interval.low if found.interval else None,
        high=found.interval.high if found.interval else None,
    )
