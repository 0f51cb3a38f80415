"""`karma eval`: experiments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from karma.cli.options import Computed, Kept, option, taking
from karma.cli.progress import bar, workers_for
from karma.cli.shared import Json, console, refuse_options, tell, write_json
from karma.cli.sweeps import do_sweep, end_below, write_junit
from karma.cli.tasks import warn_of_tasks
from karma.errors import KarmaError

if TYPE_CHECKING:
    from karma.agent.journal.owned_folder import Kind
    from karma.bench.engine.experiment_file import Changes
    from karma.bench.engine.run import Run
    from karma.bench.figures.columns import Figures


OTHERWISE, PASSED = "What is done otherwise than the file says", "Whether it passes"


@dataclass(frozen=True, slots=True, kw_only=True)
class EvalOptions:
    """Where an experiment is done and by whom, what is done otherwise, and whether it passes."""

    out: Path | None = option(None, "Run folder; default runs/NAME.")
    fresh: bool = option(False, "Start over instead of going on.")
    tasks: bool = option(False, "Also print a line per task.")
    workers: int = option(0, "Processes to use; 0: as many as cores and memory allow.", min=0)
    ray: str = option("", "Address of a Ray cluster, HOST:PORT, to do the episodes on.")
    steps: bool | None = option(None, "Keep a step log per episode.", "--steps/--no-steps")
    half_width: float | None = option(
        None, "Add seeds until success rates are as sure as that, e.g. 0.05."
    )
    max_seeds: int | None = option(None, "With a half-width: seeds at most; default 20.", min=1)
    sets: list[str] | None = option(
        None,
        'A key of the file said otherwise, "models.planner=x.gguf" or '
        '"rows.NAME.options.recall_k=5" ("*": all rows); paths begin here.',
        "--set",
        metavar="KEY=VALUE",
        panel=OTHERWISE,
    )
    only: list[str] | None = option(
        None, 'These tasks, "simple-*"; again for more.', panel=OTHERWISE
    )
    limit: int | None = option(None, "The first so many of the tasks.", min=1, panel=OTHERWISE)
    seeds: str = option("", 'These seeds, "0-4" or "0,2,5".', panel=OTHERWISE)
    row: list[str] | None = option(None, "This row only; again for more.", panel=OTHERWISE)
    planner_dir: Path | None = option(
        None, "Do all with each planner of a folder of GGUF files.", panel=OTHERWISE
    )
    fail_under: list[str] | None = option(
        None,
        'Exit code 4 if success over all rows is below 0.8; "ROW=0.8": of that row.',
        metavar="RATE",
        panel=PASSED,
    )
    junit: Path | None = option(None, "Also write JUnit's XML here.", panel=PASSED)

    @property
    def changes(self) -> "Changes":
        """What is done otherwise than the file says.

        Raises:
            KarmaError: a setting cannot be read.
        """
        from karma.bench.engine.experiment_file import Changes, Setting, seeds_of, setting_of

        settings = [setting_of(text) for text in self.sets or ()]
        if self.only:
            settings.append(Setting(key="only", value=list(self.only)))
        if self.limit is not None:
            settings.append(Setting(key="limit", value=self.limit))
        if self.seeds:
            settings.append(Setting(key="seeds", value=seeds_of(self.seeds)))
        return Changes(settings=tuple(settings), rows=tuple(self.row or ()))


_FIGURE = frozenset({"out", "fresh", "workers", "ray"})
_RUN = frozenset(one.name for kind in (EvalOptions, Kept, Computed) for one in fields(kind))
_RUN |= {"json"}
_SWEEP = _RUN - {"tasks"}
_NO_BENCHMARK = {
    "steps", "states", "half_width", "max_seeds", "planner_dir", "fail_under", "junit",
}  # fmt: skip
USED_BY: Mapping["Kind", frozenset[str]] = {  # kind of run -> options that it can use
    "figure": _FIGURE, "benchmark": _SWEEP - _NO_BENCHMARK, "sweep": _SWEEP, "run": _RUN,
}  # fmt: skip


@taking(given=EvalOptions, kept=Kept, computed=Computed)
def eval_command(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(help="An experiment, e.g. eval/demo.toml.")],
    json: Json = None,
    *,
    given: EvalOptions,
    kept: Kept,
    computed: Computed,
) -> None:
    """Do an experiment: every row on every task. Stopped or killed, the same command goes on.

    Exit code 0: every episode was run, whatever its success; 1: an error, or some were not run;
    4: all run, and success is below --fail-under; 130: stopped.
    """
    from karma.agent.journal.not_run import in_words
    from karma.bench.engine.experiment_file import kind_of
    from karma.bench.engine.run import Run
    from karma.bench.engine.sweep import SweepRun
    from karma.bench.figures.columns import plain
    from karma.bench.figures.precision import SuccessFloor, check_floors
    from karma.files import find_experiment

    file = find_experiment(file)
    folder = given.out or Path("runs") / file.stem
    changes, workers, ray = given.changes, given.workers, given.ray
    floors = [SuccessFloor.of(text) for text in given.fail_under or ()]
    kind = kind_of(file, changes)
    if kind == "run" and given.planner_dir is not None:
        kind = "sweep"
    refuse_options(context, f"{file}: such an experiment", USED_BY[kind])
    tape = kept.tape
    if kind == "figure":
        _do_figure(file, folder, given.fresh, workers, ray)
        return
    opened: dict[str, Any] = {
        "cassette": tape,
        "base_url": kept.base_url,
        "computed": computed.keys,
        "steps": given.steps,
        "states": kept.states,
        "half_width": given.half_width,
        "max_seeds": given.max_seeds,
    }
    reading = console.status(escape(f"reading {file} ..."))
    if kind == "sweep":
        with reading:
            sweep = SweepRun(
                file, folder, changes=changes, planner_dir=given.planner_dir, fresh=given.fresh,
                opened=opened,
            )  # fmt: skip
        check_floors(floors, [one.name for one in sweep.experiment.rows])
        do_sweep(sweep, workers, ray, floors, given.junit, json)
        return
    with reading:
        run = Run(file, folder, fresh=given.fresh, changes=changes, **opened)
    if floors:
        check_floors(floors, [one.name for one in run.experiment.rows])
    if kind == "benchmark":
        _do_benchmark(run, workers, ray, json)
        return
    lines = _done(run, workers, ray, given.tasks)
    write_json(json, plain(lines))
    write_junit(folder, given.junit)
    if run.not_run:
        raise KarmaError(in_words(run.not_run))
    end_below([("", lines)], floors)


def _done(run: "Run", workers: int, ray: str, tasks: bool) -> "Sequence[Figures]":
    """Do what is left of a run, print what it shows, and return its figures."""
    from karma.agent.journal.formats import spent_text
    from karma.agent.journal.not_run import in_words
    from karma.agent.journal.records import spent_by
    from karma.bench.figures.columns import figures
    from karma.bench.figures.precision import reached
    from karma.cli import show

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
    from karma.agent.journal.records import read_records

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
    from karma.agent.journal.header import TABLE
    from karma.agent.journal.not_run import in_words
    from karma.bench.figures.sheet import to_markdown

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

    from karma.agent.journal.header import RESULTS
    from karma.bench.suites.policies.figure import figure_run

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
