"""`karma report`: a run as one page that needs nothing else."""

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from karma.cli.progress import bar
from karma.cli.shared import SHOWN, clear_errors, console
from karma.errors import KarmaError
from karma.files import write_atomic


def add_to(app: typer.Typer) -> None:
    """Add the command to the top level."""
    app.command("report", rich_help_panel=SHOWN)(report_command)


@clear_errors
def report_command(
    run: Annotated[Path, typer.Argument(help="A run folder, made by `karma eval`.")],
    out: Annotated[Path | None, typer.Option(help="The page; default RUN/report.html.")] = None,
    episodes: Annotated[
        str,
        typer.Option(help="Which can be stepped through: all, a number, a task, ROW/TASK/SEED."),
    ] = "8",
    instructions: Annotated[
        str,
        typer.Option(
            help='Of those, which instructions: all, numbers such as 1-40,77, or "auto": of long '
            "sequences those that failed first."
        ),
    ] = "auto",
    frames: Annotated[
        str,
        typer.Option(
            help='First-person pictures: "every" action, "calls" only, their "ends", "none", or '
            '"auto": the less the more there is to show.'
        ),
    ] = "auto",
    published: Annotated[
        Path | None, typer.Option(help="The paper's figures, to stand beside ours.")
    ] = None,
    rerun: Annotated[
        Path | None, typer.Option(help="Also write the replays as a recording for Rerun, *.rrd.")
    ] = None,
) -> None:
    """Write a run as one HTML page: tables, plots, and episodes to step through."""
    from karma.report.figure_page import is_figure_folder

    if is_figure_folder(run):
        _write_figure(run, out or run / "report.html")
    else:
        choice = (episodes, instructions, frames)
        _write_run(run, out or run / "report.html", choice, published, rerun)


def _write_figure(run: Path, path: Path) -> None:
    from karma.report.figure_page import figure_page

    write_atomic(path, figure_page(run).encode())
    console.print(escape(f"page: {path}"), soft_wrap=True)


def _write_run(
    run: Path, path: Path, choice: tuple[str, str, str], published: Path | None, rerun: Path | None
) -> None:
    from karma.bench.published import load_published
    from karma.bench.results import result_of
    from karma.bench.run_folder import read_run
    from karma.report.choice import choose
    from karma.report.episodes import EpisodeReplay, Replayer
    from karma.report.frames import Frames
    from karma.report.page import page_of, render
    from karma.report.replay import frame_choice

    found = read_run(run)
    if not found.records:
        raise KarmaError(f"{run}: no episode is done yet\n  To fix: karma eval FILE --out {run}")
    episodes, instructions, frames = choice
    pictures = Frames()
    replayer = Replayer(found, pictures, frame_choice(frames))
    chosen = choose(found.records, episodes)
    paper = load_published(published)
    with bar(passing=True) as progress:
        line = progress.add_task("doing again, %", total=100)
        shown = []
        for one in replayer.replaying(chosen, instructions):
            if isinstance(one, EpisodeReplay):
                shown.append(one)
            else:
                progress.update(line, completed=round(100 * one))
        progress.update(line, completed=100, description="figures, pictures")
        page = page_of(found, result_of(found, paper), shown)
        write_atomic(path, render(page, pictures).encode())
    console.print(
        escape(
            f"page: {path}: {len(shown)} of {page.episodes} episodes to step through, "
            f"{len(pictures)} pictures, {path.stat().st_size / 1e6:.1f} MB"
        ),
        soft_wrap=True,
    )
    _say_replayed(page.same, page.actions)
    if rerun is not None:
        from karma.report.rerun_file import write_rerun

        write_rerun(rerun, found.header.name, shown, pictures)
        console.print(escape(f"rerun: {rerun}"), soft_wrap=True)


def _say_replayed(same: int, actions: int) -> None:
    color = "green" if same == actions else "red"
    console.print(f"replayed: [{color}]{same} of {actions}[/] actions went as logged")
