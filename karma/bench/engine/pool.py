"""Chains done by several workers at once, each of which loads its own things first.

A worker is a process of this machine, or an actor of a Ray cluster that is there already. Every
node of it has this package and its own files, and says so itself when it lacks something: what a
worker begins with travels, and looks for them there. What episodes leave comes back here.
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
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, TypeVar

from karma.agent.journal.records import Key
from karma.bench.engine.suite import Chain, Do, Done
from karma.errors import KarmaError, WorkerLost
from karma.offline.children import forking, starting
from karma.offline.guard import allow_host, go_offline, is_local, network_allowed

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


# ----------------------------------------------------------------- a Ray cluster


_CAUSE = "lost with its node or killed, as happens when memory runs out"


def in_cluster(
    begin: Begin, chains: Sequence[Chain], number: int, address: str, cores: int, memory_mb: float
) -> Iterator[Sequence[Done]]:
    """Do the chains on a cluster with so many workers, 0 for as many as it has room for.

    A worker takes so many cores and so much memory of its node.

    `begin` travels to the nodes, and looks there for what it needs; the address is of the cluster's
    head, HOST:PORT.

    Raises:
        KarmaError: as `done_by`; or Ray is not installed, the address may not or cannot be reached,
            or a node does not have what is needed.
    """
    ray = _ray()
    _check_leave(host_of(address))
    try:
        ray.init(
            address=address, log_to_driver=False, logging_level=logging.ERROR,
            # workers that import nothing of the current folder, which Ray adds for all other jobs
            job_config=ray.job_config.JobConfig(_client_job=True),
        )  # fmt: skip
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        raise KarmaError(
            f"no Ray cluster answers at {address}: {error}\n"
            "  To fix: start one (`ray start --head`, on other machines `ray start --address`), "
            "and run this on one of its machines"
        ) from error
    memory = memory_mb * 1e6
    alive = [node["Resources"] for node in ray.nodes() if node["Alive"]]
    room = sum(
        int(min(has.get("CPU", 0) // cores, has.get("memory", 0) // memory)) for has in alive
    )
    actors = _Actors(ray, begin, num_cpus=cores, memory=int(memory))
    yield from done_by(actors, chains, number or max(1, room))


def host_of(address: str) -> str:
    """Return the host of an address.

    >>> host_of("127.0.0.1:6379"), host_of("ray://[::1]:10001")
    ('127.0.0.1', '::1')

    Raises:
        KarmaError: it is none.
    """
    place = address.rpartition("://")[2]
    host, colon, port = place.rpartition(":")
    if not host or not colon or not port.isdigit():
        raise KarmaError(
            f"{address!r} is no address of a Ray cluster\n  To fix: --ray HOST:PORT, as `ray start`"
            " prints it"
        )
    return host.strip("[]")


def _check_leave(host: str) -> None:
    """Raise KarmaError where a cluster is on another machine and the run is offline."""
    if not is_local(host) and not network_allowed():
        raise KarmaError(
            f"the Ray cluster at {host!r} is on another machine, and this run is offline\n"
            "  To fix: `karma --allow-network eval ...`"
        )
    allow_host(host)


class _Actors:
    """Workers on a cluster, see `Workers`; each is named by its actor."""

    unloaded = "no worker could be started on the cluster: {0.why}"

    def __init__(self, ray: Any, begin: Begin, **need: int) -> None:
        self._ray, self._begin = ray, begin
        self._pending: dict[Any, Any] = {}  # actor -> its pending answer
        self._kind = ray.remote(max_restarts=0, max_task_retries=0, **need)(NodeWorker)

    def start(self) -> Any:
        """Start a worker on a node that has room."""
        actor = self._kind.remote()
        self._pending[actor] = actor.load.remote(self._begin)
        return actor

    def send(self, worker: Any, chain: Chain) -> None:
        self._pending[worker] = worker.do.remote(chain)

    def answer(self, workers: Collection[Any]) -> tuple[Any, Any]:
        pending = {self._pending[worker]: worker for worker in workers}
        (ready, *_), _ = self._ray.wait(list(pending), num_returns=1)
        try:
            return pending[ready], self._ray.get(ready)
        except self._ray.exceptions.RayActorError as error:
            return pending[ready], Died(_CAUSE, str(error))

    def dismiss(self, worker: Any) -> None:
        self._ray.kill(worker)

    def end(self, workers: Collection[Any]) -> None:
        for worker in workers:
            self._ray.kill(worker)
        self._ray.shutdown()


class NodeWorker:
    """Does chains on one node."""

    def load(self, begin: Begin) -> Any:
        """Load what chains need, or say what this node has not."""

        def load() -> None:
            go_offline()
            self._do = begin()

        return _or_error(load)

    def do(self, chain: Chain) -> Any:
        """Do one chain; returns what it leaves, or why the run must end."""
        return _or_error(partial(self._do, chain))


def _or_error(call: Callable[[], Any]) -> Any:
    try:
        return call()
    except Exception as error:  # noqa: BLE001  it is raised where the run is
        return sendable(_at_node(error))


def _at_node(error: Exception) -> Exception:
    """Return an error that says where it happened."""
    if not isinstance(error, KarmaError):
        return error
    return KarmaError(f"node {_ray().util.get_node_ip_address()}: {error}")


def _ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise KarmaError(
            f"--ray needs the package ray: {error}\n  To fix: pip install 'karma-offline[ray]'"
        ) from error
    return ray
