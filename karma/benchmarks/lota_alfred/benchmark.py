"""LoTa-Bench's ALFRED as a run plays it: its chains, its files, its records, its tables."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

from karma.bench.suite import BenchmarkResults, Chain, Play, planner_of
from karma.benchmarks.lota_alfred.experiment import LotaExperiment, tasks_of
from karma.benchmarks.lota_alfred.play import LotaRecord, LotaStage, play
from karma.benchmarks.lota_alfred.prompt import FILES
from karma.benchmarks.lota_alfred.table import detail_sheet, results_of, success_sheet
from karma.benchmarks.trial_rooms import read_rooms, room_files
from karma.contracts import LanguageModel, ScoringModel
from karma.infer.hosted.session import Session
from karma.journal.not_run import NotRun
from karma.methods.lota.method import chooser_of
from karma.world.eb_alfred.actions import read_types


class LotaAlfred:
    """LoTa-Bench's ALFRED over an experiment, see `Benchmark`.

    Args:
        experiment: what is played.
        path: that it was read from.
    """

    experiment_kind: ClassVar[type[Any]] = LotaExperiment
    record_kind: ClassVar[type[Any]] = LotaRecord

    def __init__(self, experiment: LotaExperiment, path: Path) -> None:
        self._experiment, self._path = experiment, path

    def chains(self) -> list[Chain]:
        """Return all episodes, each by itself."""
        one = self._experiment
        tasks = tasks_of(one, self._path)
        return [
            Chain(row=row.name, tasks=(task.id,), seed=seed)
            for seed in one.seeds
            for row in one.rows
            for task in tasks
        ]

    def files(self) -> list[Path]:
        """Return the prompt's and the benchmark's files, and what tells of the rooms."""
        one = self._experiment
        return [*FILES, Path(one.tasks), Path(one.types), *room_files(Path(one.trials))]

    def begin(self, session: Session) -> Play:
        """Load rooms, lists of types and, where a row asks it, the planner."""
        one = self._experiment
        tasks = {task.id: task for task in tasks_of(one, self._path)}
        model = planner_of(one.models, session, one.seeds[0]) if one.plans else None
        stage = LotaStage(
            rooms=read_rooms(Path(one.trials), [task.trial for task in tasks.values()]),
            types=read_types(Path(one.types)),
            model=model,
            scorer=_scorer(one, model),
        )
        rows = {row.name: row for row in one.rows}

        def played(chain: Chain) -> Iterator[LotaRecord | NotRun]:
            for task in chain.tasks:
                yield play(stage, rows[chain.row], tasks[task], chain.seed)

        return played

    def results(self, records: Sequence[LotaRecord]) -> BenchmarkResults:
        """Return success rates by type of task, and what lies behind them."""
        figures = results_of(records)
        return BenchmarkResults(
            figures=figures, table=success_sheet(figures), behind=(detail_sheet(figures),)
        )


def _scorer(experiment: LotaExperiment, model: LanguageModel | None) -> ScoringModel | None:
    """Return the model where a row has skills scored; ModelError if it cannot."""
    wanted = [row.name for row in experiment.rows if row.player == "scored"]
    if not wanted or model is None:
        return None
    return chooser_of(model, wanted[0], 'with player = "generated"')
