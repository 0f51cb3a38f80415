"""Add up records of either protocol: success by list or type of task, and what lies behind it."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

from karma.bench.engine.suite import BenchmarkResults
from karma.bench.figures.statistics import wilson
from karma.bench.figures.tables import Sheet
from karma.errors import FileError
from karma.files import read_bytes
from karma.journal.formats import figure_text
from karma.plugins.alfred.replay.trial import TYPES_OF_TASK
from karma.plugins.alfred.suites.experiment import SUBSETS

Records = Sequence[Any]  # `EbRecord` or `LotaRecord`
Figures = dict[str, Any]  # of a row's episodes of one group of tasks, as results.json has them
_SHORT = {
    "average": "avg", "base": "base", "common_sense": "common", "complex_instruction": "complex",
    "visual_appearance": "visual", "spatial": "spatial", "long_horizon": "long",
    "pick_and_place_simple": "simple", "look_at_obj_in_light": "look",
    "pick_clean_then_place_in_recep": "clean", "pick_heat_then_place_in_recep": "heat",
    "pick_cool_then_place_in_recep": "cool", "pick_and_place_with_movable_recep": "movable",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Column:
    """A figure of some episodes: its key in results.json, its title, how it is measured."""

    key: str
    title: str
    of: Callable[[Records], float | None]
    digits: int = 1
    times: int = 1  # 100: in %


@dataclass(frozen=True, slots=True, kw_only=True)
class AlfredTables:
    """How the records of a protocol add up."""

    title: str
    caption: str
    group: str  # the field by which tasks are grouped
    whole: str  # the name of all groups together
    order: tuple[str, ...]  # of groups
    all_groups: bool = False  # shown, also those that no record is of
    averaged: tuple[str, ...] = ()  # keys that of the whole are means over groups, as published
    behind: str  # title of the second table
    behind_caption: str = ""
    interval: str  # its title there
    columns: tuple[Column, ...]  # after the interval


def _each(value: Callable[[Any], float]) -> Callable[[Records], float]:
    """Return a mean over episodes."""
    return lambda records: sum(map(value, records)) / len(records)


def _each_answer(field: str) -> Callable[[Records], float | None]:
    """Return a mean over the planner's answers that say it."""

    def mean(records: Records) -> float | None:
        said = [getattr(answer, field) for record in records for answer in record.answers]
        known = [value for value in said if value is not None]
        return sum(known) / len(known) if known else None

    return mean


def _crashed(records: Records) -> int:
    """Return the episodes that something outside ended; they count as failed."""
    return sum(bool(record.error) for record in records)


def _without_crashed(records: Records) -> float | None:
    """Return success as LoTa-Bench counts it."""
    whole = len(records) - _crashed(records)
    return sum(record.success for record in records) / whole if whole else None


_STEPS = Column("steps", "steps", _each(lambda one: len(one.steps)))
_CALLS = Column("calls", "calls", _each(attrgetter("calls")))
EB_TABLES = AlfredTables(
    title="EB-ALFRED",
    caption="Success in %. Ours: EB-ALFRED's actions, limits, feedback and conditions over this "
    "project's world; not comparable to the point with the published rows, which were measured in "
    "AI2-THOR 2.1.0 with its pictures, on all 300 tasks, with the benchmark's own prompt and "
    "examples. Here the rooms are rebuilt from AI2-THOR 5.0.0, which instance is called X_2 is "
    "inferred, prompt and examples are of our own wording, and pictures, where a planner gets any, "
    "are drawn by this project.",
    group="subset",
    whole="average",
    order=SUBSETS,
    all_groups=True,
    averaged=("success", "progress", "steps", "calls", "invalid", "no_json"),
    behind="Behind the averages",
    behind_caption="Per episode: steps, planner calls, invalid actions (unusable answers counted) "
    "and answers that were no JSON. Errors: episodes that something outside ended, as a model that "
    "cannot take the prompt; they count as failed. Interval: Wilson's, over episodes.",
    interval="interval",
    columns=(
        Column("progress", "progress", _each(attrgetter("progress")), digits=2),
        _STEPS,
        _CALLS,
        Column("invalid", "invalid", _each(attrgetter("invalid"))),
        Column("no_json", "no JSON", _each(attrgetter("no_json"))),
        Column("errors", "errors", _crashed, digits=0),
    ),
)
LOTA_TABLES = AlfredTables(
    title="LoTa-Bench's ALFRED",
    caption="Success at the end, %. Crashed episodes count as failed; the source leaves them out. "
    "No scores of ALFRED stand in LoTa-Bench's repository. Rooms, prompt words and examples are "
    "ours: see docs/plugins/alfred.md.",
    group="kind",
    whole="all",
    order=TYPES_OF_TASK,
    behind="Behind the rates",
    interval="95 %",
    columns=(
        Column("crashed", "crashed", _crashed, digits=0),
        Column("success_without_crashed", "without them", _without_crashed, times=100),
        _STEPS,
        Column("failed", "failed", _each(attrgetter("failed"))),
        Column("unknown", "unknown", _each(attrgetter("unknown"))),
        _CALLS,
        Column("prompt_tokens", "prompt tokens", _each_answer("prompt_tokens")),
        Column("run_tokens", "skill tokens run", _each_answer("run_tokens")),
    ),
)


def figures_of(records: Records, tables: AlfredTables) -> list[Figures]:
    """Return the figures of each row: of the whole, then by group."""
    found = []
    for row in dict.fromkeys(record.row for record in records):
        mine = [record for record in records if record.row == row]
        there = {getattr(record, tables.group) for record in mine}
        groups = [one for one in tables.order if one in there] + sorted(there - {*tables.order})
        parts = [
            _figures(row, one, [r for r in mine if getattr(r, tables.group) == one], tables)
            for one in groups
        ]
        whole = _figures(row, tables.whole, mine, tables)
        means = {key: sum(part[key] for part in parts) / len(parts) for key in tables.averaged}
        found += [whole | means, *parts]
    return found


def _figures(row: str, group: str, records: Records, tables: AlfredTables) -> Figures:
    number, successes = len(records), sum(record.success for record in records)
    interval = wilson(successes, number)
    return {
        "row": row,
        tables.group: group,
        "episodes": number,
        "successes": successes,
        "success": successes / number,
        "low": interval.low if interval else 0.0,
        "high": interval.high if interval else 1.0,
        **{column.key: column.of(records) for column in tables.columns},
    }


def results_of(
    records: Records,
    tables: AlfredTables,
    published: Path | None = None,
    remarks: tuple[str, ...] = (),
) -> BenchmarkResults:
    """Return success by group of tasks, ours first, then the published scores.

    FileError if the published scores are damaged.
    """
    figures = figures_of(records, tables)
    wholes = [one for one in figures if one[tables.group] == tables.whole]
    most = max((one["episodes"] for one in wholes), default=0)
    names = {
        one["row"]: f"**{one['row']}**"
        + (f" ({one['episodes']} tasks)" if one["episodes"] < most else "")
        for one in wholes
    }
    rates = {(names[one["row"]], one[tables.group]): 100 * one["success"] for one in figures}
    if published:
        rates |= _published(published)
    there = dict.fromkeys(one[tables.group] for one in figures)
    groups = (tables.whole, *tables.order) if tables.all_groups else tuple(there)
    return BenchmarkResults(
        figures=figures,
        table=Sheet(
            title=f"{tables.title}, {most} tasks",
            caption=tables.caption,
            head=("row", *(_SHORT.get(one, one) for one in groups)),
            lines=tuple(
                (name, *(figure_text(rates.get((name, one)), 1) for one in groups))
                for name in dict.fromkeys(name for name, _ in rates)
            ),
        ),
        behind=(_behind(wholes, tables),),
        remarks=remarks,
    )


def _behind(wholes: Sequence[Figures], tables: AlfredTables) -> Sheet:
    """Return what lies behind the success of each of our rows."""
    return Sheet(
        title=tables.behind,
        caption=tables.behind_caption,
        head=("row", "success", tables.interval, *(column.title for column in tables.columns)),
        lines=tuple(
            (
                one["row"],
                f"{one['successes']}/{one['episodes']}",
                f"{100 * one['low']:.1f} to {100 * one['high']:.1f}",
                *(_cell(one[column.key], column) for column in tables.columns),
            )
            for one in wholes
        ),
    )


def _cell(value: float | None, column: Column) -> str:
    return figure_text(None if value is None else column.times * value, column.digits)


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
