"""A sweep: an experiment done once for every combination of some settings, each a run of its own.

```toml
[[grid]]
models.planner = ["karma-nano", "other.gguf"]
models.profile = ["compact", "full"]
```

makes four cells; several grids stand side by side. Every cell is a run folder below `cells/`, so a
sweep that was killed goes on where it was, and a grid that grows keeps what is done. A cell that
cannot be done is named with its error, and the others are done.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from karma.agent.journal.header import CELLS, TABLE
from karma.agent.journal.owned_folder import MARK, SWEEP, OwnedFolder, locked
from karma.agent.journal.records import EpisodeRecord, in_words
from karma.agent.journal.run_folder import RunFolder
from karma.agent.journal.steps import slug
from karma.bench.engine.experiment_file import Changes, Setting, read_experiment
from karma.bench.engine.run import Run
from karma.bench.engine.sweep_folder import SweepData, SweptCell, write_sweep
from karma.errors import FileError, KarmaError, UnwritableError

_NO_GRID = Setting(key="grid", value=[])
_LONGEST = 100  # letters of a cell's folder


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
    earlier sweep left there. `changes` are for all cells, and `opened` holds the other arguments of
    every cell's `Run`.

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
        fresh: bool = False,
        opened: Mapping[str, Any] | None = None,
    ) -> None:
        self.path, self.folder, self._opened = path, folder, dict(opened or {})
        self.experiment = read_experiment(path, changes)
        self.cells = cells_of(path, self.experiment.grid, changes or Changes())
        for cell in self.cells:  # a misspelt key must not come to light hours later
            read_experiment(path, cell.changes)
        self.failed: dict[str, str] = {}
        with locked(folder):
            owned = OwnedFolder(folder, "sweep")
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
) -> tuple[Cell, ...]:
    """Return the cells of a grid in its order: the last key changes first.

    Raises:
        FileError: the grid is empty.
    """
    axes = [dict(_flat("", one)) for one in grid] or [{}]
    cells: list[tuple[Setting, ...]] = []
    for axis in axes:
        if empty := [key for key, values in axis.items() if not values]:
            raise FileError(path, f"grid: {empty[0]} has no value")
        known = [[Setting(key=key, value=v, folder=path.parent) for v in axis[key]] for key in axis]
        cells += product(*known)
    if cells == [()]:
        raise FileError(path, "grid: it sets nothing", fix='[[grid]] with models.planner = ["..."]')
    said = {msgspec.json.encode([(one.key, one.value) for one in cell]): cell for cell in cells}
    return _cells_with_names(list(said.values()), changes)


def _cells_with_names(
    different: Sequence[tuple[Setting, ...]], changes: Changes
) -> tuple[Cell, ...]:
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
