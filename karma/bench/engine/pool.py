"""Jobs done by several workers at once, each of which loads its own things first.

A job depends on nothing that another job leaves, so jobs can be dealt out in any way, and one whose
worker died can be done again. Here the workers are processes; `ray_pool` has those of a cluster.
"""

import logging
import multiprocessing
import os
import signal
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Generic, Protocol, TypeVar

from karma.errors import KarmaError, WorkerLost
from karma.offline.children import forking, starting

LIVES = 2  # workers that a job may kill before it is given up
_LEAVE_S = 10.0  # that a worker has to put things away
_ONE_THREAD = dict.fromkeys(  # libraries read this on import
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"), "1"
)
_log = logging.getLogger(__name__)


class _Keyed(Protocol):
    @property
    def key(self) -> tuple[Hashable, ...]:
        """What names the job."""

    @property
    def shares(self) -> str:
        """Jobs of the same word share what a worker computes; "" for none."""


J = TypeVar("J", bound=_Keyed)
D = TypeVar("D")  # what a job leaves
W = TypeVar("W", bound=Hashable)  # a worker
Begin = Callable[[], Callable[[J], D]]  # loads, where a worker is


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


@dataclass(frozen=True, slots=True)
class Died:
    """What became of a worker that does not answer any more."""

    cause: str
    why: str = ""  # in the words of what noticed it


class Workers(Protocol[W]):
    """How workers are reached."""

    unloaded: str  # the error where the last worker dies of loading; {0} is a `Died`

    def start(self) -> W:
        """Start a worker, which loads its things and then answers None."""

    def send(self, worker: W, job: Any) -> None:
        """Have a worker that has answered do a job."""

    def answer(self, workers: Collection[W]) -> tuple[W, Any]:
        """Wait for one of the workers; returns what it answers, a `WorkerError` or `Died`."""

    def dismiss(self, worker: W) -> None:
        """Have a worker end for which no job is left."""

    def end(self, workers: Collection[W]) -> None:
        """End these workers, also in the middle of a job, and all that were dismissed."""


class JobQueue(Generic[J]):
    """The jobs that are left to do, and how many workers each has cost."""

    def __init__(self, jobs: Iterable[J]) -> None:
        self.jobs = deque(jobs)
        self._deaths: Counter[tuple[Hashable, ...]] = Counter()

    def next_after(self, last: J | None) -> J:
        """Return a job to do next: one that shares something with a worker's last, or the first."""
        shares = last.shares if last is not None else ""
        if shares and (near := next((one for one in self.jobs if one.shares == shares), None)):
            self.jobs.remove(near)
            return near
        return self.jobs.popleft()

    def died(self, job: J, cause: str) -> None:
        """Put a dead worker's job in front again; WorkerLost if it has cost `LIVES` workers."""
        self._deaths[job.key] += 1
        name = "/".join(map(str, job.key))
        _log.warning("a worker was %s in episode %s", cause, name)
        if self._deaths[job.key] >= LIVES:
            raise WorkerLost(name, f"{LIVES} workers died of it, the last was {cause}")
        self.jobs.appendleft(job)


def done_by(workers: Workers[W], jobs: Sequence[J], number: int) -> Iterator[Any]:
    """Do the jobs with so many workers; yields what each leaves as it is done.

    A worker that dies is replaced, and its job done once more.

    Raises:
        KarmaError: a worker cannot load its things, or says that the run must end; or a job takes
            the next worker with it, too.
    """
    queue = JobQueue(jobs)
    doing: dict[W, J | None] = {}  # None: it loads
    try:
        for _ in range(min(number, len(jobs))):
            doing[workers.start()] = None
        while doing:
            worker, answer = workers.answer(tuple(doing))
            job = doing.pop(worker)
            if isinstance(answer, Died):
                _replace(workers, doing, queue, job, answer)
                continue
            if isinstance(answer, WorkerError):
                raise answer.error()
            if queue.jobs:
                doing[worker] = queue.next_after(job)
                workers.send(worker, doing[worker])
            else:
                for idle in (worker, *(one for one, its in tuple(doing.items()) if its is None)):
                    doing.pop(idle, None)
                    workers.dismiss(idle)
            if job is not None:
                yield answer
    finally:
        workers.end(tuple(doing))


def _replace(
    workers: Workers[W], doing: dict[W, J | None], queue: JobQueue[J], job: J | None, died: Died
) -> None:
    """Have a dead worker's job done again; one that died of loading is missed only if alone."""
    if job is not None:
        queue.died(job, died.cause)
        if queue.jobs:
            doing[workers.start()] = None
    elif doing:
        _log.warning("a worker was %s while it loaded its models; going on with fewer", died.cause)
    else:
        raise KarmaError(workers.unloaded.format(died))


# ----------------------------------------------------------------- processes


def in_processes(
    begin: Begin[J, D], jobs: Sequence[J], number: int, imports: Sequence[str] = ()
) -> Iterator[D]:
    """Do the jobs in `number` processes, see `done_by`.

    `begin` is a function of a module; `imports` are modules that are imported once for all.
    """
    return done_by(_Processes(begin, imports), jobs, number)


@dataclass(frozen=True, slots=True, eq=False)
class _Worker:
    process: BaseProcess
    line: Connection


class _Processes(Generic[J, D]):
    """Worker processes of this machine, see `Workers`."""

    unloaded = (
        "a worker was {0.cause} while it loaded its models\n"
        "  To fix: the same command with fewer workers goes on, e.g. --workers 1"
    )

    def __init__(self, begin: Begin[J, D], imports: Sequence[str]) -> None:
        self._begin, self._imports = begin, imports
        self._ending: list[_Worker] = []

    def start(self) -> _Worker:
        context = forking(__name__, *self._imports)
        ours, theirs = context.Pipe()
        arguments = (theirs, self._begin, _settings())
        process = context.Process(target=_work, args=arguments, daemon=True)
        with starting(**_ONE_THREAD):
            process.start()
        theirs.close()
        return _Worker(process, ours)

    def send(self, worker: _Worker, job: J) -> None:
        with suppress(BrokenPipeError):  # it has just died; its next answer will tell
            worker.line.send(job)

    def answer(self, workers: Collection[_Worker]) -> tuple[_Worker, Any]:
        ready = wait([worker.line for worker in workers])
        worker = next(one for one in workers if one.line is ready[0])
        try:
            return worker, worker.line.recv()
        except (EOFError, ConnectionResetError):
            worker.process.join()
            worker.line.close()
            return worker, Died(cause_of(worker.process.exitcode))

    def dismiss(self, worker: _Worker) -> None:
        self._ending.append(worker)
        worker.line.close()

    def end(self, workers: Collection[_Worker]) -> None:
        for worker in self._ending:
            worker.process.join(_LEAVE_S)
        for worker in (*self._ending, *workers):
            worker.process.kill()
            worker.process.join()
            worker.line.close()


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


def _settings() -> dict[str, str]:
    """Return what the environment says of karma: processes are forked from one that has the old."""
    return {name: value for name, value in os.environ.items() if name.startswith("KARMA_")}


def _work(line: Connection, begin: Begin[J, D], settings: Mapping[str, str]) -> None:
    """What a worker process does: load, say that it is ready, then one job after the other."""
    for name in _settings():
        del os.environ[name]
    os.environ.update(settings)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the run, which ends its workers
    threading.Thread(target=_follow_parent, daemon=True).start()
    try:
        do = begin()
        line.send(None)
        while True:
            line.send(do(line.recv()))
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
