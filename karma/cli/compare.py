"""`karma compare` and `karma table`: what runs show, and how sure that is."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.markup import escape

from karma.cli.shared import (
    Json,
    argument,
    console,
    option,
    refuse_options,
    sheet_table,
    tell,
    write_json,
)
from karma.errors import KarmaError
from karma.files import inside

if TYPE_CHECKING:
    from karma.bench.figures.compare import Comparison, Split
    from karma.bench.figures.tables import Sheet


def compare(
    runs: list[str] = argument(
        ..., "Run folders, or RUN:ROW for one row; the first with each other."
    ),
    json: Json = None,
) -> None:
    """Say how runs or rows differ on the same tasks and seeds, and how sure that is."""
    from karma.bench.figures.compare import compare_kinds
    from karma.bench.figures.results import arms_named, set_apart, sides_named, unfinished

    sides = sides_named(runs)
    for words in unfinished(side.run for side in sides):
        tell(words)
    found = [compare_kinds(group[0], other) for group in arms_named(sides) for other in group[1:]]
    for comparisons in found:
        for sheet in _sheets(comparisons):
            console.print(sheet_table(sheet))
        tell(_remarks(comparisons[0]))
    for words in set_apart(sides):
        tell(words)
    write_json(json, [one for group in found for one in group])


def table(
    context: typer.Context,
    run: Path = argument(..., "A run folder."),
    out: Path | None = option(None, "Folder for table.md and table.csv; default RUN."),
    beside: list[Path] | None = option(
        None, "Of others' benchmarks: a run whose rows stand in the same table."
    ),
    json: Json = None,
) -> None:
    """Write a run's tables as Markdown and CSV, beside the published figures."""
    from karma.bench.figures import tables
    from karma.bench.figures.columns import plain
    from karma.bench.figures.results import (
        load_published,
        margin_sheet,
        margins,
        result_of,
        to_csv,
        unfinished,
    )
    from karma.bench.figures.tables import to_markdown
    from karma.journal.folder import SIGN, TABLE, write_made
    from karma.journal.header import kind_in
    from karma.journal.run_folder import read_run

    if kind_in(run) == "benchmark":
        refuse_options(context, f"{run}: such a table", {"beside", "out", "json"})
        _write_benchmark([run, *(beside or ())], out or run, json)
        return
    if beside:
        raise KarmaError(
            "--beside is for runs of others' benchmarks\n  To fix: karma compare RUN RUN"
        )
    data = read_run(run)
    if not data.records:
        raise KarmaError(f"{run}: the run has no episodes yet\n  To fix: karma eval FILE")
    result = result_of(data, load_published())
    margin = [sheet for sheet in (margin_sheet(result),) if sheet is not None]
    sheets = [*tables.sheets(result), *margin]
    for sheet in (*tables.main_sheets(result), *margin):
        console.print(sheet_table(sheet))
    for words in unfinished([data]):
        tell(words)
    folder = out or run
    rows = to_csv(result).encode()
    write_made(inside(folder, TABLE), to_markdown(sheets).encode() + SIGN + b"\n")
    write_made(inside(folder, "table.csv"), rows, sign=rows.partition(b"\n")[0])
    names = f"{folder}/{TABLE}, table.csv"
    console.print(escape(f"written, with all that stands behind them: {names}"))
    if json is not None:
        parts = {
            "name": result.name,
            "figures": plain(result.figures),
            "comparisons": result.comparisons,
            "failures": result.failures,
            "margins": margins(result),
        }
        write_json(json, parts)


def _write_benchmark(runs: Sequence[Path], folder: Path, json: Path | None) -> None:
    """Write the tables of a benchmark's runs as Markdown, and print what is their own.

    Raises:
        KarmaError: the run has no episodes yet; or see `read_results`.
    """
    from karma.bench.engine.benchmark_runs import read_results, written
    from karma.bench.figures.tables import to_markdown
    from karma.journal.folder import TABLE, write_made

    results = read_results(*runs)
    if not results.figures:
        raise KarmaError(f"{runs[0]}: the run has no episodes yet\n  To fix: karma eval FILE")
    write_made(inside(folder, TABLE), written(results))
    tell(to_markdown(results.behind))
    tell(f"all tables: {folder / TABLE}")
    write_json(json, results.figures)


def _sheets(comparisons: "Sequence[Comparison]") -> "Iterator[Sheet]":
    """Yield every metric of two arms, and their success rates by kind of task."""
    from karma.bench.figures.statistics import interval_text
    from karma.bench.figures.tables import Sheet, comparison_sheet

    whole = comparisons[0]
    yield Sheet(
        title=f"{whole.first} against {whole.second}",
        caption=(
            f"{whole.pairs} pairs: {whole.tasks} tasks, seeds {', '.join(map(str, whole.seeds))}. "
            "Difference: first - second; 95 % intervals keep a task's seeds together."
        ),
        head=("per episode", "first", "second", "difference"),
        lines=tuple(
            (
                line.title,
                interval_text(line.first, line.digits),
                interval_text(line.second, line.digits),
                interval_text(line.difference, line.digits, sign=True),
            )
            for line in whole.lines
            if line.first.value is not None or line.second.value is not None
        ),
    )
    sheet = comparison_sheet(comparisons)  # without the arms, which the title above names
    lines = tuple(line[2:] for line in sheet.lines)
    yield replace(sheet, head=sheet.head[2:], lines=lines)


def _remarks(one: "Comparison") -> str:
    """Return which tasks only one arm solved."""
    from karma.journal.formats import UNKNOWN

    def solved(splits: "tuple[Split, ...]") -> str:
        words = (f"{one.task} (seed {', '.join(map(str, one.seeds))})" for one in splits)
        return "; ".join(words) or UNKNOWN

    return (
        f"only {one.first} solved: {solved(one.only_first)}\n"
        f"only {one.second} solved: {solved(one.only_second)}"
    )
