"""`karma report`: a run as one page that needs nothing else."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from karma.cli.options import option, taking
from karma.cli.progress import bar
from karma.cli.shared import console, refuse_options, tell, write_for
from karma.errors import KarmaError

PAGE = "report.html"
CHOICE = ("8", "auto", "auto")  # of episodes, instructions and frames, unless told otherwise


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportOptions:
    """What a page shows, and where it goes."""

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


@taking(given=ReportOptions)
def report_command(
    context: typer.Context,
    runs: Annotated[
        list[str],
        typer.Argument(
            help="A run folder, made by `karma eval`; or a sweep, or several (or RUN:ROW), for a "
            "page that compares."
        ),
    ],
    *,
    given: ReportOptions,
) -> None:
    """Write a run as one HTML page: tables, plots, and episodes to step through."""
    from karma.agent.journal.owned_folder import benchmark_in, kind_in

    run = Path(runs[0])
    kind = kind_in(run) if len(runs) == 1 else "sweep"
    is_home = kind == "benchmark" and benchmark_in(run) == "lived"
    out, home, day, row = given.out, given.home, given.day, given.row
    choice = (given.episodes, given.instructions, given.frames)
    if (home or day is not None or row) and not is_home:
        raise KarmaError(
            "--home, --day and --row are of one run of lived-in homes\n"
            "  To fix: karma eval eval/lived/demo.toml"
        )
    if is_home:
        if choice != CHOICE:
            raise KarmaError(
                f"{run}: lived-in homes have days, no episodes or frames\n"
                f"  To fix: karma report {run} --home HOME --day DAY --row ROW"
            )
        refuse_options(context, f"{run}: such a page", {"out", "home", "day", "row"})
        _write_lived(run, out, home, day, row)
        return
    match kind:
        case "sweep":
            own_pages = choice if given.pages else None
            _write_comparison(runs, out, given.reference, own_pages, given.published)
        case "figure":
            refuse_options(context, f"{run}: the page of a figure", {"out"})
            _write_figure(run, out)
        case _:
            own = {"out", "episodes", "instructions", "frames", "published"}
            refuse_options(context, f"{run}: the page of one run", own)
            _write_run(run, out, choice, given.published)


def _write_lived(run: Path, out: Path | None, home: str, day: int | None, row: str) -> None:
    """Write the page of a run of lived-in homes, with one day to watch."""
    from karma.bench.report.lived_page import chosen_day, lived_again, read_lived, render_lived

    found = read_lived(run)
    record = chosen_day(found, home, day, row)
    with bar(passing=True) as progress:
        line = progress.add_task("days lived again", total=record.day + 1)
        shown = lived_again(found, record, after_day=lambda: progress.advance(line))
    path = write_for(run, out, PAGE, render_lived(found, shown).encode())
    tell(
        f"page: {path}: {len(found.records)} days; to watch: {record.task} of {record.row!r}, "
        f"{path.stat().st_size / 1e6:.1f} MB"
    )


def _write_figure(run: Path, out: Path | None) -> None:
    from karma.bench.report.figure_page import figure_page

    path = write_for(run, out, PAGE, figure_page(run).encode())
    tell(f"page: {path}")


def _write_comparison(
    runs: list[str],
    out: Path | None,
    reference: str,
    choice: tuple[str, str, str] | None,
    published: Path | None,
) -> None:
    """Write the page of several runs; with a choice of episodes also their own pages."""
    from karma.bench.report.comparison import (
        ComparisonPage,
        chosen_reference,
        comparison_of,
        render_comparison,
        sides_of,
    )

    sides, notes = sides_of(runs)
    against = chosen_reference(sides, reference)
    first = Path(runs[0]) if len(runs) == 1 else sides[0].run.folder
    path = out or (first / PAGE if len(runs) == 1 else first.parent / "comparison.html")
    title = first.absolute().name if len(runs) == 1 else f"{len(runs)} runs side by side"
    with bar(passing=True) as progress:
        line = progress.add_task("comparing, %", total=100)
        for one in comparison_of(title, sides, against, notes, path):
            if isinstance(one, ComparisonPage):
                page = one
            else:
                progress.update(line, completed=round(100 * one))
    write_for(path.parent, out, path.name, render_comparison(page).encode())
    tell(f"page: {path}: {len(page.sides)} side by side, {len(page.tasks)} tasks")
    for note in page.notes:
        tell(note)
    folders = dict.fromkeys(one.run.folder for one in sides) if choice is not None else ()
    old = [folder for folder in folders if _is_old(folder / PAGE, folder)]
    for number, folder in enumerate(old, start=1):
        words = f"page {number} of {len(old)}: "
        _write_run(folder, None, choice or ("", "", ""), published, words)


def _is_old(page: Path, run: Path) -> bool:
    from karma.agent.journal.header import EPISODES

    return not page.exists() or page.stat().st_mtime < (run / EPISODES).stat().st_mtime


def _write_run(
    run: Path,
    out: Path | None,
    choice: tuple[str, str, str],
    published: Path | None,
    words: str = "",
) -> None:
    from karma.agent.journal.run_folder import read_run
    from karma.bench.figures.results import result_of
    from karma.bench.figures.tables import load_published
    from karma.bench.report.choice import choose
    from karma.bench.report.episodes import EpisodeReplay, Replayer
    from karma.bench.report.html import Frames
    from karma.bench.report.page import page_of, render
    from karma.bench.report.replay import frame_choice

    found = read_run(run)
    if not found.records:
        raise KarmaError(f"{run}: no episode is done yet\n  To fix: karma eval FILE --out {run}")
    episodes, instructions, frames = choice
    pictures = Frames()
    replayer = Replayer(found, pictures, frame_choice(frames))
    chosen = choose(found.records, episodes)
    paper = load_published(published)
    with bar(passing=True) as progress:
        line = progress.add_task(f"{words}doing again, %", total=100)
        shown = []
        for one in replayer.replaying(chosen, instructions):
            if isinstance(one, EpisodeReplay):
                shown.append(one)
            else:
                progress.update(line, completed=round(100 * one))
        progress.update(line, completed=100, description=f"{words}figures, pictures")
        page = page_of(found, result_of(found, paper), shown)
        path = write_for(run, out, PAGE, render(page, pictures).encode())
    tell(
        f"page: {path}: {len(shown)} of {page.episodes} episodes to step through, "
        f"{len(pictures)} pictures, {path.stat().st_size / 1e6:.1f} MB"
    )
    _say_replayed(page.same, page.actions)


def _say_replayed(same: int, actions: int) -> None:
    color = "green" if same == actions else "red"
    console.print(f"replayed: [{color}]{same} of {actions}[/] actions went as logged")
