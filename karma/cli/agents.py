"""`karma eval`."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.markup import escape

from karma.cli.progress import bar, workers_for
from karma.cli.shared import (
    STOPPED,
    UNFINISHED,
    Computed,
    Json,
    Kept,
    argument,
    console,
    option,
    refuse_options,
    tell,
    write_json,
)
from karma.cli.worlds import warn_of_tasks
from karma.errors import KarmaError

if TYPE_CHECKING:
    from karma.bench.engine.experiment_file import Changes
    from karma.bench.engine.run import Run
    from karma.journal.header import Kind

MARKS = {True: "[green]✓[/]", False: "[red]✗[/]"}  # of success


OVERRIDES = "Overrides of the file"


@dataclass(frozen=True, kw_only=True)
class EvalOptions:
    """Where an experiment is done and by whom, what is done otherwise, and whether it passes."""

    context: typer.Context
    file: Path = argument(..., "An experiment, e.g. eval/demo.toml.")
    json: Json = None
    out: Path | None = option(None, "Run folder; default runs/NAME.")
    fresh: bool = option(False, "Start over; the earlier folder is kept as NAME.1.")
    workers: int = option(0, "Processes to use; 0: as many as cores and memory allow.", min=0)
    ray: str = option("", "Address of a Ray cluster, HOST:PORT, to do the episodes on.")
    steps: bool | None = option(None, "Keep a step log per episode.", "--steps/--no-steps")
    sets: list[str] | None = option(
        None,
        'A key of the file said otherwise, "models.planner=x.gguf" or '
        '"rows.NAME.options.recall_k=5" ("*": all rows); paths begin here.',
        "--set",
        metavar="KEY=VALUE",
        panel=OVERRIDES,
    )
    planner: str = option(
        "", "A planner in place of the file's: a name, or a GGUF.", panel=OVERRIDES
    )
    only: list[str] | None = option(
        None, 'These tasks, "simple-*"; again for more.', panel=OVERRIDES
    )
    limit: int | None = option(None, "The first so many of the tasks.", min=1, panel=OVERRIDES)
    seeds: str = option("", 'These seeds, "0-4" or "0,2,5".', panel=OVERRIDES)
    row: list[str] | None = option(None, "This row only; again for more.", panel=OVERRIDES)
    fail_under: float | None = option(
        None, "Exit code 4 if the success rate over all rows is lower.", min=0, max=1
    )

    @property
    def changes(self) -> "Changes":
        """What is done otherwise than the file says; KarmaError where that cannot be read."""
        from karma.bench.engine.experiment_file import Changes, Setting, seeds_of, setting_of

        settings = [setting_of(text) for text in self.sets or ()]
        if self.planner:
            settings.append(Setting(key="models.planner", value=self.planner))
        if self.only:
            settings.append(Setting(key="only", value=list(self.only)))
        if self.limit is not None:
            settings.append(Setting(key="limit", value=self.limit))
        if self.seeds:
            settings.append(Setting(key="seeds", value=seeds_of(self.seeds)))
        return Changes(settings=tuple(settings), rows=tuple(self.row or ()))


_FIGURE = frozenset({"out", "fresh", "workers", "ray"})
_RUN = frozenset(one.name for kind in (EvalOptions, Kept, Computed) for one in fields(kind))
USED_BY: Mapping["Kind", frozenset[str]] = {  # kind of run -> options that it can use
    "figure": _FIGURE, "benchmark": _RUN - {"steps", "fail_under"}, "run": _RUN,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class EvalCommand(Computed, Kept, EvalOptions):
    """Run an experiment: every row on every task. Stopped or killed, the same command resumes.

    Exit code 0: every episode was run, whatever its success; 1: an error, or some were not run;
    4: all run, and the success rate is below --fail-under; 130: stopped.
    """

    def do(self) -> None:
        """Do what kind of experiment the file is."""
        from karma.bench.engine.experiment_file import kind_of
        from karma.bench.engine.run import Run
        from karma.files import find_experiment

        file = find_experiment(self.file)
        folder, changes = self.out or Path("runs") / file.stem, self.changes
        kind = kind_of(file, changes)
        refuse_options(self.context, f"{file}: such an experiment", USED_BY[kind])
        opened: dict[str, Any] = {
            "cassette": self.tape,
            "base_url": self.base_url,
            "computed": self.computed,
            "steps": self.steps,
        }
        if kind == "figure":
            self._do_figure(file, folder)
            return
        with console.status(escape(f"reading {file} ...")):
            run = Run(file, folder, fresh=self.fresh, changes=changes, **opened)
        _tell_of_earlier(run)
        if kind == "benchmark":
            self._do_benchmark(run)
        else:
            self._do_run(run)

    def _do_run(self, run: "Run") -> None:
        """Do what is left of a run, then print and write what it shows."""
        from karma.bench.figures.columns import figures, plain
        from karma.cli import show
        from karma.journal.formats import spent_text
        from karma.journal.records import in_words, spent_by

        warn_of_tasks(run)
        try:
            self._do_episodes(run)
        except KeyboardInterrupt:
            console.print(f"stopped after {_kept(run)}")
            raise typer.Exit(STOPPED) from None
        except KarmaError as error:
            if not run.records:
                raise
            not_run = "".join(f"\n  {one}" for one in in_words(run.not_run).splitlines())
            raise KarmaError(f"{error}{not_run}\n  Kept: {_kept(run)}") from error
        lines = figures(run.records, run.timings)
        console.print(show.summary_table(lines, run.experiment.name))
        spent = [one for record in run.records for one in spent_by(record, run.timings[record.key])]
        if spent:
            tell(spent_text(spent))
        console.print(escape(f"records: {run.records_path}"))
        if words := show.conclusion(lines):
            console.print(escape(words))
        write_json(self.json, plain(lines))
        if run.not_run:
            raise KarmaError(in_words(run.not_run))
        successes = [record.success for record in run.records if not record.unjudged]
        rate = sum(successes) / len(successes) if successes else 0.0
        if self.fail_under is not None and rate < self.fail_under:
            tell(f"success rate {rate:.2f} is below --fail-under {self.fail_under:.2f}")
            raise typer.Exit(UNFINISHED)

    def _do_episodes(self, run: "Run") -> None:
        """Do what is left of a run, with a line that says how far it is."""
        workers = workers_for(run, self.workers, self.ray)
        with bar() as progress:
            line = progress.add_task("episodes", total=run.total, completed=len(run.records))
            for record in run.episodes(workers, ray=self.ray):
                text = f"{MARKS[record.success]} {escape(record.task)} · {escape(record.row)}"
                progress.update(line, advance=1, total=run.total, description=text)
            progress.update(line, description="episodes")

    def _do_benchmark(self, run: "Run") -> None:
        """Do a benchmark's episodes that are missing, and print its tables."""
        from karma.bench.figures.tables import to_markdown
        from karma.journal.folder import TABLE
        from karma.journal.records import in_words

        workers = workers_for(run, self.workers, self.ray)
        with console.status(""):
            for record in run.episodes(workers, ray=self.ray):
                mark = "done" if record.success else record.end
                tell(f"{len(run.records)} of {run.total}: {record.row}, {record.task}: {mark}")
        results = run.results()
        tell(to_markdown(results.behind))
        write_json(self.json, results.figures)
        if run.not_run:
            raise KarmaError(in_words(run.not_run))
        tell(f"all tables: {run.folder / TABLE}")

    def _do_figure(self, file: Path, folder: Path) -> None:
        """Run an experiment that replays traces instead of doing episodes."""
        from rich.markdown import Markdown

        from karma.bench.policies.figure import figure_run
        from karma.journal.folder import RESULTS

        workers = self.workers if self.ray else self.workers or 1
        with bar() as progress:
            line = progress.add_task("policies", total=None)
            run = figure_run(file, folder, fresh=self.fresh)
            _tell_of_earlier(run)
            for record in run.episodes(workers, ray=self.ray):
                done, text = len(run.records), escape(record.row.replace("-", " "))
                progress.update(line, total=run.total, completed=done, description=text)
            progress.update(line, total=run.total, completed=run.total, description="drawn")
        claims = folder / "claims.md"
        if claims.exists():
            console.print(Markdown(claims.read_text(encoding="utf-8")))
        console.print(escape(f"results: {folder / RESULTS}"))


def _tell_of_earlier(run: "Run") -> None:
    """Say where the run is kept whose folder this run has taken."""
    if run.earlier is not None:
        tell(f"the earlier run is kept: {run.earlier}")


def _kept(run: "Run") -> str:
    """Return how far a run is that has ended early, and how it goes on."""
    from karma.journal.records import read_records

    done = len(read_records(run.records_path))
    return f"{done} of {run.total} episodes; the same command (without --fresh) goes on"
