"""Draw a run of lived-in homes as `karma report` does: bars of one setting, curves of several.

python scripts/plot_lived.py runs/lived --out docs/pictures/lived.png
"""

from pathlib import Path
from typing import Annotated

import typer

from karma.bench.benchmark_runs import read_played
from karma.benchmarks.lived.table import by_day, figures_of, stale_shares
from karma.journal.header import BenchmarkHeader
from karma.report.lived_pictures import lived_pictures


def main(
    run: Annotated[Path, typer.Argument(help="Folder of a run, finished or not.")],
    out: Annotated[Path, typer.Option(help="The picture.")],
    rows: Annotated[str, typer.Option(help="Rows to draw, with ';' between; '' is all.")] = "",
    days: Annotated[bool, typer.Option(help="Curves over the days lived.")] = False,
) -> None:
    """Draw one picture."""
    wanted = [name.strip() for name in rows.split(";") if name.strip()]
    _, records = read_played(run, BenchmarkHeader.read(run))
    records = [one for one in records if not wanted or one.row in wanted]
    if days:
        records = by_day(records)
    figures, stale = figures_of(records), stale_shares(records)
    next(lived_pictures(figures, stale)).figure.savefig(out, dpi=110)
    print(out)


if __name__ == "__main__":
    typer.run(main)
