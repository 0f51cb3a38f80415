"""Pictures of a run of lived-in homes: success by kind of request, over settings and days."""

from collections.abc import Iterator, Sequence
from typing import Any

from karma.bench.figures.drawing import Plot, empty_figure
from karma.plugins.homes.lived.table import ALL, KINDS, OURS, LivedFigures, StaleShare

WIDTH = 0.8  # of all rows of one kind, beside each other
HARD = (ALL, "changed", "several", "event")  # kinds that the curves show
STALE = "stale actions"
LEAST = 10  # chances of a tenth that is drawn


def lived_pictures(figures: Sequence[LivedFigures], stale: Sequence[StaleShare]) -> Iterator[Plot]:
    """Yield the curves where there are several settings, then each setting's bars."""
    settings = list(dict.fromkeys(one.setting for one in figures))
    if len(settings) > 1:
        yield curves_picture("Over settings", figures, stale)
    for setting in settings:
        yield Plot(
            title=f"Served rightly, by kind: {setting}",
            caption="Whiskers: 95 % intervals over homes. Reliability: what rows that give a "
            "chance said of “it is still there”, in tenths with ten or more, against what was so.",
            figure=_success([one for one in figures if one.setting == setting]),
        )


def curves_picture(
    title: str, figures: Sequence[LivedFigures], stale: Sequence[StaleShare]
) -> Plot:
    """Return the hard kinds and stale actions over settings, or over what stands as such."""
    return Plot(
        title=title,
        caption="Shares with their 95 % intervals over homes; stale actions: of the world "
        "actions for requests, those spent on a belief that was false.",
        figure=_curves(figures, stale, list(dict.fromkeys(one.setting for one in figures))),
    )


def _success(figures: Sequence[LivedFigures]) -> Any:
    figure = empty_figure(15, 5)
    left, right = figure.subplots(1, 2, width_ratios=(4, 1))
    _bars(left, figures)
    _reliability(right, [one for one in figures if not one.brier_assumed and one.reliability])
    return figure


def _curves(
    figures: Sequence[LivedFigures], stale: Sequence[StaleShare], settings: Sequence[str]
) -> Any:
    figure = empty_figure(16, 4.6)
    axes = figure.subplots(1, len(HARD) + 1)
    for axis, kind in zip(axes, HARD, strict=False):
        points = [
            (one.row, one.setting, found.right, found.low, found.high)
            for one in figures
            for found in one.kinds
            if found.kind == kind and found.right is not None
        ]
        _curve(axis, points, settings, kind)
        axis.set_ylim(0, 1.02)
    axes[0].set_ylabel("served rightly")
    points = [(o.row, o.setting, o.share, o.low, o.high) for o in stale if o.share is not None]
    _curve(axes[-1], points, settings, STALE)
    axes[-1].set_ylim(bottom=0)
    figure.legend(*axes[0].get_legend_handles_labels(), fontsize=8, ncols=6,
                  loc="outside lower center")  # fmt: skip
    return figure


def _bars(axis: Any, figures: Sequence[LivedFigures]) -> None:
    """Draw success by kind, a bar for each row, with intervals over homes."""
    step = WIDTH / len(figures)
    for number, one in enumerate(figures):
        for place, kind in enumerate(one.kinds):
            if kind.right is None:
                continue
            x = place - WIDTH / 2 + (number + 0.5) * step
            axis.bar(x, kind.right, step * 0.95, color=_colour(number, len(figures)),
                     label=one.row if kind.kind == ALL else None)  # fmt: skip
            if kind.low is not None and kind.high is not None:
                axis.plot([x, x], [kind.low, kind.high], color="black", linewidth=0.8)
    axis.set_xticks(range(len(KINDS)), KINDS)
    axis.set_ylim(0, 1.02)
    axis.set_ylabel("served rightly")
    axis.legend(fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.07))


def _reliability(axis: Any, figures: Sequence[LivedFigures]) -> None:
    """Draw what was said of "it is still there" against what was so; the numbers are of ours."""
    axis.plot([0, 1], [0, 1], color="grey", linewidth=0.8)
    for one in figures:
        tenths = [tenth for tenth in one.reliability if tenth[2] >= LEAST]
        if not tenths:
            continue
        said, so, number = zip(*tenths, strict=True)
        axis.plot(said, so, marker="o", markersize=4, label=one.row)
        for x, y, many in zip(said, so, number, strict=True) if one.row == OURS else ():
            axis.annotate(str(many), (x, y), fontsize=7, xytext=(3, -9),
                          textcoords="offset points")  # fmt: skip
    axis.set_xlabel("chance that was given")
    axis.set_ylabel("share that was still there")
    axis.set_xlim(0, 1.02)
    axis.set_ylim(0, 1.02)
    axis.set_title("reliability, with numbers", fontsize=9)
    if len(axis.lines) > 1:
        axis.legend(fontsize=7, loc="lower right")


def _curve(
    axis: Any, points: Sequence[tuple[str, str, float, float | None, float | None]],
    settings: Sequence[str], title: str,
) -> None:  # fmt: skip
    """Draw one share over the settings, a line for each row."""
    rows = list(dict.fromkeys(point[0] for point in points))
    for number, row in enumerate(rows):
        mine = [point for point in points if point[0] == row]
        beside = 0.3 * ((number + 0.5) / len(rows) - 0.5)  # so that whiskers can be told apart
        xs = [settings.index(point[1]) + beside for point in mine]
        colour = _colour(number, len(rows))
        axis.plot(xs, [point[2] for point in mine], marker="o", markersize=4, label=row,
                  color=colour)  # fmt: skip
        for x, (_, _, _, low, high) in zip(xs, mine, strict=True):
            if low is not None and high is not None:
                axis.plot([x, x], [low, high], color=colour, linewidth=1.0, alpha=0.6)
    axis.set_xticks(range(len(settings)), settings, fontsize=8)
    axis.set_xlim(-0.3, len(settings) - 0.7)
    axis.set_title(title, fontsize=9)


def _colour(number: int, rows: int) -> Any:
    import matplotlib as mpl

    return mpl.colormaps["tab10" if rows <= 10 else "tab20"](number % 20)
