"""Doing the episodes: in this process or in several at once, each with models of its own.

An episode depends on its row, task and seed only, never on the process that does it or on earlier
ones. So episodes can be dealt out in any way, and one whose worker died can be done again.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from karma import registry
from karma.bench.days import Days
from karma.bench.episode import run_episode
from karma.bench.pool import Workshop, in_processes
from karma.contracts import Method, Resources, SceneRef, Task, VisionModel, World
from karma.errors import FileError, KarmaError, UnwritableError
from karma.infer.hosted.cassette import Cassette, CassetteError, Tape
from karma.infer.hosted.session import Hosted, Session
from karma.infer.llama.room_states import StateOptions
from karma.journal.not_run import NotRun
from karma.journal.part import TimeLog
from karma.journal.records import EpisodeRecord, Key
from karma.journal.run_folder import Finished
from karma.journal.steps import StepLog
from karma.loading.models import Models, Row, for_row, load_resources
from karma.loading.worlds import world_maker
from karma.methods.tour import explore_room
from karma.offline import NetworkRefused, go_offline, settle
from karma.world.home import Home

MAPS = "maps"  # below the run folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One episode to do."""

    row: str
    task: Task
    seed: int

    @property
    def key(self) -> Key:
        """What names the episode."""
        return self.row, self.task.id, self.seed

    @property
    def shares(self) -> str:
        """Nothing that is worth another order."""
        return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """What a worker needs to know before its first episode."""

    rows: tuple[Row, ...]
    models: Models
    world: str
    seed: int  # of the planner's decoding
    folder: Path
    steps: bool
    states: StateOptions
    tape: Tape  # the cassette that all workers join
    network: bool  # hosted models on other machines may be asked


class Performer:
    """Does episodes, one after the other, with models that are loaded once.

    Args:
        stage: what to load.
        session: of hosted models.

    Raises:
        KarmaError: a model cannot be loaded, or a row has an option that its method does not know.
    """

    def __init__(self, stage: Stage, session: Session | None = None) -> None:
        self._stage, self._session = stage, session or Session()
        resources = load_resources(
            stage.models,
            maps=stage.folder / MAPS,
            seed=stage.seed,
            session=self._session,
            states=stage.states,
        )
        self._make = world_maker(stage.world, [row.all_options for row in stage.rows])
        self._world = self._make()
        self._days = Days()
        seeing = {stage.models.vision: resources.vision}
        self._methods = {  # all of them now: a wrong row must not come to light hours later
            row.name: _built(row, resources, seeing, stage.models) for row in stage.rows
        }
        self._session.ledger.take()  # what loading asked is on no episode's bill

    def do(self, job: Job) -> Finished | NotRun:
        """Do one episode, or say why it was not run.

        Raises:
            KarmaError: no other episode could be run either: the disk is full, a recording is of
                other requests, or somebody asked for the network.
        """
        try:
            return self._done(job)
        except (UnwritableError, CassetteError, NetworkRefused):
            raise
        except KarmaError as error:
            self._session.ledger.take()
            return NotRun(row=job.row, task=job.task.id, seed=job.seed, reason=str(error))

    def _done(self, job: Job) -> Finished:
        if job.seed:
            for scene in job.task.scenes:
                self._know(scene)
        steps, times = StepLog(), TimeLog()
        with self._worlds(job.task) as world:
            record = self._record(job, world, steps, times)
        settle()
        data = steps.data() if self._stage.steps else b""
        return Finished(record=record, timing=times.of(record), steps=data)

    @contextmanager
    def _worlds(self, task: Task) -> Iterator[World]:
        """Give the world of a task: a home, for as long as it is needed, where it has rooms."""
        if len(task.scenes) == 1:
            yield self._world
            return
        home = Home(self._make)
        try:
            yield home
        finally:
            home.stop()

    def _record(self, job: Job, world: World, steps: StepLog, times: TimeLog) -> EpisodeRecord:
        return run_episode(
            self._methods[job.row],
            world,
            job.task,
            row=job.row,
            seed=job.seed,
            folder=self._stage.folder,
            ledger=self._session.ledger,
            cassette=self._session.cassette,
            steps=steps if self._stage.steps else None,
            times=times,
            days=self._days,
        )

    def _know(self, scene: SceneRef) -> None:
        """Have a map of a room as it is, before somebody makes one of it on another day."""
        path = self._stage.folder / MAPS / f"{scene.name}.json"
        if path.exists():
            return
        try:
            self._world.reset(scene.source)
            graph, _ = explore_room(self._world, scene, None)
        except FileError:  # the episode will say why
            return
        graph.save(path)


def _built(
    row: Row, resources: Resources, loaded: dict[str, VisionModel], models: Models
) -> Method:
    """Return the method of a row.

    Raises:
        KarmaError: it has an option that the method does not know, or of the wrong type.
    """
    try:
        kind: type[Method] = registry.load("methods", row.method)
        return kind.build(for_row(resources, row, loaded, models), row.all_options)
    except KarmaError as error:
        raise KarmaError(f"row {row.name!r}: {error}") from error


def perform_here(
    stage: Stage, jobs: Sequence[Job], session: Session | None = None
) -> Iterator[Finished | NotRun]:
    """Do the episodes in this process, in their order."""
    performer = Performer(stage, session)
    for job in jobs:
        yield performer.do(job)


def perform_in_processes(
    stage: Stage, jobs: Sequence[Job], number: int
) -> Iterator[Finished | NotRun]:
    """Do the episodes in `number` processes, see `in_processes`."""
    shop: Workshop[Job, Finished | NotRun] = Workshop(
        begin=partial(_begun, stage),
        imports=(__name__, *imported(stage.models)),
    )
    return in_processes(shop, jobs, number)


def _begun(stage: Stage) -> Callable[[Job], Finished | NotRun]:
    """Load what a worker process needs."""
    go_offline(allow_network=stage.network)
    return Performer(stage, Session(Cassette.of(stage.tape))).do


def imported(models: Models) -> tuple[str, ...]:
    """Return what is imported once for all workers: what their models take, and no more."""
    hosted = models.hosted
    needed = {
        "llama_cpp": hosted.planner is None,
        "sentence_transformers": models.embedder.partition(":")[0] == "sentence",
        "openai": hosted != Hosted(),
    }
    return tuple(name for name, wanted in needed.items() if wanted)


def check_workers(models: Models, cassette: Cassette, ray: str) -> None:
    """Raise KarmaError for what several processes cannot do, or none on another machine.

    Args:
        models: of the run.
        cassette: records hosted models or stands for them.
        ray: address of a cluster; "" for processes here.
    """
    if models.rpc:
        raise KarmaError(
            "llama.cpp's rpc-server serves one process only\n"
            "  To fix: leave out --workers and --ray"
        )
    if ray and (models.hosted != Hosted() or cassette.mode != "off"):
        raise KarmaError(  # keys and recordings do not travel
            "hosted models and cassettes are for workers on this machine\n"
            "  To fix: --workers in place of --ray"
        )
