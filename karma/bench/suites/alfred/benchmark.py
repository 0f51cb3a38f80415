"""EB-ALFRED and LoTa-Bench's ALFRED as a run plays them: chains, files, records, tables."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

from karma.agent.journal.records import NotRun
from karma.bench.engine.suite import BenchmarkResults, Chain, Play, planner_of
from karma.bench.rows.lota.method import chooser_of
from karma.bench.suites.alfred.experiment import EbExperiment, EbRow, LotaExperiment
from karma.bench.suites.alfred.play import (
    AlfredStage,
    EbRecord,
    LotaRecord,
    play,
    read_rooms,
    room_files,
)
from karma.bench.suites.alfred.table import EB_TABLES, LOTA_TABLES, results_of
from karma.bench.tasks.alfred import ListedTask
from karma.contracts import LanguageModel, ScoringModel
from karma.infer.hosted.session import Session
from karma.world.eb_alfred.actions import read_types

_HERE = Path(__file__).parent


class _AlfredSuite:
    """ALFRED's tasks over an experiment, see `Benchmark`."""

    experiment_kind: ClassVar[type[Any]]
    record_kind: ClassVar[type[Any]]
    counts_on = False  # whether a strict row's puts count in the next episode of a list

    def __init__(self, experiment: Any, path: Path) -> None:
        self._experiment, self._path = experiment, path

    def chains(self) -> list[Chain]:
        """Return all episodes, each by itself, or those of a list where their puts count on."""
        one = self._experiment
        tasks = one.chosen(self._path)
        lists: dict[str, list[ListedTask]] = {}
        for task in tasks:
            lists.setdefault(task.list, []).append(task)
        together, apart = [*lists.values()], [[task] for task in tasks]
        return [
            Chain(
                row=row.name,
                tasks=tuple(task.id for task in group),
                seed=seed,
                shares=row.shares(group[0]) if isinstance(row, EbRow) else "",
            )
            for seed in one.seeds
            for row in one.rows
            for group in (together if row.strict and self.counts_on else apart)
        ]

    def files(self) -> list[Path]:
        """Return the prompt's and the benchmark's files, and what tells of the rooms."""
        one = self._experiment
        theirs = [Path(one.tasks), Path(one.types), *room_files(Path(one.trials))]
        return [_HERE / one.benchmark / name for name in ("prompt.toml", "examples.toml")] + theirs

    def begin(self, session: Session) -> Play:
        """Load rooms, lists of types and, where a row asks it, the planner."""
        one = self._experiment
        tasks = {task.id: task for task in one.chosen(self._path)}
        model = planner_of(one.models, session, one.seeds[0]) if one.plans else None
        stage = AlfredStage(
            rooms=read_rooms(Path(one.trials), [task.trial for task in tasks.values()]),
            types=read_types(Path(one.types)),
            model=model,
            scorer=self._scorer(model),
        )
        rows = {row.name: row for row in one.rows}

        def played(chain: Chain) -> Iterator[EbRecord | LotaRecord | NotRun]:
            puts: dict[str, int] = {}
            for task in chain.tasks:
                yield play(stage, rows[chain.row], tasks[task], chain.seed, puts)

        return played

    def _scorer(self, model: LanguageModel | None) -> ScoringModel | None:
        """Return the model where a row has skills scored; ModelError if it cannot."""
        wanted = [row.name for row in self._experiment.rows if row.player == "scored"]
        if not wanted or model is None:
            return None
        return chooser_of(model, wanted[0], 'with player = "generated"')


class EbAlfred(_AlfredSuite):
    """EB-ALFRED."""

    experiment_kind: ClassVar[type[Any]] = EbExperiment
    record_kind: ClassVar[type[Any]] = EbRecord
    counts_on = True

    def results(self, records: Sequence[EbRecord]) -> BenchmarkResults:
        """Return success rates by list, and what lies behind them."""
        one = self._experiment
        published = Path(one.published) if one.published else None
        return results_of(records, EB_TABLES, published, tuple(one.remarks()))


class LotaAlfred(_AlfredSuite):
    """LoTa-Bench's ALFRED."""

    experiment_kind: ClassVar[type[Any]] = LotaExperiment
    record_kind: ClassVar[type[Any]] = LotaRecord

    def results(self, records: Sequence[LotaRecord]) -> BenchmarkResults:
        """Return success rates by type of task, and what lies behind them."""
        return results_of(records, LOTA_TABLES)
