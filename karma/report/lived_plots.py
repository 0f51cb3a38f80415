"""Pictures of a run of lived-in homes: success by kind, reliability, curves over settings."""

import io
from collections.abc import Sequence
from typing import Any

from karma.benchmarks.lived.table import ALL, KINDS, OURS, LivedFigures

WIDTH = 0.8  # of all rows of one kind, beside each other
HARD = ("changed", "several", "event", ALL)  # kinds that the curves show


def lived_picture(figures: Sequence[LivedFigures]) -> Any:
    """Return a matplotlib figure: bars and reliability for one setting, curves for several."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    settings = list(dict.fromkeys(one.setting for one in figures))
    if len(settings) == 1:
        figure = Figure(figsize=(15, 5), layout="constrained")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2, width_ratios=(4, 1))
        _bars(left, figures)
        _reliability(right, figures)
        return figure
    figure = Figure(figsize=(15, 4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(HARD) + 1)
    for axis, kind in zip(axes, HARD, strict=False):
        _curve(axis, figures, settings, kind)
    _stale(axes[-1], figures, settings)
    axes[0].set_ylabel("served rightly")
    axes[-2].legend(fontsize=7)
    return figure


def as_svg(figure: Any) -> bytes:
    """Return a figure as SVG, the same bytes each time."""
    import matplotlib as mpl

    place = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "karma"}):
        figure.savefig(place, format="svg", metadata={"Date": None, "Creator": None})
    return place.getvalue()


def _bars(axis: Any, figures: Sequence[LivedFigures]) -> None:
    """Draw success by kind, a bar for each row, with intervals over homes."""
    import matplotlib as mpl

    step = WIDTH / len(figures)
    colours = mpl.colormaps["tab20"]
    for number, one in enumerate(figures):
        for place, kind in enumerate(one.kinds):
            if kind.right is None:
                continue
            x = place - WIDTH / 2 + (number + 0.5) * step
            axis.bar(x, kind.right, step * 0.95, color=colours(number % 20),
                     label=one.row if place == 0 else None)  # fmt: skip
            if kind.low is not None and kind.high is not None:
                axis.plot([x, x], [kind.low, kind.high], color="black", linewidth=0.8)
    axis.set_xticks(range(len(KINDS)), KINDS)
    axis.set_ylim(0, 1.02)
    axis.set_ylabel("served rightly")
    axis.legend(fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.07))


def _reliability(axis: Any, figures: Sequence[LivedFigures]) -> None:
    """Draw what ours said of "it is still there" against what was so."""
    axis.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
    for one in figures:
        if one.row == OURS and one.reliability:
            said, so, number = zip(*one.reliability, strict=True)
            axis.plot(said, so, marker="o")
            for x, y, many in zip(said, so, number, strict=True):
                axis.annotate(str(many), (x, y), fontsize=7, xytext=(3, -9),
                              textcoords="offset points")  # fmt: skip
    axis.set_xlabel("chance that ours gave")
    axis.set_ylabel("share that was still there")
    axis.set_xlim(0, 1)
    axis.set_ylim(0, 1)
    axis.set_title("reliability, with numbers", fontsize=9)


def _curve(axis: Any, figures: Sequence[LivedFigures], settings: list[str], kind: str) -> None:
    """Draw success of one kind over the settings, a line for each row."""
    for row in dict.fromkeys(one.row for one in figures):
        mine = {one.setting: one for one in figures if one.row == row}
        points = [
            (at, found)
            for at, setting in enumerate(settings)
            if setting in mine
            for found in mine[setting].kinds
            if found.kind == kind and found.right is not None
        ]
        xs = [at for at, _ in points]
        axis.plot(xs, [found.right for _, found in points], marker="o", label=row)
        axis.fill_between(xs, [found.low or 0.0 for _, found in points],
                          [found.high or 1.0 for _, found in points], alpha=0.12)  # fmt: skip
    axis.set_xticks(range(len(settings)), settings, fontsize=8)
    axis.set_title(kind, fontsize=9)
    axis.set_ylim(0, 1.02)


def _stale(axis: Any, figures: Sequence[LivedFigures], settings: list[str]) -> None:
    """Draw the share of actions that were taken on a belief that was false."""
    for row in dict.fromkeys(one.row for one in figures):
        mine = {one.setting: one.stale_share for one in figures if one.row == row}
        points = [
            (at, 100 * share)
            for at, setting in enumerate(settings)
            if (share := mine.get(setting)) is not None
        ]
        axis.plot([at for at, _ in points], [share for _, share in points], marker="o", label=row)
    axis.set_xticks(range(len(settings)), settings, fontsize=8)
    axis.set_title("stale actions, %", fontsize=9)
    axis.set_ylim(bottom=0)
