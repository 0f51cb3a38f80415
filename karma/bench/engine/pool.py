"""Chains done by several workers at once, each of which loads its models first.

Workers are processes of this machine; a plug-in brings others, such as actors of a Ray cluster.
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
from typing import Any, Protocol, TypeVar

from karma.bench.engine.suite import Chain, Do, Done
from karma.errors import KarmaError, WorkerLost
from karma.journal.records import Key
from karma.offline.children import forking, starting

LIVES = 2  # workers that a chain may kill before it is given up
_LEAVE_S = 10.0  # that a worker has to put things away
_ONE_THREAD = dict.fromkeys(  # libraries read this on import
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"), "1"
)
_log = logging.getLogger(__name__)


W = TypeVar("W", bound=Hashable)  # a worker
Begin = Callable[[], Do]  # loads, where a worker is


def sendable(error: Exception) -> Exception:
    """Return why a worker cannot go on, as it can be sent; a bug brings its traceback."""
    if isinstance(error, KarmaError):
        return KarmaError(str(error))
    return RuntimeError("".join(traceback.format_exception(error)))


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

    def send(self, worker: W, chain: Chain) -> None:
        """Have a worker that has answered do a chain."""

    def answer(self, workers: Collection[W]) -> tuple[W, Any]:
        """Wait for one of the workers; returns what it answers, an error, or `Died`."""

    def dismiss(self, worker: W) -> None:
        """Have a worker end for which no chain is left."""

    def end(self, workers: Collection[W]) -> None:
        """End these workers, also in the middle of a chain, and all that were dismissed."""


class ChainQueue:
    """The chains that are left to do, and how many workers each has cost."""

    def __init__(self, chains: Iterable[Chain]) -> None:
        self.chains = deque(chains)
        self._deaths: Counter[Key] = Counter()

    def next_after(self, last: Chain | None) -> Chain:
        """Return the next chain: one that shares something with a worker's last, or the first."""
        shares = last.shares if last is not None else ""
        if shares and (near := next((one for one in self.chains if one.shares == shares), None)):
            self.chains.remove(near)
            return near
        return self.chains.popleft()

    def died(self, chain: Chain, cause: str) -> None:
        """Put a dead worker's chain in front again; WorkerLost if it has cost `LIVES` workers."""
        self._deaths[chain.key] += 1
        name = "/".join(map(str, chain.key))
        _log.warning("a worker was %s in episode %s", cause, name)
        if self._deaths[chain.key] >= LIVES:
            raise WorkerLost(name, f"{LIVES} workers died of it, the last was {cause}")
        self.chains.appendleft(chain)


def done_by(workers: Workers[W], chains: Sequence[Chain], number: int) -> Iterator[Any]:
    """Do the chains with so many workers; yields what each leaves as it is done.

    A worker that dies is replaced, and its chain done once more.

    Raises:
        KarmaError: a worker cannot load its things, or says that the run must end; or a chain takes
            the next worker with it, too.
    """
    queue = ChainQueue(chains)
    doing: dict[W, Chain | None] = {}  # None: it loads
    try:
        for _ in range(min(number, len(chains))):
            doing[workers.start()] = None
        while doing:
            worker, answer = workers.answer(tuple(doing))
            chain = doing.pop(worker)
            if isinstance(answer, Died):
                _replace(workers, doing, queue, chain, answer)
                continue
            if isinstance(answer, Exception):
                raise answer
            if queue.chains:
                following = doing[worker] = queue.next_after(chain)
                workers.send(worker, following)
            else:
                for idle in (worker, *(one for one, its in tuple(doing.items()) if its is None)):
                    doing.pop(idle, None)
                    workers.dismiss(idle)
            if chain is not None:
                yield answer
    finally:
        workers.end(tuple(doing))


def _replace(
    workers: Workers[W],
    doing: dict[W, Chain | None],
    queue: ChainQueue,
    chain: Chain | None,
    died: Died,
) -> None:
    """Have a dead worker's chain done again; one that died of loading is missed only if alone."""
    if chain is not None:
        queue.died(chain, died.cause)
        if queue.chains:
            doing[workers.start()] = None
    elif doing:
        _log.warning("a worker was %s while it loaded its models; going on with fewer", died.cause)
    else:
        raise KarmaError(workers.unloaded.format(died))


# ----------------------------------------------------------------- processes


def in_processes(
    begin: Begin, chains: Sequence[Chain], number: int, imports: Sequence[str]
) -> Iterator[Sequence[Done]]:
    """Do the chains in `number` processes, see `done_by`.

    `begin` is a function of a module; `imports` are modules that are imported once for all.
    """
    return done_by(_Processes(begin, imports), chains, number)


@dataclass(frozen=True, slots=True, eq=False)
class _Worker:
    process: BaseProcess
    line: Connection


class _Processes:
    """Worker processes of this machine, see `Workers`."""

    unloaded = (
        "a worker was {0.cause} while it loaded its models\n"
        "  To fix: the same command with fewer workers goes on, e.g. --workers 1"
    )

    def __init__(self, begin: Begin, imports: Sequence[str]) -> None:
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

    def send(self, worker: _Worker, chain: Chain) -> None:
        with suppress(BrokenPipeError):  # it has just died; its next answer will tell
            worker.line.send(chain)

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


def _work(line: Connection, begin: Begin, settings: Mapping[str, str]) -> None:
    """What a worker process does: load, say that it is ready, then one chain after the other."""
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
        line.send(sendable(error))


def _follow_parent() -> None:
    """End with the run, also when that was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
