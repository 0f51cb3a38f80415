"""`karma eval`: experiments."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from karma.cli.eval_options import (
    USED_BY,
    FailUnder,
    Junit,
    Limit,
    Only,
    PlannerDir,
    Rows,
    Seeds,
    Sets,
    changes_of,
    end_below,
    write_junit,
)
from karma.cli.model_options import (
    BaseUrl,
    CassetteFolder,
    CassetteMode,
    States,
    cassette_of,
    model_options,
)
from karma.cli.progress import bar, workers_for
from karma.cli.shared import Json, console, refuse_options, tell, write_json
from karma.cli.tasks import warn_of_tasks
from karma.errors import KarmaError

if TYPE_CHECKING:
    from karma.bench.figures import Figures
    from karma.bench.run import Run


@model_options
def eval_command(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(help="An experiment, e.g. eval/demo.toml.")],
    out: Annotated[Path | None, typer.Option(help="Run folder; default runs/NAME.")] = None,
    fresh: Annotated[bool, typer.Option(help="Start over instead of going on.")] = False,
    tasks: Annotated[bool, typer.Option(help="Also print a line per task.")] = False,
    workers: Annotated[
        int, typer.Option(min=0, help="Processes to use; 0: as many as cores and memory allow.")
    ] = 0,
    ray: Annotated[
        str, typer.Option(help="Address of a Ray cluster, HOST:PORT, to do the episodes on.")
    ] = "",
    steps: Annotated[
        bool | None, typer.Option("--steps/--no-steps", help="Keep a step log per episode.")
    ] = None,
    states: States = None,
    half_width: Annotated[
        float | None,
        typer.Option(help="Add seeds until success rates are as sure as that, e.g. 0.05."),
    ] = None,
    max_seeds: Annotated[
        int | None, typer.Option(min=1, help="With a half-width: seeds at most; default 20.")
    ] = None,
    cassette: CassetteFolder = None,
    cassette_mode: CassetteMode = "",
    base_url: BaseUrl = "",
    sets: Sets = None,
    only: Only = None,
    limit: Limit = None,
    seeds: Seeds = "",
    row: Rows = None,
    planner_dir: PlannerDir = None,
    fail_under: FailUnder = None,
    junit: Junit = None,
    json: Json = None,
    *,
    computed: Mapping[str, Any],
) -> None:
    """Do an experiment: every row on every task. Stopped or killed, the same command goes on.

    Exit code 0: every episode was run, whatever its success; 1: an error, or some were not run;
    4: all run, and success is below --fail-under; 130: stopped.
    """
    from karma.bench.experiment_file import kind_of
    from karma.bench.figures import plain
    from karma.bench.floors import SuccessFloor, check_floors
    from karma.bench.run import Run
    from karma.bench.sweep import SweepRun
    from karma.cli.sweeps import do_sweep
    from karma.journal.not_run import in_words
    from karma.places import find_experiment

    file = find_experiment(file)
    folder = out or Path("runs") / file.stem
    changes = changes_of(sets, only, limit, seeds, row)
    floors = [SuccessFloor.of(text) for text in fail_under or ()]
    kind = kind_of(file, changes)
    if kind == "run" and planner_dir is not None:
        kind = "sweep"
    refuse_options(context, f"{file}: such an experiment", USED_BY[kind])
    opened: dict[str, Any] = {
        "cassette": cassette_of(cassette, cassette_mode),
        "base_url": base_url,
        "computed": computed,
    }
    if kind == "figure":
        _do_figure(file, folder, fresh, workers, ray)
        return
    opened |= {"steps": steps, "states": states, "half_width": half_width, "max_seeds": max_seeds}
    reading = console.status(escape(f"reading {file} ..."))
    if kind == "sweep":
        with reading:
            sweep = SweepRun(
                file, folder, changes=changes, planner_dir=planner_dir, fresh=fresh, opened=opened
            )
        check_floors(floors, [one.name for one in sweep.experiment.rows])
        do_sweep(sweep, workers, ray, floors, junit, json)
        return
    with reading:
        run = Run(file, folder, fresh=fresh, changes=changes, **opened)
    if floors:
        check_floors(floors, [one.name for one in run.experiment.rows])
    if kind == "benchmark":
        _do_benchmark(run, workers, ray, json)
        return
    lines = _done(run, workers, ray, tasks)
    write_json(json, plain(lines))
    write_junit(folder, junit)
    if run.not_run:
        raise KarmaError(in_words(run.not_run))
    end_below([("", lines)], floors)


def _done(run: "Run", workers: int, ray: str, tasks: bool) -> "Sequence[Figures]":
    """Do what is left of a run, print what it shows, and return its figures."""
    from karma.bench.figures import figures
    from karma.bench.precision import reached
    from karma.cli import show
    from karma.journal.formats import spent_text
    from karma.journal.not_run import in_words
    from karma.journal.records import spent_by

    warn_of_tasks(run)
    try:
        _do_episodes(run, workers, ray)
    except KeyboardInterrupt:
        console.print(f"stopped after {_kept(run)}")
        raise typer.Exit(130) from None
    except KarmaError as error:
        if not run.records:
            raise
        not_run = "".join(f"\n  {one}" for one in in_words(run.not_run).splitlines())
        raise KarmaError(f"{error}{not_run}\n  Kept: {_kept(run)}") from error
    if tasks or run.experiment.authors:
        console.print(show.task_table(run.records))
    lines = figures(run.records, run.timings)
    console.print(show.summary_table(lines, run.experiment.name))
    if run.precision is not None:
        console.print(show.precision_table(reached(run.records, run.precision), run.precision))
    spent = [one for record in run.records for one in spent_by(record, run.timings[record.key])]
    if spent:
        tell(spent_text(spent))
    console.print(escape(f"records: {run.records_path}"))
    if words := show.conclusion(lines):
        console.print(escape(words))
    return lines


def _kept(run: "Run") -> str:
    """Return how far a run is that has ended early, and how it goes on."""
    from karma.journal.records import read_records

    done = len(read_records(run.records_path))
    return f"{done} of {run.total} episodes; the same command (without --fresh) goes on"


def _do_episodes(run: "Run", workers: int, ray: str) -> None:
    """Do what is left of a run, with a line that says how far it is."""
    workers = workers_for(run, workers, ray)
    with bar() as progress:
        line = progress.add_task("episodes", total=run.total, completed=len(run.records))
        for record in run.episodes(workers, ray=ray):
            mark = "[green]✓[/]" if record.success else "[red]✗[/]"
            text = f"{mark} {escape(record.task)} · {escape(record.row)}"
            progress.update(line, advance=1, total=run.total, description=text)
        progress.update(line, description="episodes")


def _do_benchmark(run: "Run", workers: int, ray: str, json: Path | None) -> None:
    """Do a benchmark's episodes that are missing, and print its tables."""
    from karma.bench.sheet import to_markdown
    from karma.journal.header import TABLE
    from karma.journal.not_run import in_words

    workers = workers_for(run, workers, ray)
    with console.status(""):
        for record in run.episodes(workers, ray=ray):
            mark = "done" if record.success else record.end
            done = f"{len(run.records)} of {run.total}"
            tell(f"{done}: {record.row}, {record.task}: {mark}")
    results = run.results()
    tell(to_markdown(results.behind))
    write_json(json, results.figures)
    if run.not_run:
        raise KarmaError(in_words(run.not_run))
    tell(f"all tables: {run.folder / TABLE}")


def _do_figure(file: Path, folder: Path, fresh: bool, workers: int, ray: str) -> None:
    """Run an experiment that replays traces instead of doing episodes."""
    from rich.markdown import Markdown

    from karma.journal.header import RESULTS
    from karma.lab.figure import figure_run

    with bar() as progress:
        line = progress.add_task("policies", total=None)
        run = figure_run(file, folder, fresh=fresh)
        for record in run.episodes(workers if ray else workers or 1, ray=ray):
            done, text = len(run.records), escape(record.row.replace("-", " "))
            progress.update(line, total=run.total, completed=done, description=text)
        progress.update(line, total=run.total, completed=run.total, description="drawn")
    claims = folder / "claims.md"
    if claims.exists():
        console.print(Markdown(claims.read_text(encoding="utf-8")))
    console.print(escape(f"results: {folder / RESULTS}"))
