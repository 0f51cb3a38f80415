"""Fit when a planner should refuse: coefficients and threshold beside its weights.

    python scripts/calibrate_doubt.py models/nano/planner.gguf --out models/nano/doubt.json

Requests are drawn with words, forms, topics and languages that training has not; those of
eval/requests are not looked at. Figures are cross-validated over five folds.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from karma import registry
from karma.agent.loading.planner_files import hints_for
from karma.files import to_json, write_atomic
from karma.models.llama.opening import LlamaOptions
from karma.models.manifest import resolve_planner
from karma.offline.guard import go_offline
from karma.plugins.rules.request_refusals import FEATURES
from karma.plugins.training.drawing.memories import generated_rooms
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.figures import (
    Judged,
    Scored,
    brier,
    cross_validated,
    drawn,
    fitted,
    judged,
    shares,
)
from karma.seeds import stream

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
    by_itself = [_sure(one, one.completion.text.startswith("refuse(")) for one in found]
    _tell("the planner by itself", by_itself)
    for name, names in CONTROLS.items():
        _tell(name, cross_validated(found, names, refused=refused))
    rate = sum(one.refused for one in told) / len(told)
    rng = stream(seed, "control")
    by_lot = [_sure(one, rng.random() < rate) for one in found]
    _tell("refused by lot, as often", by_lot)
    if out is not None:
        write_atomic(out, to_json(doubt, indent=2))


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


def _sure(one: Judged, refused: bool) -> Scored:
    return Scored(judged=one, chance=float(refused), refused=refused)


def _tell(title: str, told: Sequence[Scored], *, whole: bool = False) -> None:
    print(f"{title}: Brier score {brier(told):.3f}")
    for name, (times, number, interval) in shares(told).items():
        if (whole or name.startswith("to ")) and interval is not None:
            share = f"{times / number:.3f} [{interval.low:.3f}, {interval.high:.3f}]"
            print(f"  refused of {name:19} {share} ({times} of {number})")


if __name__ == "__main__":
    typer.run(main)
