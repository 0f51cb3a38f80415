"""The folder of a sweep: a run folder per cell below `cells/`, what tells them apart, one table."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from karma.agent.journal.formats import UNKNOWN, figure_text
from karma.agent.journal.header import CELLS, TABLE
from karma.agent.journal.owned_folder import HEADER, SWEEP, replace_file
from karma.agent.journal.records import ALL
from karma.agent.journal.run_folder import RunData, read_run
from karma.bench.figures.columns import COLUMNS, Figures, figures
from karma.bench.figures.statistics import interval_text
from karma.bench.figures.tables import Sheet, to_markdown
from karma.errors import FileError
from karma.files import read_json, to_json

_SHOWN = ("subtasks_done", "goals_met", "refused", "explorations", "actions", "planner_calls")


@dataclass(frozen=True, slots=True, kw_only=True)
class SweptCell:
    """One cell of a sweep."""

    name: str
    folder: str  # below `CELLS`
    values: Mapping[str, str]  # short key -> value in words
    failed: str = ""  # why it could not be done, or not to its end


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepData:
    """A sweep as it was read, finished or not."""

    name: str  # of the experiment
    cells: tuple[SweptCell, ...]
    folder: Path = field(default=Path(), compare=False)

    def run(self, cell: SweptCell) -> RunData | None:
        """Return a cell's run; None where it has not begun. FileError where it is damaged."""
        place = self.folder / CELLS / cell.folder
        return read_run(place) if (place / HEADER).exists() else None


def read_sweep(folder: Path) -> SweepData:
    """Read what a sweep consists of.

    Raises:
        FileError: the file is torn, or a cell would lie elsewhere.
    """
    kept = read_json(folder / SWEEP, SweepData)
    for cell in kept.cells:
        if Path(cell.folder).name != cell.folder or cell.folder in ("", ".."):
            raise FileError(folder / SWEEP, f"{cell.folder!r} is no folder below {CELLS}")
    return replace(kept, folder=folder)


def write_sweep(data: SweepData) -> None:
    """Write what a sweep consists of, and its table."""
    kept = {"name": data.name, "cells": data.cells}
    replace_file(data.folder / SWEEP, to_json(kept, indent=2))
    replace_file(data.folder / TABLE, to_markdown([sweep_sheet(data)]).encode())


def figures_by_cell(data: SweepData) -> list[tuple[SweptCell, tuple[Figures, ...]]]:
    """Return the figures of every cell, none where nothing is done."""
    found = []
    for cell in data.cells:
        run = data.run(cell)
        found.append((cell, figures(run.records, run.timings) if run is not None else ()))
    return found


def sweep_sheet(data: SweepData) -> Sheet:
    """Return one table over all cells, a line for each row of each."""
    keys = list(dict.fromkeys(key for cell in data.cells for key in cell.values))
    found = figures_by_cell(data)
    shown = [
        key
        for key in _SHOWN
        if any(line.values[key].value is not None for _, lines in found for line in lines)
    ]
    rows = []
    for cell, lines in found:
        said = tuple(cell.values.get(key, UNKNOWN) for key in keys)
        whole = [line for line in lines if line.kind == ALL]
        for line in whole:
            rate, solved = line.values["success"], f"{line.successes} of {line.episodes}"
            more = (figure_text(line.values[key].value, COLUMNS[key].digits) for key in shown)
            rows.append((*said, line.row, interval_text(rate), solved, *more))
        if not whole:
            rows.append((*said, *[UNKNOWN] * (3 + len(shown))))
    titles = (COLUMNS[key].title for key in shown)
    return Sheet(
        title=f"{data.name}: {len(data.cells)} cells",
        caption=_caption(data),
        head=(*keys, "method", "SR", "solved", *titles),
        lines=tuple(rows),
    )


def _caption(data: SweepData) -> str:
    """Return what stands behind a table, and what is missing from it."""
    runs = {cell.name: data.run(cell) for cell in data.cells}
    open_ones = [
        cell.name
        for cell in data.cells
        if not cell.failed and ((run := runs[cell.name]) is None or not run.finished)
    ]
    parts = ["Brackets hold 95 % intervals that keep a task's seeds together."]
    parts += [f"Not finished: {'; '.join(open_ones)}."] if open_ones else []
    parts += [
        f"Failed: {cell.name}: {' '.join(cell.failed.split())}"
        for cell in data.cells
        if cell.failed
    ]
    parts += [said for name, run in runs.items() if run and (said := _errors(name, run))]
    return " ".join(parts)


def _errors(name: str, run: RunData) -> str:
    """Return how many of a cell's episodes ended with an error, and with which; "" where none."""
    errors = [record.error for record in run.records if record.error]
    if not errors:
        return ""
    said = " ".join(errors[0].split())
    first = said if len(errors) == 1 else f"the first: {said}"
    return f"Ended by an error: {name}: {len(errors)} of {len(run.records)} episodes, {first}."
