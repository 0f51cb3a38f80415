"""Plots as numbers that the page's template draws: user units of an SVG 360 wide."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from karma.agent.journal.formats import figure_text
from karma.agent.journal.records import ALL, KINDS
from karma.bench.figures.columns import Figures
from karma.bench.figures.failures import CAUSES, Failure, count
from karma.bench.figures.statistics import Estimate

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
            title=_said(line, rate),
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


def _said(line: Figures, rate: Estimate) -> str:
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
