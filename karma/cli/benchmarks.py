"""`karma eval` of others' benchmarks."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.markup import escape

from karma.cli.shared import console
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


def do_benchmark(file: Path, folder: Path, *, workers: int, opened: Mapping[str, Any]) -> None:
    """Do a benchmark's episodes that are missing, and print its tables.

    Args:
        file: the experiment.
        folder: of the run.
        workers: processes; 0 = one per core where the players are local.
        opened: the other arguments of `BenchmarkRun`.

    Raises:
        KarmaError: see `BenchmarkRun`.
    """
    from karma.bench.sheet import to_markdown
    from karma.benchmarks.eb_alfred.run import TABLE, BenchmarkRun
    from karma.benchmarks.eb_alfred.table import detail_sheet, results_of

    with console.status(escape(f"reading {file} ...")):
        run = BenchmarkRun(file, folder, **opened)
    number = workers or (1 if run.alone else len(os.sched_getaffinity(0)))
    with console.status(""):
        for record in run.episodes(number):
            mark = "done" if record.success else record.end
            done = f"{len(run.records)} of {run.total}"
            console.print(escape(f"{done}: {record.row}, {record.task}: {mark}"), soft_wrap=True)
    console.print(escape(to_markdown([detail_sheet(results_of(run.records))])), soft_wrap=True)
    console.print(escape(f"beside the published scores: {folder / TABLE}"), soft_wrap=True)
