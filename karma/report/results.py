"""The table of results: a line per row and kind, in words."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from karma.bench.metrics import METRICS, Figures
from karma.bench.statistics import Estimate
from karma.bench.tables import Result, estimate_of, figure_text
from karma.report.plots import Rate

_SHARES = ("subtasks_done", "goals_met", "retrieved", "hits", "hits_later", "re", "rt")
_OF_SEQUENCES = ("subtasks_done", "hits_later")  # say little more of a short task
_AMOUNTS = ("explorations", "actions", "planner_calls", "seconds")
_TITLES = {metric.key: metric.title for metric in METRICS} | {"re": "RE", "rt": "RT"}
_SAYS = {
    "subtasks_done": "instructions all of whose goals held at their end",
    "goals_met": "goals that held at the end of their instruction",
    "retrieved": "of the instructions that come back to a thing, those with its unit in the prompt",
    "hits": "of the things that instructions need, those in short-term memory, cold start included",
    "hits_later": "the same over the later half of each sequence",
    "re": "searching saved against the row without memory (reduced exploration)",
    "rt": "steps saved against the row without memory (reduced time)",
    "explorations": "area nodes visited and containers opened in search of things",
    "actions": "actions that the world was asked for",
    "planner_calls": "answers asked of the planner",
    "seconds": "seconds by the clock",
}
_DIGITS = {metric.key: metric.digits for metric in METRICS}


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One figure in words, with its interval or ""."""

    text: str
    span: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """One column: its title, and what it says in few words."""

    title: str
    says: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One line."""

    row: str
    kind: str
    is_first: bool  # of its row
    rate: Rate
    values: tuple[Figure, ...]  # one for each of `columns`


def columns(result: Result) -> tuple[Column, ...]:
    """Return the columns in which something was measured."""
    return tuple(Column(title=_TITLES[key], says=_SAYS[key]) for key in _keys(result))


def rates(result: Result) -> tuple[Rate, ...]:
    """Return the success rates of a run; those of sequences are of their instructions."""
    return tuple(
        _rate(line, "subtasks_done" if line.kind == "sequence" else "success")
        for line in result.figures
    )


def result_lines(result: Result) -> tuple[Line, ...]:
    """Return the table of a run."""
    return tuple(_lines(result))


def _lines(result: Result) -> Iterator[Line]:
    keys, last = _keys(result), ""
    kinds = Counter(line.row for line in result.figures)  # "all" among them
    for line in result.figures:
        if line.kind == "all" and kinds[line.row] == 2:
            continue  # it says the same again
        yield Line(
            row=line.row,
            kind=line.kind,
            is_first=line.row != last,
            rate=_rate(line),
            values=tuple(_figure(key, _value(result, line, key)) for key in keys),
        )
        last = line.row


def _keys(result: Result) -> list[str]:
    has_sequences = any(line.kind == "sequence" for line in result.figures)
    return [
        key
        for key in (*_SHARES, *_AMOUNTS)
        if (has_sequences or key not in _OF_SEQUENCES)
        and any(_value(result, line, key).value is not None for line in result.figures)
    ]


def _value(result: Result, line: Figures, key: str) -> Estimate:
    match key:
        case "re" | "rt":
            return estimate_of(result, line, key)
        case _:
            return line.values[key]


def _figure(key: str, found: Estimate) -> Figure:
    text = _signed(figure_text(found.value, _DIGITS.get(key, 2)))
    if key not in _SHARES or found.interval is None:
        return Figure(text=text)
    low, high = (_signed(f"{end:.2f}") for end in (found.interval.low, found.interval.high))
    return Figure(text=text, span=f"{low} to {high}" if "−" in low else f"{low}–{high}")


def _signed(text: str) -> str:
    """Return a figure with a minus that is one; none before a nought.

    >>> _signed("-0.31"), _signed("-0.00")
    ('−0.31', '0.00')
    """
    return text.replace("-", "−" if any(digit in text for digit in "123456789") else "")


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
