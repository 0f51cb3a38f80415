"""EB-ALFRED as a run plays it: its chains, its files, its records, its tables."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar

from karma.bench.suite import BenchmarkResults, Chain, Play, planner_of
from karma.benchmarks.eb_alfred.experiment import EbExperiment, EbRow, remarks_on, tasks_of
from karma.benchmarks.eb_alfred.play import EbRecord, EbStage, play
from karma.benchmarks.eb_alfred.prompt import kind_of
from karma.benchmarks.eb_alfred.table import detail_sheet, results_of, success_sheet
from karma.benchmarks.trial_rooms import read_rooms, room_files
from karma.infer.hosted.session import Session
from karma.journal.not_run import NotRun
from karma.tasks.alfred_lists import ListedTask
from karma.world.eb_alfred.actions import read_types

_HERE = Path(__file__).parent


class EbAlfred:
    """EB-ALFRED over an experiment, see `Benchmark`.

    Args:
        experiment: what is played.
        path: that it was read from.
    """

    experiment_kind: ClassVar[type[Any]] = EbExperiment
    record_kind: ClassVar[type[Any]] = EbRecord

    def __init__(self, experiment: EbExperiment, path: Path) -> None:
        self._experiment, self._path = experiment, path

    def chains(self) -> list[Chain]:
        """Return all episodes: in strict rows those of a list are one chain, as puts count on."""
        one = self._experiment
        tasks = tasks_of(one, self._path)
        lists: dict[str, list[ListedTask]] = {}
        for task in tasks:
            lists.setdefault(task.list, []).append(task)
        together, apart = [*lists.values()], [[task] for task in tasks]
        return [
            Chain(
                row=row.name,
                tasks=tuple(task.id for task in group),
                seed=seed,
                shares=_prompt_of(row, group[0]),
            )
            for seed in one.seeds
            for row in one.rows
            for group in (together if row.strict else apart)
        ]

    def files(self) -> list[Path]:
        """Return the prompt's and the benchmark's files, and what tells of the rooms."""
        one = self._experiment
        theirs = [Path(one.tasks), Path(one.types), *room_files(Path(one.trials))]
        return [_HERE / "prompt.toml", _HERE / "examples.toml", *theirs]

    def begin(self, session: Session) -> Play:
        """Load rooms, lists of types and, where a row asks it, the planner."""
        one = self._experiment
        tasks = {task.id: task for task in tasks_of(one, self._path)}
        stage = EbStage(
            rooms=read_rooms(Path(one.trials), [task.trial for task in tasks.values()]),
            types=read_types(Path(one.types)),
            model=planner_of(one.models, session, one.seeds[0]) if one.plans else None,
        )
        rows = {row.name: row for row in one.rows}

        def played(chain: Chain) -> Iterator[EbRecord | NotRun]:
            puts: dict[str, int] = {}
            for task in chain.tasks:
                yield play(stage, rows[chain.row], tasks[task], chain.seed, puts)

        return played

    def results(self, records: Sequence[EbRecord]) -> BenchmarkResults:
        """Return success rates by list, and what lies behind them."""
        figures = results_of(records)
        published = self._experiment.published
        return BenchmarkResults(
            figures=figures,
            table=success_sheet(figures, Path(published) if published else None),
            behind=(detail_sheet(figures),),
            remarks=tuple(remarks_on(self._experiment)),
        )


def _prompt_of(row: EbRow, task: ListedTask) -> str:
    """Return what names the beginning of a prompt: room with its things, kind of examples."""
    return f"{task.trial}/{kind_of(task.list)}" if row.player == "planner" else ""
