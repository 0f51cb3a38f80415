"""`karma report`: a run as one page that needs nothing else."""

from dataclasses import dataclass
from pathlib import Path

import typer

from karma.cli.progress import bar
from karma.cli.shared import argument, console, option, refuse_options, tell
from karma.errors import KarmaError
from karma.files import inside

PAGE, _SIGN = "report.html", b"Made by <code>karma report</code>"


@dataclass(frozen=True, kw_only=True)
class ReportCommand:
    """Write a run as one HTML page: tables, plots, and replayed episodes."""

    context: typer.Context
    run: Path = argument(..., "A run folder, made by `karma eval`.")
    out: Path | None = option(None, "The page; default RUN/report.html.")
    episodes: str = option("8", "Which to replay: all, a number, a task, ROW/TASK/SEED.")

    def do(self) -> None:
        """Write the page of a run, a benchmark's run, or a figure."""
        from karma.journal.folder import write_made
        from karma.journal.header import kind_in

        match kind_in(self.run):
            case "figure":
                from karma.bench.report.suite_pages import figure_page

                refuse_options(self.context, f"{self.run}: the page of a figure", {"out"})
                page = figure_page(self.run)
            case "benchmark":
                from karma.bench.report.suite_pages import benchmark_page

                refuse_options(self.context, f"{self.run}: the page of a benchmark", {"out"})
                page = benchmark_page(self.run)
            case _:
                page = self._run_page()
        path = self.out or inside(self.run, PAGE)
        write_made(path, page.encode(), _SIGN)
        tell(f"page: {path}, {path.stat().st_size / 1e6:.1f} MB")

    def _run_page(self) -> str:
        from karma.bench.figures.results import load_published, result_of
        from karma.bench.report.page import render
        from karma.bench.report.replay import choose, replays
        from karma.journal.run_folder import read_run

        run = read_run(self.run)
        if not run.records:
            raise KarmaError(
                f"{self.run}: no episode is done yet\n  To fix: karma eval FILE --out {self.run}"
            )
        chosen = choose(run.records, self.episodes)
        result = result_of(run, load_published())
        shown = []
        with bar(passing=True) as progress:
            line = progress.add_task("replaying episodes", total=len(chosen))
            for one in replays(run, chosen):
                shown.append(one)
                progress.advance(line)
        with console.status("figures, pictures"):
            page = render(run, result, shown)
        actions = sum(one.actions for one in shown)
        same = actions - sum(len(one.differing) for one in shown)
        color = "green" if same == actions else "red"
        console.print(
            f"replayed: {len(shown)} of {len(run.records)} episodes; "
            f"[{color}]{same} of {actions}[/] actions went as logged"
        )
        return page
