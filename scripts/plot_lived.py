"""Draw a run of lived-in homes: success by kind, reliability of "still there", curves by setting.

python scripts/plot_lived.py runs/lived --out docs/pictures/lived.png
"""

from pathlib import Path
from typing import Annotated, Any

import matplotlib as mpl
import typer

from karma.benchmarks.lived.table import ALL, KINDS, OURS, LivedFigures
from karma.benchmarks.run import read_results

mpl.use("agg")
from matplotlib import pyplot as plt  # after the choice of what draws

WIDTH = 0.8  # of all rows of one kind, beside each other
HARD = ("changed", "several", "event", ALL)  # kinds that the curves show


def main(
    run: Annotated[Path, typer.Argument(help="Folder of a run, finished or not.")],
    out: Annotated[Path, typer.Option(help="The picture.")],
    rows: Annotated[str, typer.Option(help="Rows to draw, with ';' between; '' is all.")] = "",
) -> None:
    """Draw one picture: bars and reliability for one setting, curves for several."""
    figures: list[LivedFigures] = read_results(run).figures
    wanted = [name.strip() for name in rows.split(";") if name.strip()]
    figures = [one for one in figures if not wanted or one.row in wanted]
    settings = list(dict.fromkeys(one.setting for one in figures))
    if len(settings) == 1:
        _, (left, right) = plt.subplots(
            1, 2, figsize=(15, 5), width_ratios=(4, 1), layout="constrained"
        )
        bars(left, figures)
        reliability(right, figures)
    else:
        _, axes = plt.subplots(1, len(HARD), figsize=(15, 4), sharey=True, layout="constrained")
        for axis, kind in zip(axes, HARD, strict=True):
            curve(axis, figures, settings, kind)
        axes[0].set_ylabel("served rightly")
        axes[-1].legend(fontsize=7)
    plt.savefig(out, dpi=110)
    print(out)


def bars(axis: Any, figures: list[LivedFigures]) -> None:
    """Draw success by kind, a bar for each row, with intervals over homes."""
    step = WIDTH / len(figures)
    colours = plt.get_cmap("tab20")
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


def reliability(axis: Any, figures: list[LivedFigures]) -> None:
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


def curve(axis: Any, figures: list[LivedFigures], settings: list[str], kind: str) -> None:
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


if __name__ == "__main__":
    typer.run(main)
