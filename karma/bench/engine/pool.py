"""Jobs done by several processes at once, each of which loads its own things first.

A job depends on nothing that another job leaves, so jobs can be dealt out in any way, and one whose
worker died can be done again.
"""

import logging
import multiprocessing
import os
import signal
import threading
import traceback
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Generic, Protocol, TypeVar

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Workshop(Generic[J, D]):
    """What processes need to know to do jobs; `begin` travels, the rest stays."""

    begin: Callable[[], Callable[[J], D]]  # loads, in each process; a function of a module
    imports: tuple[str, ...] = ()  # modules that are imported once for all


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
        """Put a dead worker's job in front again.

        Args:
            job: what the worker was doing.
            cause: what became of the worker.

        Raises:
            WorkerLost: the job has cost `LIVES` workers.
        """
        self._deaths[job.key] += 1
        name = "/".join(map(str, job.key))
        _log.warning("a worker was %s in episode %s", cause, name)
        if self._deaths[job.key] >= LIVES:
            raise WorkerLost(name, f"{LIVES} workers died of it, the last was {cause}")
        self.jobs.appendleft(job)


def in_processes(shop: Workshop[J, D], jobs: Sequence[J], number: int) -> Iterator[D]:
    """Do the jobs in `number` processes; yields what each leaves as it is done.

    A worker that dies is replaced, and its job done once more.

    Raises:
        KarmaError: a worker cannot load its things, or says that the run must end; or a job takes
            the next worker with it, too.
    """
    pool = _Pool(shop, jobs)
    try:
        for _ in range(min(number, len(jobs))):
            pool.start_one()
        while pool.workers:
            yield from pool.round()
    finally:
        pool.end_all()


@dataclass(slots=True)
class _Worker(Generic[J]):
    """One process and the job that it is doing."""

    process: BaseProcess
    line: Connection
    job: J | None = None


class _Pool(Generic[J, D]):
    """The processes of a run, and the jobs that are left to do."""

    def __init__(self, shop: Workshop[J, D], jobs: Sequence[J]) -> None:
        self.workers: list[_Worker[J]] = []
        self._ending: list[_Worker[J]] = []
        self._shop, self._queue = shop, JobQueue(jobs)

    def start_one(self) -> None:
        """Start one more process."""
        context = forking(__name__, *self._shop.imports)
        ours, theirs = context.Pipe()
        arguments = (theirs, self._shop.begin, _settings())
        process = context.Process(target=_work, args=arguments, daemon=True)
        with starting(**_ONE_THREAD):
            process.start()
        theirs.close()
        self.workers.append(_Worker(process, ours))

    def round(self) -> Iterator[D]:
        """Wait until workers answer or die; give each its next job."""
        for line in wait([worker.line for worker in self.workers]):
            worker = next(one for one in self.workers if one.line is line)
            try:
                said: D | WorkerError | None = worker.line.recv()
            except (EOFError, ConnectionResetError):
                self._replace(worker)
                continue
            if isinstance(said, WorkerError):
                raise said.error()
            self._assign(worker)
            if said is not None:
                yield said

    def end_all(self) -> None:
        """End all processes; those in the middle of a job are killed."""
        for worker in self._ending:
            worker.process.join(_LEAVE_S)
        for worker in (*self._ending, *self.workers):
            worker.process.kill()
            worker.process.join()
            worker.line.close()
        self.workers.clear()

    def _assign(self, worker: _Worker[J]) -> None:
        """Give a worker its next job; tell it to end when none is left."""
        if self._queue.jobs:
            worker.job = self._queue.next_after(worker.job)
            with suppress(BrokenPipeError):  # it has just died; the next round will tell
                worker.line.send(worker.job)
        else:
            self.workers.remove(worker)
            self._ending.append(worker)
            worker.line.close()

    def _replace(self, worker: _Worker[J]) -> None:
        """Do a dead worker's job again; start another process."""
        self.workers.remove(worker)
        worker.process.join()
        worker.line.close()
        cause = cause_of(worker.process.exitcode)
        if worker.job is None:
            self._died_loading(cause)
            return
        self._queue.died(worker.job, cause)
        if self._queue.jobs:
            self.start_one()

    def _died_loading(self, cause: str) -> None:
        if not self.workers:
            raise KarmaError(
                f"a worker was {cause} while it loaded its models\n"
                "  To fix: the same command with fewer workers goes on, e.g. --workers 1"
            )
        _log.warning("a worker was %s while it loaded its models; going on with fewer", cause)


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


def _work(
    line: Connection, begin: Callable[[], Callable[[J], D]], settings: Mapping[str, str]
) -> None:
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
