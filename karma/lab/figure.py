"""A figure of the paper as data: a TOML file with `kind = "trace"`, run cell by cell, then drawn.

A cell is a workload with a unit set. Each is written to `cells/` when it is done, so that a run
that was killed goes on where it was; `results.json` holds them all with what the paper claims of
them, and has the same bytes whenever seed and tasks are the same.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from karma import __version__
from karma.errors import FileError
from karma.files import read_bytes, read_json, read_toml, to_json, write_atomic
from karma.journal.folder import locked
from karma.journal.owned_folder import HEADER, MARK, OwnedFolder
from karma.lab.exploration import Exploration, explore
from karma.lab.paper_claims import CellResults, PaperClaim, claims_of, claims_text
from karma.lab.simulate import BELADY
from karma.lab.sweep import PolicyRow, Sweep, run_rows, size_of, sized, sweep_of
from karma.lab.tasks import UNIT_SETS, Pool, UnitSet, alfred_pool, grammar_pool
from karma.lab.workloads import WORKLOADS, Workload, costs_of, draw_errands, trace_of


class TraceFigure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One figure.

    `shows` is "curves" (hit rate against tasks done) or "exploration" (hit rate against searches
    saved). Every size among the policies also gets Belady's bound. Where a file of `tasks` is not
    there, `otherwise = "grammar"` draws from our own task grammar, and the results say so.
    """

    kind: Literal["trace"]
    name: str
    shows: Literal["curves", "exploration"] = "curves"
    claims: tuple[str, ...] = ()  # names of `karma.lab.paper_claims.CLAIMS`
    tasks: tuple[str, ...] = ()  # ALFRED's files; () = our own grammar
    otherwise: Literal["grammar", ""] = ""
    workloads: tuple[Workload, ...] = WORKLOADS
    unit_sets: tuple[UnitSet, ...] = UNIT_SETS
    policies: tuple[str, ...]
    sizes: tuple[int, ...] = ()
    sequences: int = 100
    length: int = 1000
    checkpoints: tuple[int, ...] = (5, 10, 25, 50, 100, 200, 300, 500, 700, 1000)
    seed: int = 20251121

    def __post_init__(self) -> None:
        """Refuse what makes no figure."""
        if self.sequences < 1 or self.length < 1:
            raise ValueError("sequences and length must be at least 1")
        for name in ("policies", "workloads", "unit_sets", "checkpoints"):
            if not getattr(self, name):
                raise ValueError(f"{name} = []: one or more")
        if min(self.checkpoints) < 1:
            raise ValueError("checkpoints: each 1 or more")

    @property
    def points(self) -> tuple[int, ...]:
        """After how many tasks it is looked: the last one is the end, if no other is before it."""
        return tuple(one for one in self.checkpoints if one <= self.length) or (self.length,)


class FigureCell(msgspec.Struct, frozen=True, kw_only=True):
    """One workload with one unit set."""

    workload: Workload
    unit_set: UnitSet
    sweep: Sweep
    exploration: list[Exploration] = []

    def results(self) -> CellResults:
        """Return it as the claims and the pictures take it."""
        return CellResults(self.workload, self.unit_set, self.sweep, self.exploration)


class Results(msgspec.Struct, frozen=True, kw_only=True):
    """What `results.json` holds."""

    figure: TraceFigure
    source: str  # of the tasks
    cells: list[FigureCell]
    claims: list[PaperClaim]


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureProgress:
    """How far a figure is, in policies run."""

    done: int
    total: int
    doing: str


def run_figure(path: Path, folder: Path, *, fresh: bool = False) -> Iterator[FigureProgress]:
    """Run what is missing of a figure, then write `results.json` and draw it.

    Args:
        path: the TOML file.
        folder: takes `cells/`, `results.json`, `claims.md` and the pictures.
        fresh: throw away what an earlier run left there.

    Raises:
        FileError: the file is damaged, tasks are missing, or the folder holds another figure.
        KarmaError: a policy or a claim that there is not.
    """
    figure = read_toml(path, TraceFigure)
    policies = _with_bounds(sized(figure.policies, figure.sizes))
    claims_of(figure.claims, [])  # a wrong name must not come to light minutes later
    if folder.exists():
        OwnedFolder(folder, "figure").look()  # before tasks are drawn, which takes seconds
    pool = _pool(figure, path)
    with locked(folder):
        owned = OwnedFolder(folder, "figure")
        if fresh and owned.look():
            owned.clear()
        _claim(owned, figure, pool, path)
        yield from _run(figure, policies, pool, folder)


def _run(
    figure: TraceFigure,
    policies: tuple[str, ...],
    pool: Pool,
    folder: Path,
) -> Iterator[FigureProgress]:
    places = [(workload, units) for workload in figure.workloads for units in figure.unit_sets]
    total, cells = len(places) * len(policies), []
    for number, (workload, units) in enumerate(places):
        done = number * len(policies)
        kept = folder / _cell(workload, units)
        if not kept.exists():
            runner = _Runner(figure, pool, workload, units)
            for more in runner.run(policies):
                yield FigureProgress(done=done + more, total=total, doing=f"{workload} {units}")
            write_atomic(kept, to_json(runner.cell()))
        cells.append(read_json(kept, FigureCell))
        yield FigureProgress(done=done + len(policies), total=total, doing=f"{workload} {units}")
    claims = claims_of(figure.claims, [cell.results() for cell in cells])
    results = Results(figure=figure, source=pool.source, cells=cells, claims=claims)
    write_atomic(folder / "results.json", to_json(results))
    draw_figure(folder)
    yield FigureProgress(done=total, total=total, doing="drawn")


def read_figure(folder: Path) -> Results:
    """Return the results of a figure's folder.

    Raises:
        FileError: they are missing or torn.
    """
    return read_json(folder / "results.json", Results, fix="karma eval FILE runs the figure")


def draw_figure(folder: Path, into: Path | None = None) -> tuple[Path, ...]:
    """Draw the results of a folder as PNG and SVG, and write its claims as Markdown.

    Args:
        folder: of the figure.
        into: takes the files; None: the same folder.

    Raises:
        FileError: there are no results.
    """
    from karma.lab import plot

    results, into = read_figure(folder), into or folder
    caption = caption_of(results)
    if results.claims:
        write_atomic(into / "claims.md", claims_text(results.claims, caption).encode())
    draw = plot.curves if results.figure.shows == "curves" else plot.exploration
    made: list[Path] = []
    for unit_set in results.figure.unit_sets:
        mine = [cell.results() for cell in results.cells if cell.unit_set == unit_set]
        picture = draw(mine, f"{results.figure.name}, {unit_set.upper()}", caption)
        made += plot.save(picture, into / f"figure-{unit_set}")
    return tuple(made)


def caption_of(results: Results) -> str:
    """Return what every picture and table says of itself."""
    figure = results.figure
    return (
        f"{figure.sequences} sequences of {figure.length} tasks each, seed {figure.seed}; tasks: "
        f"{results.source}; 95 % intervals by bootstrap over sequences"
    )


# ------------------------------------------------------------- parts


def _with_bounds(policies: tuple[str, ...]) -> tuple[str, ...]:
    bounds = (f"{BELADY}[{size}]" for size in sorted({size_of(text) for text in policies}))
    return tuple(dict.fromkeys((*policies, *bounds)))


def _pool(figure: TraceFigure, path: Path) -> Pool:
    from karma.bench.experiment_file import beside

    files = [beside(path.parent, name) for name in figure.tasks]
    missing = [file for file in files if not file.exists()]
    if files and not missing:
        return alfred_pool(files)
    if missing and figure.otherwise != "grammar":
        fix = 'put it there, or write otherwise = "grammar"'
        raise FileError(missing[0], f"no such file, which {path} draws from", fix=fix)
    return grammar_pool(figure.seed)


class _Header(msgspec.Struct, frozen=True, kw_only=True):
    version: str
    figure: str  # SHA-256 of the file
    tasks: str  # and of what is drawn from


def _claim(owned: OwnedFolder, figure: TraceFigure, pool: Pool, path: Path) -> None:
    """Make a folder the figure's, or see that it is; FileError where it holds something else."""
    header = _Header(
        version=__version__,
        figure=hashlib.sha256(read_bytes(path)).hexdigest(),
        tasks=hashlib.sha256(to_json([pool.source, pool.errands])).hexdigest(),
    )
    place, data = owned.path / HEADER, to_json(header, indent=2)
    cells = (_cell(one, units) for one in figure.workloads for units in figure.unit_sets)
    drawn = (f"figure-{one}.{end}" for one in figure.unit_sets for end in ("png", "svg"))
    names = {HEADER, "results.json", "claims.md", *cells, *drawn}
    if not (owned.path / MARK).exists() and place.exists() and read_bytes(place) == data:
        owned.adopt(names, data)  # an earlier version's, which left no mark
    owned.look()
    if place.exists() and read_bytes(place) != data:
        raise FileError(
            place,
            "this folder holds another figure, or one of other tasks",
            fix=f"karma eval {path} --fresh, or --out another folder",
        )
    owned.begin(names, data)
    owned.write(HEADER, data)


def _cell(workload: Workload, units: UnitSet) -> str:
    return f"cells/{workload}-{units}.json"


class _Runner:
    """One cell being run."""

    def __init__(self, figure: TraceFigure, pool: Pool, workload: Workload, units: UnitSet) -> None:
        self._figure, self._workload, self._units = figure, workload, units
        drawn = [
            draw_errands(pool, workload, figure.length, figure.seed, number)
            for number in range(figure.sequences)
        ]
        self._traces = [trace_of(errands, workload, units) for errands in drawn]
        self._costs = [costs_of(errands, units, pool) for errands in drawn]
        self._rows: list[PolicyRow] = []
        self._explored: list[Exploration] = []

    def run(self, policies: Sequence[str]) -> Iterator[int]:
        """Yield how many policies are done."""
        figure = self._figure
        rows = run_rows(self._traces, policies, checkpoints=figure.points, seed=figure.seed)
        for row in rows:
            self._rows.append(row)
            if figure.shows == "exploration":
                found = explore(row.policy, self._traces, self._costs, figure.seed)
                self._explored.append(found)
            yield len(self._rows)

    def cell(self) -> FigureCell:
        """Return what was found."""
        return FigureCell(
            workload=self._workload,
            unit_set=self._units,
            sweep=sweep_of(self._traces, self._rows),
            exploration=self._explored,
        )
