"""The figures that the paper gives, row by row."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from karma.errors import FileError
from karma.files import read_bytes, shipped

COLUMNS = ("success", "retrieved", "re", "rt")  # of Tables 1 and 2, by our keys


@dataclass(frozen=True, slots=True, kw_only=True)
class Published:
    """One figure of the paper."""

    value: float
    source: str  # its table
    paper_row: str  # the row's name there


PublishedFigures = Mapping[tuple[str, str, str], Published]  # (our row, kind, column)


def load_published(path: Path | None) -> PublishedFigures:
    """Read the paper's figures, by default those that ship.

    Raises:
        FileError: a line lacks a column, or its value is no number; names the line.
    """
    found: dict[tuple[str, str, str], Published] = {}
    ours = shipped("eval") / "paper" / "published.csv"
    path = path or ours
    try:
        text = read_bytes(path, fix=f"--published FILE; ours is {ours}").decode()
    except UnicodeDecodeError as error:
        raise FileError(path, str(error)) from error
    for number, row in enumerate(csv.DictReader(io.StringIO(text)), start=2):
        try:
            key = row["row"], row["kind"], row["metric"]
            if row["metric"] not in COLUMNS:
                raise ValueError(f"metric {row['metric']!r}; there are {', '.join(COLUMNS)}")
            found[key] = Published(
                value=float(row["value"]), source=row["source"], paper_row=row["paper_row"]
            )
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(path, f"line {number}: {error}") from error
    return found
