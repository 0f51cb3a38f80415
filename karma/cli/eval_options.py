"""What `karma eval` sets otherwise than an experiment's file, and what it ends with."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from karma.cli.model_options import OPTIONS
from karma.cli.shared import console
from karma.files import write_atomic

if TYPE_CHECKING:
    from karma.bench.experiment_file import Changes
    from karma.bench.figures import Figures
    from karma.bench.floors import SuccessFloor
    from karma.journal.owned_folder import Kind

BELOW = 4  # exit code: done, and a success rate is below --fail-under
OTHERWISE, PASSED = "What is done otherwise than the file says", "Whether it passes"

Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help='A key of the file said otherwise, "models.planner=x.gguf" or '
        '"rows.NAME.options.recall_k=5" ("*": all rows); paths begin here.',
        rich_help_panel=OTHERWISE,
    ),
]
Only = Annotated[
    list[str] | None,
    typer.Option(help='These tasks, "simple-*"; again for more.', rich_help_panel=OTHERWISE),
]
Limit = Annotated[
    int | None,
    typer.Option(min=1, help="The first so many of the tasks.", rich_help_panel=OTHERWISE),
]
Seeds = Annotated[
    str, typer.Option(help='These seeds, "0-4" or "0,2,5".', rich_help_panel=OTHERWISE)
]
Rows = Annotated[
    list[str] | None,
    typer.Option("--row", help="This row only; again for more.", rich_help_panel=OTHERWISE),
]
PlannerDir = Annotated[
    Path | None,
    typer.Option(
        help="Do all with each planner of a folder of GGUF files.", rich_help_panel=OTHERWISE
    ),
]
FailUnder = Annotated[
    list[str] | None,
    typer.Option(
        metavar="RATE",
        help='Exit code 4 if success over all rows is below 0.8; "ROW=0.8": of that row.',
        rich_help_panel=PASSED,
    ),
]
Junit = Annotated[
    Path | None, typer.Option(help="Also write JUnit's XML here.", rich_help_panel=PASSED)
]


_FIGURE = frozenset({"out", "fresh", "workers", "ray"})
_BENCHMARK = _FIGURE | {
    "cassette", "cassette_mode", "base_url", "sets", "only", "limit", "seeds",
    "row", "json", *(name for name, _, _ in OPTIONS),
}  # fmt: skip
_SWEEP = _BENCHMARK | {
    "steps", "states", "half_width", "max_seeds", "planner_dir", "fail_under", "junit",
}  # fmt: skip
USED_BY: Mapping["Kind", frozenset[str]] = {  # kind of run -> options that it can use
    "figure": _FIGURE, "benchmark": _BENCHMARK, "sweep": _SWEEP, "run": _SWEEP | {"tasks"},
}  # fmt: skip


def changes_of(
    sets: Sequence[str] | None,
    only: Sequence[str] | None,
    limit: int | None,
    seeds: str,
    rows: Sequence[str] | None,
) -> "Changes":
    """Return what the options of a command change of an experiment.

    Raises:
        KarmaError: one of them cannot be read.
    """
    from karma.bench.experiment_file import Changes, Setting, seeds_of, setting_of

    settings = [setting_of(text) for text in sets or ()]
    if only:
        settings.append(Setting(key="only", value=list(only)))
    if limit is not None:
        settings.append(Setting(key="limit", value=limit))
    if seeds:
        settings.append(Setting(key="seeds", value=seeds_of(seeds)))
    return Changes(settings=tuple(settings), rows=tuple(rows or ()))


def write_junit(folder: Path, junit: Path | None) -> None:
    """Write a run's test cases where that is wanted."""
    if junit is not None:
        from karma.bench.export import to_junit

        write_atomic(junit, to_junit(folder))
        console.print(escape(f"test cases: {junit}"))


def end_below(
    figures: "Sequence[tuple[str, Sequence[Figures]]]", floors: "list[SuccessFloor]"
) -> None:
    """End with `BELOW` where a run, or a cell of a sweep by its name, is below a floor."""
    from karma.bench.floors import below

    said = [
        f"{cell}: {words}" if cell else words
        for cell, lines in figures
        for words in below(lines, floors)
    ]
    for words in said:
        console.print(f"[red]✗[/] {escape(words)}", soft_wrap=True, highlight=False)
    if said:
        raise typer.Exit(BELOW)
