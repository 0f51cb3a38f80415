"""Plots of a run: success with intervals, causes of failure, and amounts per episode."""

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from karma.bench.figures.columns import COLUMNS, Figures
from karma.bench.figures.drawing import Plot, empty_figure
from karma.bench.figures.failures import CAUSES, Failure, count
from karma.bench.figures.tables import Result
from karma.journal.records import ALL, KINDS

AMOUNTS = ("explorations", "actions", "planner_calls")
NAME_LETTERS = 22  # of a line of a method's name
HEIGHT_IN = 0.36  # of a bar with its gap


def plots_of(result: Result) -> Iterator[Plot]:
    """Yield the plots of a run, the methods in the order of its tables."""
    rows = list(dict.fromkeys(line.row for line in result.figures))
    yield Plot(
        title="Tasks solved",
        caption="Share of the tasks, of sequences of their instructions; whiskers: 95 % intervals.",
        figure=_success(rows, result.figures),
    )
    if result.failures:
        yield Plot(
            title="Causes of failure",
            caption="Episodes by the cause of the first instruction that failed.",
            figure=_causes(rows, result.failures),
        )
    yield Plot(
        title="Per episode",
        caption="Means over all episodes of a method.",
        figure=_amounts(rows, [line for line in result.figures if line.kind == ALL]),
    )


def _panels(rows: Sequence[str], panels: int, lines: int = 1) -> tuple[Any, Sequence[Any]]:
    """Return a figure with panels that share the methods as their vertical axis."""
    figure = empty_figure(3.2 * panels + 2.0, HEIGHT_IN * lines * len(rows) + 0.9)
    axes = figure.subplots(1, panels, squeeze=False, sharey=True)[0]
    axes[0].set_yticks(range(len(rows)), map(_folded, rows), fontsize=8)
    axes[0].invert_yaxis()
    for axis in axes:
        axis.tick_params(axis="x", labelsize=7)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _folded(name: str) -> str:
    """Return a method's name in at most two lines, without mathematical notation."""
    lines = textwrap.wrap(name, NAME_LETTERS, max_lines=2, placeholder="…")
    return "\n".join(lines).replace("$", r"\$")


def _success(rows: Sequence[str], lines: Sequence[Figures]) -> Any:
    kinds = [kind for kind in KINDS if any(line.kind == kind for line in lines)] or [ALL]
    figure, (axis,) = _panels(rows, 1, len(kinds))
    for line in lines:
        rate = line.values["subtasks_done" if line.kind == "sequence" else "success"]
        if rate.value is None or line.kind not in kinds:
            continue
        number = kinds.index(line.kind)
        y = rows.index(line.row) + 0.6 * ((number + 0.5) / len(kinds) - 0.5)
        axis.plot(rate.value, y, "o", color=f"C{number}", markersize=4)
        if rate.interval:
            axis.plot([rate.interval.low, rate.interval.high], [y, y], color=f"C{number}")
    for number, kind in enumerate(kinds):
        axis.plot([], [], "o-", color=f"C{number}", label=kind)
    axis.set_xlim(-0.02, 1.02)
    axis.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure


def _causes(rows: Sequence[str], failures: Sequence[Failure]) -> Any:
    figure, (axis,) = _panels(rows, 1)
    for place, row in enumerate(rows):
        left = 0
        counts = count(case for case in failures if case.row == row)
        for number, amount in enumerate(counts.values()):
            axis.barh(place, amount, 0.6, left=left, color=f"C{number}")
            left += amount
    for number, cause in enumerate(CAUSES):
        axis.barh(0, 0, color=f"C{number}", label=cause)
    axis.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure


def _amounts(rows: Sequence[str], lines: Sequence[Figures]) -> Any:
    figure, axes = _panels(rows, len(AMOUNTS))
    for axis, key in zip(axes, AMOUNTS, strict=True):
        axis.set_title(COLUMNS[key].title, fontsize=9)
        for line in lines:
            if (value := line.values[key].value) is not None:
                axis.barh(rows.index(line.row), value, 0.6, color="C0")
    return figure
