"""`karma eval` of a grid of settings, and `karma export`."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from karma.cli.progress import bar
from karma.cli.shared import console, sheet_table, write_for, write_json
from karma.cli.tasks import warn_of_tasks
from karma.files import write_atomic

if TYPE_CHECKING:
    from karma.bench.engine.sweep import SweepRun
    from karma.bench.engine.sweep_folder import SweepData
    from karma.bench.figures.columns import Figures
    from karma.bench.figures.precision import SuccessFloor

BELOW = 4  # exit code: done, and a success rate is below --fail-under


def export_command(
    run: Annotated[Path, typer.Argument(help="Folder of a run or a sweep.")],
    to: Annotated[str, typer.Option(help='"csv", "parquet" or "junit".')] = "csv",
    out: Annotated[
        Path | None,
        typer.Option(help="File to write; default in the run's folder."),
    ] = None,
) -> None:
    """Write a run's episodes for other programs: one line each, with every metric."""
    from karma.bench.engine.export import exported

    name = {"junit": "junit.xml"}.get(to, f"episodes.{to}")
    console.print(escape(f"written: {write_for(run, out, name, exported(run, to))}"))


def do_sweep(
    sweep: "SweepRun", workers: int, ray: str, floors: "list[SuccessFloor]", junit: Path | None,
    json: Path | None,
) -> None:  # fmt: skip
    """Do what is missing of a sweep, and print its table.

    Raises:
        typer.Exit: code 1 where a cell failed, 4 where one is below a floor, 130 when stopped.
    """
    try:
        _do_cells(sweep, workers, ray)
    except KeyboardInterrupt:
        console.print("stopped; the same command (without --fresh) goes on")
        raise typer.Exit(130) from None
    print_sweep(sweep.data, json)
    write_junit(sweep.folder, junit)
    if sweep.failed:
        raise typer.Exit(1)
    from karma.bench.engine.sweep_folder import figures_by_cell

    end_below([(cell.name, lines) for cell, lines in figures_by_cell(sweep.data)], floors)


def _do_cells(sweep: "SweepRun", workers: int, ray: str) -> None:
    told: set[tuple[str, ...]] = set()  # tasks that were looked at; most cells have the same
    with bar() as progress:
        line = progress.add_task("cells", total=len(sweep.cells))
        for one in sweep.episodes(workers, ray=ray, opened=lambda run: warn_of_tasks(run, told)):
            mark = "[green]✓[/]" if one.record.success else "[red]✗[/]"
            text = f"{mark} {escape(one.cell)}: {one.done} of {one.total} episodes"
            progress.update(line, completed=one.number - 1 + one.done / one.total, description=text)
        progress.update(line, completed=len(sweep.cells), description="cells")


def print_sweep(data: "SweepData", json: Path | None) -> None:
    """Print a sweep's table and what failed; also write its figures where that is wanted."""
    from karma.agent.journal.header import TABLE
    from karma.bench.engine.sweep_folder import figures_by_cell, sweep_sheet
    from karma.bench.figures.columns import plain

    console.print(sheet_table(sweep_sheet(data)))
    for cell in data.cells:
        if cell.failed:
            console.print(
                f"[red]failed:[/] {escape(f'{cell.name}: {cell.failed}')}", soft_wrap=True
            )
    console.print(escape(f"table: {data.folder / TABLE}"))
    if json is not None:
        figures = [
            {"cell": cell.name, "values": cell.values, "figures": plain(lines)}
            for cell, lines in figures_by_cell(data)
        ]
        write_json(json, figures)


def write_junit(folder: Path, junit: Path | None) -> None:
    """Write a run's test cases where that is wanted."""
    if junit is not None:
        from karma.bench.engine.export import to_junit

        write_atomic(junit, to_junit(folder))
        console.print(escape(f"test cases: {junit}"))


def end_below(
    figures: "Sequence[tuple[str, Sequence[Figures]]]", floors: "list[SuccessFloor]"
) -> None:
    """End with code 4 where a run, or a cell of a sweep by its name, is below a floor."""
    from karma.bench.figures.precision import below

    said = [
        f"{cell}: {words}" if cell else words
        for cell, lines in figures
        for words in below(lines, floors)
    ]
    for words in said:
        console.print(f"[red]✗[/] {escape(words)}", soft_wrap=True, highlight=False)
    if said:
        raise typer.Exit(BELOW)
