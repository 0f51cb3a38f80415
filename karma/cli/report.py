"""`karma report`: a run as one page that needs nothing else."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import typer

from karma.cli.progress import bar
from karma.cli.shared import argument, console, option, refuse_options, tell, write_for
from karma.errors import KarmaError

T = TypeVar("T")
PAGE = "report.html"
CHOICE = ("8", "auto", "auto")  # of episodes, instructions and frames, unless told otherwise


@dataclass(frozen=True, kw_only=True)
class ReportCommand:
    """Write a run as one HTML page: tables, plots, and episodes to step through."""

    context: typer.Context
    runs: list[str] = argument(
        ...,
        "A run folder, made by `karma eval`; or a sweep, or several (or RUN:ROW), for a "
        "page that compares.",
    )
    out: Path | None = option(
        None, "The page; default RUN/report.html, of several comparison.html beside the first."
    )
    episodes: str = option(
        CHOICE[0], "Which can be stepped through: all, a number, a task, ROW/TASK/SEED."
    )
    instructions: str = option(
        CHOICE[1],
        'Of those, which instructions: all, numbers such as 1-40,77, or "auto": of long sequences '
        "those that failed first.",
    )
    frames: str = option(
        CHOICE[2],
        'First-person pictures: "every" action, "calls" only, their "ends", "none", or "auto": the '
        "less the more there is to show.",
    )
    published: Path | None = option(None, "The paper's figures, to stand beside ours.")
    reference: str = option("", "Of several: that which the others are held against.")
    pages: bool = option(True, "Of several: also make their own pages, where missing or old.")
    home: str = option("", 'Of lived-in homes: which is shown, such as "usual/home_003".')
    day: int | None = option(None, "Of lived-in homes: which day; the first is 0.", min=0)
    row: str = option("", "Of lived-in homes: which row; ours unless told otherwise.")

    def do(self) -> None:
        """Write the page of what kind of run, or runs, there is."""
        from karma.agent.journal.owned_folder import benchmark_in, kind_in

        run = Path(self.runs[0])
        kind = kind_in(run) if len(self.runs) == 1 else "sweep"
        is_home = kind == "benchmark" and benchmark_in(run) == "lived"
        choice = (self.episodes, self.instructions, self.frames)
        if (self.home or self.day is not None or self.row) and not is_home:
            raise KarmaError(
                "--home, --day and --row are of one run of lived-in homes\n"
                "  To fix: karma eval eval/lived/demo.toml"
            )
        if is_home and choice != CHOICE:
            raise KarmaError(
                f"{run}: lived-in homes have days, no episodes or frames\n"
                f"  To fix: karma report {run} --home HOME --day DAY --row ROW"
            )
        if is_home:
            refuse_options(self.context, f"{run}: such a page", {"out", "home", "day", "row"})
            self._write_lived(run)
        elif kind == "sweep":
            self._write_comparison()
        elif kind == "figure":
            from karma.bench.report.suite_pages import figure_page

            refuse_options(self.context, f"{run}: the page of a figure", {"out"})
            tell(f"page: {write_for(run, self.out, PAGE, figure_page(run).encode())}")
        else:
            own = {"out", "episodes", "instructions", "frames", "published"}
            refuse_options(self.context, f"{run}: the page of one run", own)
            self._write_run(run, self.out)

    def _write_lived(self, run: Path) -> None:
        """Write the page of a run of lived-in homes, with one day to watch."""
        from karma.bench.report.suite_pages import chosen_day, lived_again, read_lived, render_lived

        found = read_lived(run)
        record = chosen_day(found, self.home, self.day, self.row)
        with bar(passing=True) as progress:
            line = progress.add_task("days lived again", total=record.day + 1)
            shown = lived_again(found, record, after_day=lambda: progress.advance(line))
        path = write_for(run, self.out, PAGE, render_lived(found, shown).encode())
        tell(
            f"page: {path}: {len(found.records)} days; to watch: {record.task} of {record.row!r}, "
            f"{path.stat().st_size / 1e6:.1f} MB"
        )

    def _write_comparison(self) -> None:
        """Write the page of several runs; unless told otherwise also their own pages."""
        from karma.agent.journal.header import EPISODES
        from karma.bench.report.comparison import (
            chosen_reference,
            comparison_of,
            render_comparison,
            sides_of,
        )

        sides, notes = sides_of(self.runs)
        against = chosen_reference(sides, self.reference)
        if len(self.runs) == 1:
            first = Path(self.runs[0])
            path, title = self.out or first / PAGE, first.absolute().name
        else:
            path = self.out or sides[0].run.folder.parent / "comparison.html"
            title = f"{len(self.runs)} runs side by side"
        (page,) = _with_bar(comparison_of(title, sides, against, notes, path), "comparing, %")
        write_for(path.parent, self.out, path.name, render_comparison(page).encode())
        tell(f"page: {path}: {len(page.sides)} side by side, {len(page.tasks)} tasks")
        for note in page.notes:
            tell(note)
        pages = {one.run.folder: one.run.folder / PAGE for one in sides if self.pages}
        old = [
            folder
            for folder, own in pages.items()
            if not own.exists() or own.stat().st_mtime < (folder / EPISODES).stat().st_mtime
        ]
        for number, folder in enumerate(old, start=1):
            self._write_run(folder, None, f"page {number} of {len(old)}: ")

    def _write_run(self, run: Path, out: Path | None, words: str = "") -> None:
        """Write the page of one run; `words` stand before what the bar says."""
        from karma.agent.journal.run_folder import read_run
        from karma.bench.figures.results import load_published, result_of
        from karma.bench.report.episodes import Replayer, choose
        from karma.bench.report.html import Frames
        from karma.bench.report.page import page_of, render
        from karma.bench.report.replay import frame_choice

        found = read_run(run)
        if not found.records:
            raise KarmaError(
                f"{run}: no episode is done yet\n  To fix: karma eval FILE --out {run}"
            )
        pictures = Frames()
        replayer = Replayer(found, pictures, frame_choice(self.frames))
        chosen = choose(found.records, self.episodes)
        paper = load_published(self.published)
        steps = replayer.replaying(chosen, self.instructions)
        shown = _with_bar(steps, f"{words}doing again, %")
        with console.status(f"{words}figures, pictures"):
            page = page_of(found, result_of(found, paper), shown)
            path = write_for(run, out, PAGE, render(page, pictures).encode())
        tell(
            f"page: {path}: {len(shown)} of {page.episodes} episodes to step through, "
            f"{len(pictures)} pictures, {path.stat().st_size / 1e6:.1f} MB"
        )
        color = "green" if page.same == page.actions else "red"
        console.print(f"replayed: [{color}]{page.same} of {page.actions}[/] actions went as logged")


def _with_bar(steps: Iterable[float | T], words: str) -> list[T]:
    """Return what is made in steps, with a bar while their shares of the work come in between."""
    made: list[T] = []
    with bar(passing=True) as progress:
        line = progress.add_task(words, total=100)
        for one in steps:
            if isinstance(one, float):
                progress.update(line, completed=round(100 * one))
            else:
                made.append(one)
    return made
