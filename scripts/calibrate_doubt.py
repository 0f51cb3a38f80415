"""Fit when a planner should refuse: coefficients and threshold beside its weights, and a plot.

    python scripts/calibrate_doubt.py models/nano/planner.gguf --out models/nano/doubt.json
    python scripts/calibrate_doubt.py karma-nano --plot docs/images/doubt.png

Requests are drawn with words, forms, topics and languages that training has not; those of
eval/requests are not looked at. Figures are cross-validated over five folds.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from karma import registry
from karma.agent.doubt import FEATURES
from karma.files import to_json, write_atomic
from karma.infer.llama.options import LlamaOptions
from karma.infer.manifest.manifest import resolve_planner
from karma.loading.words import hints_for
from karma.offline import go_offline
from karma.seeds import stream
from karma.tasks.drawing.phrases import our_book
from karma.tasks.drawing.rooms import generated_rooms
from karma.training.planner.calibration import (
    Judged,
    Scored,
    bins,
    brier,
    cross_validated,
    drawn,
    fitted,
    judged,
    shares,
)

ROOMS_SEED = 977  # of rooms that training has not
CONTROLS = {
    "without the planner's refusing": tuple(one for one in FEATURES if one != "refusing"),
    "share of unknown words alone": ("far_words",),
    "nearness of hints alone": ("weakest_hint",),
    "the planner's refusing alone": ("refusing",),
}


def main(
    planner: Annotated[str, typer.Argument(help="A model of the manifest, or a GGUF.")],
    out: Annotated[Path | None, typer.Option(help="Takes the coefficients.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Takes the reliability plot, a PNG.")] = None,
    count: Annotated[int, typer.Option(min=20, help="Requests to draw.")] = 1200,
    seed: int = 0,
    refused: Annotated[
        float, typer.Option(help="Share of requests to be done, in known words, refused at most.")
    ] = 0.02,
) -> None:
    """Draw requests, ask the planner, fit, and tell how far the fit can be trusted."""
    go_offline()
    found = _asked(planner, count, seed)
    doubt = fitted(found, refused=refused)
    told = cross_validated(found, tuple(FEATURES), refused=refused)
    print(f"coefficients {doubt.coefficients}, intercept {doubt.intercept}")
    print(f"threshold {doubt.threshold}; {doubt.fitted_on}")
    _tell("doubt, cross-validated", told, whole=True)
    by_itself = [_scored(one, float(one.says_refuse)) for one in found]
    _tell("the planner by itself", by_itself)
    for name, names in CONTROLS.items():
        _tell(name, cross_validated(found, names, refused=refused))
    rate = sum(one.refused for one in told) / len(told)
    rng = stream(seed, "control")
    by_lot = [_scored(one, float(rng.random() < rate)) for one in found]
    _tell("refused by lot, as often", by_lot)
    if out is not None:
        write_atomic(out, to_json(doubt, indent=2))
    if plot is not None:
        write_atomic(plot, _plotted(told, doubt.threshold))


def _asked(planner: str, count: int, seed: int) -> list[Judged]:
    file = resolve_planner(planner)
    model = registry.load("language_models", "llama")(
        file.path, options=LlamaOptions(threads=1), name=file.name, sha256=file.sha256
    )
    rooms = list(generated_rooms(16, ROOMS_SEED))
    book = our_book()
    books = (book.part(held_out=True), book.with_unseen_words())
    examples = drawn(rooms, books, count, seed)
    return list(judged(model, hints_for(planner), examples))


def _scored(one: Judged, chance: float) -> Scored:
    return Scored(
        kind=one.example.kind, to_refuse=one.to_refuse, in_known_words=one.in_known_words,
        chance=chance, refused=chance >= 0.5,
    )  # fmt: skip


def _tell(title: str, told: Sequence[Scored], *, whole: bool = False) -> None:
    print(f"{title}: Brier score {brier(told):.3f}")
    for name, (times, number, interval) in shares(told).items():
        if (whole or name.startswith("to ")) and interval is not None:
            share = f"{times / number:.3f} [{interval.low:.3f}, {interval.high:.3f}]"
            print(f"  refused of {name:19} {share} ({times} of {number})")


def _plotted(told: Sequence[Scored], threshold: float) -> bytes:
    """Return the reliability plot: what was said against what was so, and how often it was said."""
    import io

    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 5.5), layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    points = bins(told)
    upper.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    upper.plot([one[0] for one in points], [one[1] for one in points], marker="o")
    upper.axvline(threshold, color="0.4", linestyle=":", label=f"threshold {threshold:.2f}")
    upper.set_ylabel("share that is to be refused")
    upper.legend(frameon=False)
    edges = np.linspace(0, 1, 21)
    for wanted, label in ((True, "to refuse"), (False, "to do")):
        chances = [one.chance for one in told if one.to_refuse == wanted]
        lower.hist(chances, edges, histtype="step", label=label)
    lower.set_yscale("log")
    lower.set_xlabel("doubt")
    lower.set_ylabel("requests")
    lower.legend(frameon=False)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110, metadata={"Software": None})
    return out.getvalue()


if __name__ == "__main__":
    typer.run(main)
