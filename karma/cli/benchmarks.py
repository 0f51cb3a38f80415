"""`karma eval` and `karma table` of others' benchmarks."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape

from karma.cli.progress import tell_cluster
from karma.cli.shared import (
    console,
    write_json,
)
from karma.errors import KarmaError


def refuse_options(file: Path, **given: object) -> None:
    """Raise KarmaError where an experiment of this form does not know an option.

    Args:
        file: the experiment.
        given: its options; what is false was not given.
    """
    if wrong := [name.replace("_", "-") for name, value in given.items() if value]:
        raise KarmaError(
            f"{file}: such an experiment has no --{wrong[0]}\n  To fix: leave out --{wrong[0]}"
        )


def do_benchmark(
    file: Path,
    folder: Path,
    *,
    workers: int,
    ray: str,
    json: Path | None,
    opened: Mapping[str, Any],
) -> None:
    """Do a benchmark's episodes that are missing, and print its tables.

    Args:
        file: the experiment.
        folder: of the run.
        workers: processes; 0 = as many as cores, memory and hosted models allow.
        ray: address of a Ray cluster that plays; "" = this machine.
        json: takes the figures.
        opened: the other arguments of `BenchmarkRun`.

    Raises:
        KarmaError: see `BenchmarkRun`.
    """
    from karma.bench.sheet import to_markdown
    from karma.benchmarks.run import TABLE, BenchmarkRun
    from karma.journal.not_run import in_words

    with console.status(escape(f"reading {file} ...")):
        run = BenchmarkRun(file, folder, **opened)
    if run.left and ray:
        tell_cluster(ray, workers)
    elif run.left and not workers:
        suggested = run.suggest()
        workers = suggested.number
        console.print(escape(f"workers: {workers} ({suggested.reason})"), soft_wrap=True)
    with console.status(""):
        for record in run.episodes(workers, ray=ray):
            mark = "done" if record.success else record.end
            done = f"{len(run.records)} of {run.total}"
            console.print(escape(f"{done}: {record.row}, {record.task}: {mark}"), soft_wrap=True)
    results = run.results()
    console.print(escape(to_markdown(results.behind)), soft_wrap=True)
    if json is not None:
        write_json(json, results.figures)
    if run.not_run:
        raise KarmaError(in_words(run.not_run))
    console.print(escape(f"all tables: {folder / TABLE}"), soft_wrap=True)


def write_table(runs: Sequence[Path], folder: Path, json: Path | None) -> None:
    """Write the tables of a benchmark's runs as Markdown, and print what is their own.

    Args:
        runs: their folders; rows of all stand in one table.
        folder: takes table.md.
        json: takes the figures.

    Raises:
        KarmaError: the run has no episodes yet; or see `read_results`.
    """
    from karma.bench.sheet import to_markdown
    from karma.benchmarks.run import TABLE, read_results, written
    from karma.journal.owned_folder import write_beside

    results = read_results(*runs)
    if not results.figures:
        raise KarmaError(f"{runs[0]}: the run has no episodes yet\n  To fix: karma eval FILE")
    write_beside(folder, TABLE, written(results))
    console.print(escape(to_markdown(results.behind)), soft_wrap=True)
    console.print(escape(f"all tables: {folder / TABLE}"), soft_wrap=True)
    if json is not None:
        write_json(json, results.figures)
