"""A run: an experiment in its folder, begun, gone on with, and finished."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from karma.bench.configuration import configuration, header_of
from karma.bench.experiment import Experiment
from karma.bench.experiment_file import Changes, read_experiment
from karma.bench.experiment_tasks import load, scene_path
from karma.bench.figures import added_up
from karma.bench.precision import Precision, takes_another
from karma.bench.worker_count import IN_FLIGHT, Suggestion, suggest_workers
from karma.bench.workers import Job, Stage, check_workers, perform_here, perform_in_processes
from karma.contracts import Task
from karma.errors import FileError, KarmaError
from karma.files import append_line, to_json
from karma.infer.hosted.cassette import Cassette
from karma.infer.hosted.server import slots_of
from karma.infer.hosted.session import Session
from karma.journal.folder import locked
from karma.journal.not_run import FILE as NOT_RUN
from karma.journal.not_run import IN_A_ROW, NotRun
from karma.journal.records import EpisodeRecord, EpisodeTiming, Key
from karma.journal.run_folder import EPISODES, Finished, RunFolder
from karma.offline import network_allowed


class Run:
    """An experiment in its folder.

    Args:
        path: the TOML file.
        folder: takes records, header, step logs, maps and imported scenes.
        changes: what the experiment says otherwise than its file.
        fresh: throw away what an earlier run left there.
        cassette: records hosted models or stands for them, and is the run's clock.
        base_url: of all hosted models, in place of the experiment's.
        computed: keys of its [models] that say how they are computed, in place of its own.
        steps: whether to keep step logs; None leaves it to the experiment.
        states: folder for KV states of rooms, in place of the experiment's.
        half_width: wanted of every success rate's interval, by more seeds than the experiment
            lists; None leaves it to the experiment.
        max_seeds: that may come to, the listed ones counted; None leaves it to the experiment.

    Raises:
        FileError: the experiment is damaged, or the folder holds a run of something else.
        KarmaError: another run is at work in the folder, or its tasks have one seed only.
    """

    def __init__(
        self,
        path: Path,
        folder: Path,
        *,
        changes: Changes | None = None,
        fresh: bool = False,
        cassette: Cassette | None = None,
        base_url: str = "",
        computed: Mapping[str, Any] | None = None,
        steps: bool | None = None,
        states: Path | None = None,
        half_width: float | None = None,
        max_seeds: int | None = None,
    ) -> None:
        self.path, self.folder = path, folder
        self.experiment = read_experiment(path, changes)
        if self.experiment.grid:
            raise FileError(path, "it has a [[grid]]: a sweep, not a run", fix=f"karma eval {path}")
        if computed:
            models = self.experiment.models.computed_by(computed)
            self.experiment = msgspec.structs.replace(self.experiment, models=models)
        self._session = Session(cassette)
        models = self.experiment.models
        if base_url:
            models = msgspec.structs.replace(models, hosted=models.hosted.at(base_url))
        loaded = load(self.experiment, path, folder)
        self.tasks = loaded.tasks
        self._steps = self.experiment.run.steps if steps is None else steps
        self.precision = _precision(self.experiment, half_width, max_seeds)
        told = self.experiment
        if self.precision is not None:
            _check_seeds_differ(self.tasks)
            width, most = self.precision.half_width, self.precision.max_seeds
            told = msgspec.structs.replace(told, half_width=width, max_seeds=most)
        self.seeds = self.experiment.seeds
        self._files = RunFolder(folder, steps=self._steps)
        self._scenes = loaded.scenes
        self._config = configuration(told)
        self.header = header_of(self.experiment, self.tasks, loaded.scenes, steps=self._steps)
        self.records: list[EpisodeRecord] = []
        self.not_run: list[NotRun] = []  # of those that were tried last
        self.timings: dict[Key, EpisodeTiming] = {}
        with locked(self.folder):
            if fresh:
                self._files.clear()
            self._claim()
            self._go_on()
        kept = self.experiment.run.room_states
        self._stage = Stage(
            rows=self.experiment.rows,
            models=models,
            world=self.experiment.world,
            seed=self.experiment.seeds[0],
            folder=folder,
            steps=self._steps,
            states=replace(kept, folder=states or kept.folder),
            tape=self._session.cassette.tape,
            network=network_allowed(),
        )

    @property
    def records_path(self) -> Path:
        """Where the records are."""
        return self.folder / EPISODES

    @property
    def total(self) -> int:
        """How many episodes the seeds come to that have been begun."""
        return len(self._jobs())

    @property
    def left(self) -> int:
        """How many of them are not done yet."""
        return self.total - len(self.records)

    def suggest(self) -> Suggestion:
        """Return how many workers to use unless a number is given.

        Raises:
            KarmaError: a hosted planner may not or cannot be reached.
        """
        models, in_flight = self._stage.models, None
        if models.hosted.planner is not None and self._session.cassette.mode != "replay":
            in_flight = slots_of(models.hosted.planner) or IN_FLIGHT
        return suggest_workers(models, self.left, self._stage.rows, in_flight=in_flight)

    def episodes(self, workers: int = 1, *, ray: str = "") -> Iterator[EpisodeRecord]:
        """Do what is missing; each record is on the disk before it is yielded.

        When the last is done, all lines are put in the order of seeds, rows and tasks, in
        whatever order they were done. Where success rates are not yet as sure as they are wanted,
        one seed after the other is begun. What was not run is in `not_run` afterwards; then the run
        is not finished.

        Args:
            workers: processes to use, each with models of its own.
            ray: address of a Ray cluster, whose machines do the episodes; then 0 workers are as
                many as it has room for.

        Raises:
            KarmaError: a model cannot be loaded or a hosted one not reached, a row has a wrong
                option, a cluster is to ask hosted models, another run is at work in the folder, or
                several episodes in a row were not run.
        """
        if workers > 1 or ray:
            check_workers(self._stage.models, self._session.cassette, ray)
        with locked(self.folder):
            self._claim()
            self._go_on()
            if self.left:
                self._files.reopen()
            self.not_run, in_a_row = [], 0
            while not self.not_run and (todo := self._todo()):
                for one in self._perform(todo, workers, ray):
                    if isinstance(one, NotRun):
                        in_a_row += not one.alone
                        self._put_aside(one, ends=in_a_row == IN_A_ROW)
                        continue
                    in_a_row = 0
                    self._files.commit(one)
                    self.records.append(one.record)
                    self.timings[one.timing.key] = one.timing
                    yield one.record
                self._begin_another()
            if not self.not_run:
                self._files.finish([job.key for job in self._jobs()], added_up)
                self.records, self.timings = self._files.done()

    # ------------------------------------------------------------- parts

    def _put_aside(self, one: NotRun, *, ends: bool) -> None:
        """Keep why an episode was not run; `ends`: so many were not that none would be."""
        self.not_run.append(one)
        append_line(self.folder / NOT_RUN, to_json(one))
        if ends:
            raise KarmaError(f"{IN_A_ROW} episodes one after the other were not run: {one.reason}")

    def _claim(self) -> None:
        fix = f"--out another folder, or karma eval {self.path} --fresh, which throws that run away"
        rooms = {scene_path(self.folder, name): data for name, data in self._scenes.items()}
        scenes = {place.relative_to(self.folder).as_posix(): rooms[place] for place in rooms}
        self._files.claim(self.header, self._config, fix=fix, scenes=scenes)

    def _go_on(self) -> None:
        """Look at what is done, and at what is to be done next."""
        self.records, self.timings = self._files.done()
        listed = self.experiment.seeds
        last = max((record.seed for record in self.records), default=0)
        self.seeds = (
            *listed,
            *range(max(listed) + 1, last + 1),
        )  # a seed that was begun is finished
        if not self.left:
            self._begin_another()

    def _begin_another(self) -> None:
        """Begin the next seed where a success rate is not sure enough; all others are complete."""
        if self.precision and takes_another(self.records, self.precision, len(self.seeds)):
            self.seeds = (*self.seeds, max(self.seeds) + 1)

    def _todo(self) -> list[Job]:
        done = {record.key for record in self.records}
        return [job for job in self._jobs() if job.key not in done]

    def _perform(self, todo: list[Job], workers: int, ray: str) -> Iterator[Finished | NotRun]:
        if ray:
            from karma.bench.ray_workers import perform_on_ray

            return perform_on_ray(
                self._stage,
                todo,
                ray,
                header=self.header,
                scenes=self._scenes,
                number=workers,
            )
        if workers > 1:
            return perform_in_processes(self._stage, todo, workers)
        return perform_here(self._stage, todo, self._session)

    def _jobs(self) -> list[Job]:
        """Return all episodes in their final order."""
        return [
            Job(row=row.name, task=task, seed=seed)
            for seed in self.seeds
            for row in self.experiment.rows
            for task in self.tasks
        ]


def _precision(
    experiment: Experiment, half_width: float | None, max_seeds: int | None
) -> Precision | None:
    """Return how sure to be, as a command asks or else the experiment; None: not at all.

    Raises:
        KarmaError: there is no such half-width, or a number of seeds without one.
    """
    width = experiment.half_width if half_width is None else half_width
    if width is None:
        if max_seeds is not None:
            raise KarmaError("--max-seeds is for runs with --half-width, e.g. --half-width 0.05")
        return None
    try:
        return Precision(half_width=width, max_seeds=max_seeds or experiment.max_seeds)
    except ValueError as error:
        raise KarmaError(f"{error}\n  To fix: --half-width 0.05") from error


def _check_seeds_differ(tasks: Iterable[Task]) -> None:
    """Raise KarmaError where another seed would be the same episode again."""
    if alike := [task.id for task in tasks if task.kind == "sequence"]:
        raise KarmaError(
            f"task {alike[0]} is a sequence, which has one seed: no half-width is reached by more\n"
            "  To fix: leave out the half-width, or put more sequences into the task file"
        )
