"""Doing the episodes: in this process or in several at once, each with models of its own.

An episode depends on its row, task and seed only, never on the process that does it or on earlier
ones. So episodes can be dealt out in any way, and one whose worker died can be done again.
"""

import logging
import multiprocessing
import os
import signal
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from karma import registry
from karma.bench.days import Days
from karma.bench.episode import TimeLog, run_episode
from karma.bench.experiment import Models, Row, for_row, load_resources
from karma.bench.records import EpisodeRecord, EpisodeTiming, Key
from karma.bench.run_folder import Finished
from karma.bench.steps import StepLog
from karma.contracts import Method, Resources, SceneRef, Task, VisionModel, World
from karma.errors import KarmaError
from karma.infer.hosted.cassette import Cassette, Tape
from karma.infer.hosted.session import Hosted, Session
from karma.infer.llama.room_states import StateOptions
from karma.methods.tour import explore_room
from karma.offline import go_offline, settle
from karma.world.home import Home

MAPS = "maps"  # below the run folder
PICTURES = {"renderDepthImage": True, "renderInstanceSegmentation": True}  # AI2-THOR's flags
LIVES = 2  # workers that an episode may kill before it is recorded as an error
_LEAVE_S = 10.0  # that a worker has to put things away
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS")


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


_log = logging.getLogger(__name__)


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

    def do(self, job: Job) -> Finished:
        """Do one episode."""
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
        except KarmaError:  # the episode will record why
            return
        graph.save(path)


def world_maker(name: str, options: Iterable[Mapping[str, Any]]) -> Callable[[], World]:
    """Return what makes a run's worlds: with depth and instance masks where a row looks at them.

    Args:
        name: of the world.
        options: of the rows.
    """
    make: Callable[..., World] = registry.load("worlds", name)
    looks = any(one.get("perception") == "pictures" for one in options)
    return partial(make, **PICTURES) if looks else make


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
) -> Iterator[Finished]:
    """Do the episodes in this process, in their order."""
    performer = Performer(stage, session)
    for job in jobs:
        yield performer.do(job)


# ----------------------------------------------------------------- several processes


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerError:
    """Why a worker cannot go on, which ends the run."""

    text: str
    known: bool  # an error of karma's own, which says what helps; else a bug, with its traceback

    @classmethod
    def of(cls, error: Exception) -> "WorkerError":
        """Return an error as it can be sent."""
        if isinstance(error, KarmaError):
            return cls(text=str(error), known=True)
        return cls(text="".join(traceback.format_exception(error)), known=False)

    def error(self) -> Exception:
        """Return the error to raise here."""
        return KarmaError(self.text) if self.known else RuntimeError(self.text)


@dataclass(slots=True)
class _Worker:
    """One process and the episode that it is doing."""

    process: BaseProcess
    line: Connection
    job: Job | None = None


def perform_in_processes(stage: Stage, jobs: Sequence[Job], number: int) -> Iterator[Finished]:
    """Do the episodes in `number` processes; yields each as it is done.

    A worker that dies is replaced. Its episode is done once more, and recorded as an error if it
    takes the next worker with it.

    Raises:
        KarmaError: a worker cannot load its models, or says that the run must end.
    """
    pool = _Pool(stage, jobs)
    try:
        for _ in range(min(number, len(jobs))):
            pool.start_one()
        while pool.workers:
            yield from pool.round()
    finally:
        pool.end_all()


class JobQueue:
    """The episodes that are left to do, and how many workers each has cost."""

    def __init__(self, jobs: Iterable[Job]) -> None:
        self.jobs = deque(jobs)
        self._deaths: Counter[Key] = Counter()

    def died(self, job: Job, cause: str) -> Iterator[Finished]:
        """Put a dead worker's episode in front again; yield it as lost if it cost `LIVES` workers.

        Args:
            job: what the worker was doing.
            cause: what became of the worker.
        """
        self._deaths[job.key] += 1
        _log.warning("a worker was %s in episode %s", cause, "/".join(map(str, job.key)))
        if self._deaths[job.key] < LIVES:
            self.jobs.appendleft(job)
        else:
            yield lost_episode(job, cause)


class _Pool:
    """The processes of a run, and the episodes that are left to do."""

    def __init__(self, stage: Stage, jobs: Sequence[Job]) -> None:
        self.workers: list[_Worker] = []
        self._ending: list[_Worker] = []
        self._stage, self._queue = stage, JobQueue(jobs)

    def start_one(self) -> None:
        """Start one more process."""
        forking = multiprocessing.get_context("forkserver")
        forking.set_forkserver_preload(_imported(self._stage.models))
        ours, theirs = forking.Pipe()
        process = forking.Process(target=_work, args=(theirs, self._stage), daemon=True)
        with _one_thread():
            process.start()
        theirs.close()
        self.workers.append(_Worker(process, ours))

    def round(self) -> Iterator[Finished]:
        """Wait until workers answer or die; give each its next episode."""
        for line in wait([worker.line for worker in self.workers]):
            worker = next(one for one in self.workers if one.line is line)
            try:
                said: Finished | WorkerError | None = worker.line.recv()
            except (EOFError, ConnectionResetError):
                yield from self._replace(worker)
                continue
            if isinstance(said, WorkerError):
                raise said.error()
            self._assign(worker)
            if said is not None:
                yield said

    def end_all(self) -> None:
        """End all processes; those in the middle of an episode are killed."""
        for worker in self._ending:
            worker.process.join(_LEAVE_S)
        for worker in (*self._ending, *self.workers):
            worker.process.kill()
            worker.process.join()
            worker.line.close()
        self.workers.clear()

    def _assign(self, worker: _Worker) -> None:
        """Give a worker its next episode; tell it to end when none is left."""
        if self._queue.jobs:
            worker.job = self._queue.jobs.popleft()
            with suppress(BrokenPipeError):  # it has just died; the next round will tell
                worker.line.send(worker.job)
        else:
            self.workers.remove(worker)
            self._ending.append(worker)
            worker.line.close()

    def _replace(self, worker: _Worker) -> Iterator[Finished]:
        """Do a dead worker's episode again, or yield it as lost; start another process."""
        self.workers.remove(worker)
        worker.process.join()
        worker.line.close()
        cause = cause_of(worker.process.exitcode)
        if worker.job is None:
            self._died_loading(cause)
            return
        yield from self._queue.died(worker.job, cause)
        if self._queue.jobs:
            self.start_one()

    def _died_loading(self, cause: str) -> None:
        if not self.workers:
            raise KarmaError(
                f"a worker was {cause} while it loaded its models\n"
                "  To fix: the same command with fewer workers goes on, e.g. --workers 1"
            )
        _log.warning("a worker was %s while it loaded its models; going on with fewer", cause)


def _imported(models: Models) -> list[str]:
    """Return what is imported once for all workers: what their models take, and no more."""
    hosted = models.hosted
    needed = {
        "llama_cpp": hosted.planner is None,
        "sentence_transformers": hosted.embedder is None,
        "openai": hosted != Hosted(),
    }
    return [__name__, *(name for name, wanted in needed.items() if wanted)]


def cause_of(code: int | None) -> str:
    """Return what became of a process.

    >>> cause_of(1)
    'ended with code 1'
    """
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        memory = ", as happens when memory runs out" if -code == signal.SIGKILL else ""
        return f"killed by {name}{memory}"
    return f"ended with code {code}"


def lost_episode(job: Job, cause: str) -> Finished:
    """Return the record of an episode that kills every worker that does it."""
    record = EpisodeRecord(
        row=job.row,
        task=job.task.id,
        kind=job.task.kind,
        scene=job.task.scenes[0].name,
        seed=job.seed,
        notes=job.task.notes,
        subtasks=(),
        error=f"WorkerLost: {LIVES} workers died of it, the last was {cause}",
    )
    timing = EpisodeTiming(row=record.row, task=record.task, seed=record.seed, subtasks=())
    return Finished(record=record, timing=timing)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let processes started in here compute on one thread each; libraries read this on import."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _work(line: Connection, stage: Stage) -> None:
    """What a worker process does: load, say that it is ready, then one episode after the other."""
    go_offline(allow_network=stage.network)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the run, which ends its workers
    threading.Thread(target=_follow_parent, daemon=True).start()
    try:
        performer = Performer(stage, Session(Cassette.of(stage.tape)))
        line.send(None)
        while True:
            line.send(performer.do(line.recv()))
    except (EOFError, BrokenPipeError):
        return
    except Exception as error:  # noqa: BLE001  it is raised where the run is
        line.send(WorkerError.of(error))


def _follow_parent() -> None:
    """End with the run, also when that was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
