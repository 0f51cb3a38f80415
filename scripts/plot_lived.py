"""Draw a run of lived-in homes: success by kind, reliability of "still there", curves by setting.

python scripts/plot_lived.py runs/lived --out docs/pictures/lived.png
"""

from pathlib import Path
from typing import Annotated

import typer

from karma.benchmarks.lived.table import LivedFigures
from karma.benchmarks.run import read_results
from karma.report.lived_plots import lived_picture


def main(
    run: Annotated[Path, typer.Argument(help="Folder of a run, finished or not.")],
    out: Annotated[Path, typer.Option(help="The picture.")],
    rows: Annotated[str, typer.Option(help="Rows to draw, with ';' between; '' is all.")] = "",
) -> None:
    """Draw what `karma report` shows of it, as one picture."""
    figures: list[LivedFigures] = read_results(run).figures
    wanted = [name.strip() for name in rows.split(";") if name.strip()]
    picture = lived_picture([one for one in figures if not wanted or one.row in wanted])
    picture.savefig(out, dpi=110, metadata={"Software": None})
    print(out)


if __name__ == "__main__":
    typer.run(main)
