"""Pictures of results: hit rates against tasks done, and against exploration saved."""

import textwrap
from collections.abc import Sequence
from typing import Any

from karma.bench.figures.drawing import empty_figure
from karma.bench.policies.paper_claims import FIFO, FigureCell
from karma.bench.policies.simulate import BELADY
from karma.bench.policies.sweep import PolicyRow

WIDTH_IN, HEIGHT_IN = 3.1, 2.5  # of a panel


def curves(cells: Sequence[FigureCell], title: str, caption: str) -> Any:
    """Draw a panel for each workload and policy: hit rate against tasks, a line for each size.

    Vertical lines mark where the memory was 95 % full, on average over sequences. FIFO (dotted) and
    the bound (dashed) of the sizes that a panel has are in each panel.
    """
    rows = cells[0].sweep.rows
    by = "line" if len({row.size for row in rows}) > 1 else "family"
    names = _panel_names([getattr(row.name, by) for row in rows])
    figure, axes = _panels(len(names), len(cells))
    for column, cell in enumerate(cells):
        for line, name in enumerate(names):
            panel = axes[line][column]
            mine = [row for row in cell.sweep.rows if getattr(row.name, by) == name]
            _draw_curves(panel, mine, cell.sweep.rows)
            panel.set_title(f"{cell.workload} · {name}", fontsize=8)
            if column == 0:
                panel.set_ylabel("hit rate")
            if line == len(names) - 1:
                panel.set_xlabel("tasks")
            if column == len(cells) - 1:
                panel.legend(fontsize=5.5, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return _finish(figure, title, caption)


def exploration(cells: Sequence[FigureCell], title: str, caption: str) -> Any:
    """Draw a panel for each workload and policy: a dot for each sequence, and the line."""
    policies = [one.policy for one in cells[0].exploration if not one.policy.startswith(BELADY)]
    figure, axes = _panels(len(policies), len(cells))
    for column, cell in enumerate(cells):
        mine = [one for one in cell.exploration if one.policy in policies]
        for line, found in enumerate(mine):
            panel = axes[line][column]
            panel.plot(found.rates, found.reduced, ".", markersize=3, color="C0")
            text = found.policy
            if found.slope is not None and found.intercept is not None and found.r is not None:
                ends = [min(found.rates), max(found.rates)]
                panel.plot(ends, [found.slope * x + found.intercept for x in ends], color="C3")
                text += f"\nr {found.r.value:.3f}, slope {found.slope:.2f}"
            panel.set_title(f"{cell.workload} · {text}", fontsize=8)
            panel.set_xlabel("hit rate")
            if column == 0:
                panel.set_ylabel("reduced exploration")
    return _finish(figure, title, caption)


# ------------------------------------------------------------- parts


def _panel_names(names: Sequence[str]) -> list[str]:
    """Return what gets a panel: all but the bound, and all but FIFO where there is more."""
    found = [name for name in dict.fromkeys(names) if name != BELADY]
    return [name for name in found if not name.startswith("fifo")] or found


def _draw_curves(panel: Any, rows: Sequence[PolicyRow], every: Sequence[PolicyRow]) -> None:
    """Draw the rows of a panel; where they differ in size, a size has one colour for all."""
    import matplotlib as mpl

    shades = mpl.colormaps["viridis"]
    sizes = sorted({row.size for row in rows})
    of_size = {size: shades(place / len(sizes)) for place, size in enumerate(sizes)}
    several = len(sizes) > 1
    for number, row in enumerate(rows):
        shade = of_size[row.size] if several else shades(number / max(len(rows) - 1, 1) * 0.9)
        _line(panel, row, row.name.division, color=shade)
        if row.warm_task is not None:
            panel.axvline(row.warm_task, color=shade, linewidth=0.5, alpha=0.7)
    for row in every:
        if row.size not in of_size or row in rows:
            continue
        if row.policy.startswith(f"{BELADY}["):
            look = {"color": of_size[row.size] if several else "black", "linestyle": "--"}
            _line(panel, row, f"Belady [{row.size}]", **look)
        elif row.name.family == FIFO:
            look = {"color": of_size[row.size] if several else "C3", "linestyle": ":"}
            _line(panel, row, f"FIFO [{row.size}]", **look)
    panel.set_xscale("log")  # memories of ten fill within ten tasks
    panel.xaxis.set_major_formatter("{x:g}")
    panel.set_ylim(bottom=0)


def _line(panel: Any, row: PolicyRow, label: str, **look: Any) -> None:
    tasks = [point.tasks for point in row.curve]
    panel.plot(tasks, [point.rate.value for point in row.curve], label=label, linewidth=1, **look)
    if all(point.rate.low is not None for point in row.curve):
        lows = [point.rate.low for point in row.curve]
        highs = [point.rate.high for point in row.curve]
        panel.fill_between(tasks, lows, highs, color=look["color"], alpha=0.12, linewidth=0)


def _panels(lines: int, columns: int) -> tuple[Any, Any]:
    figure = empty_figure(WIDTH_IN * columns + 1.0, HEIGHT_IN * lines + 0.6)
    return figure, figure.subplots(lines, columns, squeeze=False)


def _finish(figure: Any, title: str, caption: str) -> Any:
    width = int(figure.get_size_inches()[0] * 14)
    figure.suptitle(title, fontsize=10)
    figure.supxlabel(textwrap.fill(caption, width), fontsize=7)
    return figure
