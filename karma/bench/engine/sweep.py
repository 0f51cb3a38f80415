"""A sweep: an experiment done once for every combination of some settings, each a run of its own.

```toml
[[grid]]
models.planner = ["karma-nano", "other.gguf"]
models.profile = ["compact", "full"]
```

makes four cells; several grids stand side by side. Every cell is a run folder below `cells/`, so a
sweep that was killed goes on where it was, and a grid that grows keeps what is done. A cell that
cannot be done is named with its error, and the others are done. `sweep.json` tells the cells apart.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from karma.agent.journal.formats import UNKNOWN, figure_text
from karma.agent.journal.header import CELLS, TABLE
from karma.agent.journal.owned_folder import (
    HEADER,
    MARK,
    SWEEP,
    OwnedFolder,
    kind_in,
    locked,
    replace_file,
)
from karma.agent.journal.records import ALL, EpisodeRecord, in_words
from karma.agent.journal.run_folder import RunData, RunFolder, read_run
from karma.agent.journal.steps import slug
from karma.bench.engine.experiment_file import Changes, Setting, read_experiment
from karma.bench.engine.run import Run
from karma.bench.figures.columns import COLUMNS, Figures, figures
from karma.bench.figures.statistics import interval_text
from karma.bench.figures.tables import Sheet, to_markdown
from karma.errors import FileError, KarmaError, UnwritableError
from karma.files import read_json, to_json
from karma.infer.checks.gguf import is_gguf, is_projector

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


_NO_GRID = Setting(key="grid", value=[])
_LONGEST = 100  # letters of a cell's folder


# ----------------------------------------------------------------- doing it


class Cell(NamedTuple):
    """One combination: how it is kept, and what it says otherwise."""

    kept: SweptCell
    changes: Changes


@dataclass(frozen=True, slots=True, kw_only=True)
class SweptEpisode:
    """An episode that is done, and how far its cell is."""

    cell: str
    number: int  # of the cell, from 1
    record: EpisodeRecord
    done: int
    total: int


class SweepRun:
    """An experiment with a grid in its folder.

    The folder takes a run folder per cell, `sweep.json` and `table.md`; `fresh` throws away what an
    earlier sweep left there. `changes` are for all cells, each GGUF in `planner_dir` is one value
    of models.planner, and `opened` holds the other arguments of every cell's `Run`.

    Raises:
        FileError: the experiment is damaged, or the folder holds a run.
        KarmaError: a grid sets what there is not, or nothing.
    """

    def __init__(
        self,
        path: Path,
        folder: Path,
        *,
        changes: Changes | None = None,
        planner_dir: Path | None = None,
        fresh: bool = False,
        opened: Mapping[str, Any] | None = None,
    ) -> None:
        self.path, self.folder, self._opened = path, folder, dict(opened or {})
        self.experiment = read_experiment(path, changes)
        self.cells = cells_of(path, self.experiment.grid, changes or Changes(), planner_dir)
        for cell in self.cells:  # a misspelt key must not come to light hours later
            read_experiment(path, cell.changes)
        self.failed: dict[str, str] = {}
        with locked(folder):
            owned = OwnedFolder(folder, "sweep")
            if self._is_older():
                owned.adopt((SWEEP, TABLE))
            owned.look()
            owned.sweep()
            owned.begin((SWEEP, TABLE))
            if fresh:
                for place in sorted((folder / CELLS).glob(f"*/{MARK}")):
                    RunFolder(place.parent, steps=True).clear()
            write_sweep(self.data)

    @property
    def data(self) -> SweepData:
        """What the folder says of it."""
        cells = tuple(
            replace(cell.kept, failed=self.failed.get(cell.kept.name, "")) for cell in self.cells
        )
        return SweepData(name=self.experiment.name, cells=cells, folder=self.folder)

    def episodes(
        self, workers: int = 0, *, ray: str = "", opened: Callable[[Run], None] | None = None
    ) -> Iterator[SweptEpisode]:
        """Do what is missing, cell by cell; each record is on the disk before it is yielded.

        A cell that cannot be done, or not whole, is in `failed` afterwards; the next one is begun.

        0 workers are as many as cores and memory allow, asked of each cell. `opened` is told each
        cell's run before its first episode.

        Raises:
            UnwritableError: the disk is full.
            KarmaError: another run is at work in the folder.
        """
        with locked(self.folder):
            for number, cell in enumerate(self.cells, start=1):
                try:
                    yield from self._do(cell, number, workers, ray, opened)
                except UnwritableError:
                    raise
                except KarmaError as error:
                    self.failed[cell.kept.name] = str(error)
                write_sweep(self.data)

    def _is_older(self) -> bool:
        """Return whether this sweep is there as an earlier version left it, without a mark."""
        if (self.folder / MARK).exists() or kind_in(self.folder) != "sweep":
            return False
        try:
            kept = read_sweep(self.folder)
        except FileError:
            return False
        cells = {cell.folder for cell in kept.cells} & {cell.kept.folder for cell in self.cells}
        return kept.name == self.experiment.name and bool(cells)

    def _do(
        self,
        cell: Cell,
        number: int,
        workers: int,
        ray: str,
        opened: Callable[[Run], None] | None,
    ) -> Iterator[SweptEpisode]:
        place = self.folder / CELLS / cell.kept.folder
        run = Run(self.path, place, changes=cell.changes, **self._opened)
        if opened is not None:
            opened(run)
        if run.left and not workers and not ray:
            workers = run.suggest().number
        for record in run.episodes(workers, ray=ray):
            yield SweptEpisode(
                cell=cell.kept.name, number=number, record=record, done=len(run.records),
                total=run.total,
            )  # fmt: skip
        if run.not_run:
            raise KarmaError(in_words(run.not_run))


# ----------------------------------------------------------------- cells


def cells_of(
    path: Path,
    grid: Sequence[Mapping[str, Any]],
    changes: Changes,
    planner_dir: Path | None = None,
) -> tuple[Cell, ...]:
    """Return the cells of a grid in its order: the last key changes first.

    Raises:
        FileError: the grid is empty, or there is no GGUF in the folder.
        KarmaError: the grid and the folder both give planners.
    """
    axes = [dict(_flat("", one)) for one in grid] or [{}]
    planners = [str(one) for one in planners_in(planner_dir)] if planner_dir is not None else []
    cells: list[tuple[Setting, ...]] = []
    for axis in axes:
        if planners and "models.planner" in axis:
            raise KarmaError("--planner-dir and [[grid]] models.planner: give one of them")
        if empty := [key for key, values in axis.items() if not values]:
            raise FileError(path, f"grid: {empty[0]} has no value")
        known = [[Setting(key=key, value=v, folder=path.parent) for v in axis[key]] for key in axis]
        given = [[Setting(key="models.planner", value=one) for one in planners]] if planners else []
        cells += product(*given, *known)
    if cells == [()]:
        raise FileError(path, "grid: it sets nothing", fix='[[grid]] with models.planner = ["..."]')
    said = {msgspec.json.encode([(one.key, one.value) for one in cell]): cell for cell in cells}
    return _named(list(said.values()), changes)


def _named(different: Sequence[tuple[Setting, ...]], changes: Changes) -> tuple[Cell, ...]:
    """Return combinations with a name each, short where that tells them apart."""
    short = _short_keys({one.key for cell in different for one in cell})
    brief = [{short[one.key]: _text(one.value, whole=False) for one in cell} for cell in different]
    found = []
    for cell, values in zip(different, brief, strict=True):
        if brief.count(values) > 1:
            values = {short[one.key]: _text(one.value, whole=True) for one in cell}
        name = ", ".join(f"{key}={value}" for key, value in values.items())
        kept = SweptCell(name=name, folder=slug(name)[-_LONGEST:].lstrip("-"), values=values)
        settings = (*changes.settings, _NO_GRID, *cell)
        found.append(Cell(kept=kept, changes=replace(changes, settings=settings)))
    return tuple(found)


def _flat(key: str, value: Any) -> Iterator[tuple[str, list[Any]]]:
    """Yield each dotted key of a grid with its values."""
    if isinstance(value, Mapping):
        for name, one in value.items():
            yield from _flat(f"{key}.{name}".lstrip("."), one)
    else:
        yield key, value if isinstance(value, list) else [value]


def _short_keys(keys: set[str]) -> dict[str, str]:
    """Return what a table calls each key: its last part, if that is no other's too.

    >>> sorted(_short_keys({"models.planner", "rows.a.vision", "rows.b.vision"}).values())
    ['planner', 'rows.a.vision', 'rows.b.vision']
    """
    last = [key.rpartition(".")[2] for key in keys]
    return {key: one if last.count(one := key.rpartition(".")[2]) == 1 else key for key in keys}


def _text(value: Any, *, whole: bool) -> str:
    """Return a value in words; of a path the last name unless the whole is wanted."""
    if not isinstance(value, str):
        return msgspec.json.encode(value).decode()
    return value if whole else Path(value).name.removesuffix(".gguf") or value


def planners_in(folder: Path) -> list[Path]:
    """Return the GGUF files of a folder by name, without projectors of picture models.

    Raises:
        FileError: there is none.
    """
    found = [path for path in sorted(folder.iterdir()) if is_gguf(path) and not _projects(path)]
    if not found:
        fix = "--planner-dir a folder with .gguf files"
        raise FileError(folder, "no planner's .gguf is in it", fix=fix)
    return found


def _projects(path: Path) -> bool:
    try:
        return is_projector(path)
    except KarmaError:
        return False  # its cell says what is wrong with it
