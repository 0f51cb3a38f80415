"""Pictures of results: hit rates against tasks done, and against exploration saved."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from karma.lab.paper_claims import FIFO, CellResults
from karma.lab.simulate import BELADY
from karma.lab.sweep import PolicyRow, Sweep, division_of, family_of, line_of

WIDTH_IN, HEIGHT_IN = 3.1, 2.5  # of a panel


def curves(cells: Sequence[CellResults], title: str, caption: str) -> Any:
    """Draw a panel for each workload and policy: hit rate against tasks, a line for each size.

    Vertical lines mark where the memory was 95 % full, on average over sequences. FIFO (dotted) and
    the bound (dashed) of the sizes that a panel has are in each panel.
    """
    rows = cells[0].sweep.rows
    panel_of = line_of if len({row.size for row in rows}) > 1 else family_of
    names = _panel_names([panel_of(row.policy) for row in rows])
    figure, axes = _panels(len(names), len(cells))
    for column, cell in enumerate(cells):
        for line, name in enumerate(names):
            panel = axes[line][column]
            mine = [row for row in cell.sweep.rows if panel_of(row.policy) == name]
            _draw_curves(panel, mine, cell.sweep.rows)
            panel.set_title(f"{cell.workload} · {name}", fontsize=8)
            if column == 0:
                panel.set_ylabel("hit rate")
            if line == len(names) - 1:
                panel.set_xlabel("tasks")
            if column == len(cells) - 1:
                panel.legend(fontsize=5.5, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return _finish(figure, title, caption)


def exploration(cells: Sequence[CellResults], title: str, caption: str) -> Any:
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


def sizes(sweep: Sweep, title: str, caption: str) -> Any:
    """Draw the hit rate of each policy against the size of the memory, with intervals."""
    figure, axes = _panels(1, 1, scale=2.2)
    panel = axes[0][0]
    for number, family in enumerate(dict.fromkeys(line_of(row.policy) for row in sweep.rows)):
        rows = [row for row in sweep.rows if line_of(row.policy) == family and row.cold]
        rows.sort(key=lambda row: row.size)
        rates = [row.cold for row in rows if row.cold is not None]
        look = {"color": "black", "linestyle": "--"} if family == BELADY else {}
        look = look or {"color": f"C{number % 10}", "linestyle": "-" if number < 10 else ":"}
        spread = [
            [rate.value - (rate.low if rate.low is not None else rate.value) for rate in rates],
            [(rate.high if rate.high is not None else rate.value) - rate.value for rate in rates],
        ]
        spread = [[max(0.0, one) for one in side] for side in spread]
        panel.errorbar(
            [row.size for row in rows], [rate.value for rate in rates], yerr=spread,
            label=family, marker="o", markersize=3, capsize=2, linewidth=1, **look,
        )  # fmt: skip
    panel.set_xlabel("units")
    panel.set_ylabel("hit rate")
    panel.legend(fontsize=6, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return _finish(figure, title, caption)


def save(figure: Any, stem: Path) -> tuple[Path, Path]:
    """Write a picture as PNG and SVG, without a date, and let go of it."""
    import matplotlib as mpl

    stem.parent.mkdir(parents=True, exist_ok=True)
    png, svg = Path(f"{stem}.png"), Path(f"{stem}.svg")
    with mpl.rc_context({"svg.hashsalt": "karma"}):
        figure.savefig(png, dpi=130, metadata={"Software": None})
        figure.savefig(svg, metadata={"Date": None, "Creator": None})
    return png, svg


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
        _line(panel, row, division_of(row.policy), color=shade)
        if row.warm_task is not None:
            panel.axvline(row.warm_task, color=shade, linewidth=0.5, alpha=0.7)
    for row in every:
        if row.size not in of_size or row in rows:
            continue
        if row.policy.startswith(f"{BELADY}["):
            look = {"color": of_size[row.size] if several else "black", "linestyle": "--"}
            _line(panel, row, f"Belady [{row.size}]", **look)
        elif family_of(row.policy) == FIFO:
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


def _panels(lines: int, columns: int, *, scale: float = 1.0) -> tuple[Any, Any]:
    """Return a figure of its own, which no global state knows of."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    size = (scale * WIDTH_IN * columns + 1.0, scale * HEIGHT_IN * lines + 0.6)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(lines, columns, squeeze=False)


def _finish(figure: Any, title: str, caption: str) -> Any:
    width = int(figure.get_size_inches()[0] * 14)
    figure.suptitle(title, fontsize=10)
    figure.supxlabel(textwrap.fill(caption, width), fontsize=7)
    return figure
