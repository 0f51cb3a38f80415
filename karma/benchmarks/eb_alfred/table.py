"""Add up records, and write them beside the published scores."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from karma.bench.sheet import Sheet
from karma.bench.statistics import wilson
from karma.benchmarks.eb_alfred.experiment import SUBSETS
from karma.benchmarks.eb_alfred.play import EbRecord
from karma.errors import FileError
from karma.files import read_bytes
from karma.journal.formats import UNKNOWN, figure_text

AVERAGE = "average"  # of the subsets' rates, as published
_SHORT = {
    AVERAGE: "avg", "base": "base", "common_sense": "common", "complex_instruction": "complex",
    "visual_appearance": "visual", "spatial": "spatial", "long_horizon": "long",
}  # fmt: skip
_CAPTION = (
    "Success in %. Ours: EB-ALFRED's actions, limits, feedback and conditions over this project's "
    "world; not comparable to the point with the published rows, which were measured in AI2-THOR "
    "2.1.0 with its pictures, on all 300 tasks, with the benchmark's own prompt and examples. "
    "Here the rooms are rebuilt from AI2-THOR 5.0.0, which instance is called X_2 is inferred, "
    "prompt and examples are of our own wording, and pictures, where a planner gets any, are drawn "
    "by this project."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class EbFigures:
    """What a row's episodes of one subset, or of all, come to; means are over episodes."""

    row: str
    subset: str  # or "average"
    episodes: int
    successes: int
    success: float  # of the average: the mean of the subsets'
    low: float  # ends of Wilson's interval over all episodes
    high: float
    progress: float
    steps: float
    calls: float
    invalid: float
    no_json: float
    errors: int  # episodes that something outside ended; they count as failed


def results_of(records: Sequence[EbRecord]) -> list[EbFigures]:
    """Return the figures of each row: the average, then the subsets."""
    found = []
    for row in dict.fromkeys(record.row for record in records):
        mine = [record for record in records if record.row == row]
        subsets = [
            _figures(row, one, [r for r in mine if r.subset == one]) for one in _present(mine)
        ]
        means = {
            name: sum(getattr(one, name) for one in subsets) / len(subsets)
            for name in ("success", "progress", "steps", "calls", "invalid", "no_json")
        }
        found += [_figures(row, AVERAGE, mine, **means), *subsets]
    return found


def _present(records: Sequence[EbRecord]) -> list[str]:
    there = {record.subset for record in records}
    return [one for one in SUBSETS if one in there] + sorted(there - {*SUBSETS})


def _figures(row: str, subset: str, records: Sequence[EbRecord], **means: float) -> EbFigures:
    number, successes = len(records), sum(record.success for record in records)
    interval = wilson(successes, number)

    def mean(value: Callable[[EbRecord], float]) -> float:
        return sum(map(value, records)) / number

    measured = {
        "success": successes / number,
        "progress": mean(lambda record: record.progress),
        "steps": mean(lambda record: len(record.steps)),
        "calls": mean(lambda record: record.calls),
        "invalid": mean(lambda record: record.invalid),
        "no_json": mean(lambda record: record.no_json),
    }
    return EbFigures(
        row=row,
        subset=subset,
        episodes=number,
        successes=successes,
        low=interval.low if interval else 0.0,
        high=interval.high if interval else 1.0,
        errors=sum(bool(record.error) for record in records),
        **{**measured, **means},
    )


def success_sheet(results: Sequence[EbFigures], published: Path | None) -> Sheet:
    """Return success rates by subset, ours first, then the published ones.

    Raises:
        FileError: the published scores are damaged.
    """
    columns = (AVERAGE, *SUBSETS)
    rates = {(one.row, one.subset): 100 * one.success for one in results}
    ours = dict.fromkeys(one.row for one in results)
    theirs = {} if published is None else _published(published)
    most = max((one.episodes for one in results if one.subset == AVERAGE), default=0)
    fewer = {
        one.row: f" ({one.episodes} tasks)"
        for one in results
        if one.subset == AVERAGE and one.episodes < most
    }
    lines = [
        (f"**{row}**{fewer.get(row, '')}", *(_cell(rates.get((row, one))) for one in columns))
        for row in ours
    ]
    models = dict.fromkeys(model for model, _ in theirs)
    lines += [(model, *(_cell(theirs.get((model, one))) for one in columns)) for model in models]
    return Sheet(
        title=f"EB-ALFRED, {most} tasks",
        caption=_CAPTION,
        head=("row", *(_SHORT[one] for one in columns)),
        lines=tuple(lines),
    )


def detail_sheet(results: Sequence[EbFigures]) -> Sheet:
    """Return what lies behind the average of each of our rows."""
    return Sheet(
        title="Behind the averages",
        caption="Per episode: steps, planner calls, invalid actions (unusable answers counted) and "
        "answers that were no JSON. Errors: episodes that something outside ended, as a model that "
        "cannot take the prompt; they count as failed. Interval: Wilson's, over episodes.",
        head=("row", "success", "interval", "progress", "steps", "calls", "invalid", "no JSON",
              "errors"),
        lines=tuple(
            (
                one.row,
                f"{one.successes}/{one.episodes}",
                f"{100 * one.low:.1f} to {100 * one.high:.1f}",
                figure_text(one.progress),
                figure_text(one.steps, 1),
                figure_text(one.calls, 1),
                figure_text(one.invalid, 1),
                figure_text(one.no_json, 1),
                str(one.errors),
            )
            for one in results
            if one.subset == AVERAGE
        ),
    )  # fmt: skip


def _cell(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:.1f}"


def _published(path: Path) -> dict[tuple[str, str], float]:
    """Read published scores: columns model, subset, score (%)."""
    found: dict[tuple[str, str], float] = {}
    try:
        text = read_bytes(path).decode()
        for number, row in enumerate(csv.DictReader(io.StringIO(text)), start=2):
            try:
                found[row["model"], row["subset"]] = float(row["score"])
            except (KeyError, TypeError, ValueError) as error:
                raise FileError(path, f"line {number}: {error}") from error
    except UnicodeDecodeError as error:
        raise FileError(path, str(error)) from error
    return found
