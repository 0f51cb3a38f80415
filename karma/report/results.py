"""The table of results: a line per row and kind, in words."""

from collections.abc import Iterator
from dataclasses import dataclass

from karma.bench.metrics import METRICS, Figures
from karma.bench.statistics import Estimate
from karma.bench.tables import Result, estimate_of, figure_text
from karma.report.plots import Rate

_SHARES = ("retrieved", "goals_met", "hits", "re", "rt")  # shown with their intervals
_AMOUNTS = ("explorations", "actions", "planner_calls", "seconds")
_TITLES = {metric.key: metric.title for metric in METRICS} | {"re": "RE", "rt": "RT"}
_DIGITS = {metric.key: metric.digits for metric in METRICS}


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One figure in words, with its interval or ""."""

    text: str
    span: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One line."""

    row: str
    kind: str
    is_first: bool  # of its row
    rate: Rate
    values: tuple[Figure, ...]  # one for each of `columns`


def columns(result: Result) -> tuple[str, ...]:
    """Return the titles of the columns in which something was measured."""
    return tuple(_TITLES[key] for key in _keys(result))


def rates(result: Result) -> tuple[Rate, ...]:
    """Return the success rates of a run, in the order of its figures."""
    return tuple(_rate(line) for line in result.figures)


def result_lines(result: Result) -> tuple[Line, ...]:
    """Return the table of a run."""
    return tuple(_lines(result))


def _lines(result: Result) -> Iterator[Line]:
    keys, last = _keys(result), ""
    for line in result.figures:
        yield Line(
            row=line.row,
            kind=line.kind,
            is_first=line.row != last,
            rate=_rate(line),
            values=tuple(_figure(key, _value(result, line, key)) for key in keys),
        )
        last = line.row


def _keys(result: Result) -> list[str]:
    return [
        key
        for key in (*_SHARES, *_AMOUNTS)
        if any(_value(result, line, key).value is not None for line in result.figures)
    ]


def _value(result: Result, line: Figures, key: str) -> Estimate:
    match key:
        case "re" | "rt":
            return estimate_of(result, line, key)
        case _:
            return line.values[key]


def _figure(key: str, found: Estimate) -> Figure:
    text = figure_text(found.value, _DIGITS.get(key, 2)).replace("-", "−")
    if key not in _SHARES or found.interval is None:
        return Figure(text=text)
    span = f"{found.interval.low:.2f}–{found.interval.high:.2f}"
    return Figure(text=text, span=span.replace("-", "−"))


def _rate(line: Figures) -> Rate:
    found = line.values["success"]
    return Rate(
        row=line.row,
        kind=line.kind,
        episodes=line.episodes,
        successes=round((found.value or 0.0) * found.number),
        rate=found.value,
        low=found.interval.low if found.interval else None,
        high=found.interval.high if found.interval else None,
    )
