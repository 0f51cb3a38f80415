"""A figure of the paper as data: a TOML file with `kind = "trace"`, run cell by cell, then drawn.

A cell is a workload with a unit set, and a chain of the run: an episode for each policy, so a run
that was killed goes on with the cells that are not done. `results.json` holds them all with what
the paper claims of them, and has the same bytes whenever seed and tasks are the same.
"""

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from karma import __version__, registry
from karma.bench.engine.experiment_file import beside
from karma.bench.engine.run import Run
from karma.bench.engine.suite import NO_MODELS, Chain, Done
from karma.bench.figures.drawing import png_of, svg_of
from karma.bench.policies.paper_claims import FigureCell, PaperClaim, claims_of, claims_text
from karma.bench.policies.simulate import BELADY
from karma.bench.policies.sweep import (
    PolicyName,
    explore,
    run_rows,
    sized,
    sweep_of,
)
from karma.bench.policies.tasks import (
    UNIT_SETS,
    WORKLOADS,
    Pool,
    UnitSet,
    Workload,
    costs_of,
    draw_errands,
    grammar_pool,
    trace_of,
)
from karma.errors import FileError, KarmaError
from karma.files import read_json, read_toml, to_json
from karma.journal.folder import CLAIMS, RESULTS, check_sealed, is_begun
from karma.journal.header import Header
from karma.journal.records import NotRun, PlayedTiming
from karma.journal.run_folder import Finished, RunFolder
from karma.loading.models import Models, Row
from karma.models.session import Session

AtLeastOne = Annotated[int, Meta(ge=1)]


class TraceFigure(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Description of a figure.

    `shows` is "curves" (hit rate against tasks done) or "exploration" (hit rate against searches
    saved). Every size among the policies also gets Belady's bound. Where a file of `tasks` is not
    there, `otherwise = "grammar"` draws from our own task grammar, and the results say so.
    """

    kind: Literal["trace"]
    name: str
    shows: Literal["curves", "exploration"] = "curves"
    claims: tuple[str, ...] = ()  # names of `karma.bench.policies.paper_claims.CLAIMS`
    tasks: tuple[str, ...] = ()  # ALFRED's files; () = our own grammar
    otherwise: Literal["grammar", ""] = ""
    workloads: Annotated[tuple[Workload, ...], Meta(min_length=1)] = WORKLOADS
    unit_sets: Annotated[tuple[UnitSet, ...], Meta(min_length=1)] = UNIT_SETS
    policies: Annotated[tuple[str, ...], Meta(min_length=1)]
    sizes: tuple[int, ...] = ()
    sequences: AtLeastOne = 100
    length: AtLeastOne = 1000
    checkpoints: Annotated[tuple[AtLeastOne, ...], Meta(min_length=1)] = (
        5, 10, 25, 50, 100, 200, 300, 500, 700, 1000,
    )  # fmt: skip
    seed: int = 20251121

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seed, as a run takes it."""
        return (self.seed,)

    @property
    def points(self) -> tuple[int, ...]:
        """After how many tasks it is looked: the last one is the end, if no other is before it."""
        return tuple(one for one in self.checkpoints if one <= self.length) or (self.length,)


class Results(msgspec.Struct, frozen=True, kw_only=True):
    """Content of `results.json`."""

    figure: TraceFigure
    source: str  # of the tasks
    cells: list[FigureCell]
    claims: list[PaperClaim]


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyRecord:
    """Results of a policy in a cell."""

    row: str  # the cell's name
    task: str  # the policy
    seed: int
    cell: FigureCell  # with this policy only


def figure_run(path: Path, folder: Path, *, fresh: bool = False) -> Run:
    """Return the run of a figure; its end writes `results.json` and draws it.

    FileError if the file is damaged, tasks are missing, or the folder holds another figure;
    KarmaError for a policy or a claim that there is not.
    """
    figure = read_toml(path, TraceFigure)
    policies = _with_bounds(sized(figure.policies, figure.sizes))
    claims_of(figure.claims, [])  # a wrong name must not come to light minutes later
    is_begun(folder)  # before tasks are sampled, which takes seconds
    pool = _pool(figure, path)
    header = Header(
        kind="figure",
        name=figure.name,
        options=msgspec.to_builtins(figure),
        files={"tasks": hashlib.sha256(to_json([pool.source, pool.errands])).hexdigest()},
        versions={"karma": __version__},
    )
    suite = FigureSuite(experiment=figure, header=header, policies=policies, pool=pool)
    return Run(path, folder, fresh=fresh, suite=suite)


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureSuite:
    """A figure, see `karma.bench.engine.suite.Suite`; no model is loaded for it."""

    experiment: TraceFigure
    header: Header
    policies: tuple[str, ...]
    pool: Pool  # that is drawn from
    models: Models = NO_MODELS
    rows: tuple[Row, ...] = ()

    def cells(self) -> dict[str, tuple[Workload, UnitSet]]:
        """Return what each cell is of, by its name."""
        one = self.experiment
        pairs = [(workload, units) for workload in one.workloads for units in one.unit_sets]
        return {f"{workload}-{units}": (workload, units) for workload, units in pairs}

    def files(self, folder: Path) -> "FigureFolder":
        """Return the folder as what takes the records."""
        return FigureFolder(folder, steps=False, records=PolicyRecord)

    def chains(self, seeds: Sequence[int]) -> list[Chain]:
        """Return a chain for each cell."""
        return [Chain(row=cell, tasks=self.policies, seed=seeds[0]) for cell in self.cells()]

    def added_up(self, records: Sequence[PolicyRecord]) -> dict[str, bytes]:
        """Return the results of all cells, what the paper claims of them, and the pictures."""
        cells = [
            _whole([record.cell for record in records if record.row == name])
            for name in self.cells()
        ]
        claims = claims_of(self.experiment.claims, cells)
        results = Results(
            figure=self.experiment, source=self.pool.source, cells=cells, claims=claims
        )
        return {RESULTS: to_json(results), **drawn(results)}

    def begin(self, session: Session) -> Callable[[Chain], Iterator[Done]]:
        """Return what plays a cell, policy by policy."""
        return self._play

    def _play(self, chain: Chain) -> Iterator[Done]:
        one, (workload, units) = self.experiment, self.cells()[chain.row]
        drawn = [
            draw_errands(self.pool, workload, one.length, one.seed, number)
            for number in range(one.sequences)
        ]
        traces = [trace_of(errands, workload, units) for errands in drawn]
        costs = [costs_of(errands, units, self.pool) for errands in drawn]
        begun = time.perf_counter()
        for row in run_rows(traces, chain.tasks, checkpoints=one.points, seed=one.seed):
            explored = one.shows == "exploration"
            found = [explore(row.policy, traces, costs, one.seed)] if explored else []
            sweep = sweep_of(traces, [row])
            cell = FigureCell(workload=workload, unit_set=units, sweep=sweep, exploration=found)
            name, policy, seed = chain.row, row.policy, chain.seed
            seconds = time.perf_counter() - begun
            timing = PlayedTiming(row=name, task=policy, seed=seed, seconds=seconds)
            record = PolicyRecord(row=name, task=policy, seed=seed, cell=cell)
            yield Finished(record=record, timing=timing)


class FigureFolder(RunFolder):
    """The folder of a figure."""

    def put_aside(self, one: NotRun) -> None:
        """End the run: what keeps one policy from being run keeps all."""
        raise KarmaError(one.reason)


def _whole(cells: Sequence[FigureCell]) -> FigureCell:
    """Merge cells of equal workload and unit set."""
    rows = [row for cell in cells for row in cell.sweep.rows]
    explored = [found for cell in cells for found in cell.exploration]
    sweep = msgspec.structs.replace(cells[0].sweep, rows=rows)
    return msgspec.structs.replace(cells[0], sweep=sweep, exploration=explored)


def read_figure(folder: Path) -> Results:
    """Return the results of a figure's folder; FileError if they are missing, torn or edited."""
    check_sealed(folder)
    return read_json(folder / RESULTS, Results, fix="karma eval FILE runs the figure")


def drawn(results: Results) -> dict[str, bytes]:
    """Return the claims as Markdown, and the pictures as PNG and SVG, by their files' names."""
    found: dict[str, bytes] = {}
    if results.claims:
        found[CLAIMS] = claims_text(results.claims, caption_of(results)).encode()
    for name, picture in pictures_of(results):
        found |= {f"{name}.png": png_of(picture), f"{name}.svg": svg_of(picture)}
    return found


def pictures_of(results: Results) -> Iterator[tuple[str, Any]]:
    """Yield the picture of each unit set with its file name."""
    from karma.bench.policies import plot

    draw = plot.curves if results.figure.shows == "curves" else plot.exploration
    for unit_set in results.figure.unit_sets:
        mine = [cell for cell in results.cells if cell.unit_set == unit_set]
        title = f"{results.figure.name}, {unit_set.upper()}"
        yield f"figure-{unit_set}", draw(mine, title, caption_of(results))


def caption_of(results: Results) -> str:
    """Return the caption of all pictures and tables."""
    figure = results.figure
    return (
        f"{figure.sequences} sequences of {figure.length} tasks each, seed {figure.seed}; tasks: "
        f"{results.source}; 95 % intervals by bootstrap over sequences"
    )


# ------------------------------------------------------------- parts


def _with_bounds(policies: tuple[str, ...]) -> tuple[str, ...]:
    sizes = sorted({PolicyName.of(text).size for text in policies})
    bounds = (f"{BELADY}[{size}]" for size in sizes)
    return tuple(dict.fromkeys((*policies, *bounds)))


def _pool(figure: TraceFigure, path: Path) -> Pool:
    files = [beside(path.parent, name) for name in figure.tasks]
    missing = [file for file in files if not file.exists()]
    if files and not missing:
        pool: Pool = registry.load("task_pools", "alfred")(files)
        return pool
    if missing and figure.otherwise != "grammar":
        fix = 'put it there, or write otherwise = "grammar"'
        raise FileError(missing[0], f"no such file, which {path} draws from", fix=fix)
    return grammar_pool(figure.seed)
