"""Jobs done on the machines of a Ray cluster that is there already, as `pool` does in processes.

Every node has this package and its own files, and says so itself when it lacks something: what a
worker begins with travels, and looks for them there. What jobs leave comes back here.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from karma.bench.engine.pool import J, JobQueue, WorkerError, Workshop
from karma.errors import KarmaError
from karma.offline.guard import allow_host, go_offline, is_local, network_allowed

_CAUSE = "lost with its node or killed, as happens when memory runs out"
_log = logging.getLogger(__name__)
D = TypeVar("D")  # what a job leaves


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerNeed:
    """What one worker takes of its node."""

    cores: int
    memory_mb: float

    def workers(self, cores: float, memory_bytes: float) -> int:
        """Return how many workers there is room for."""
        return int(min(cores // self.cores, memory_bytes // (self.memory_mb * 1e6)))


def in_cluster(
    shop: Workshop[J, D], jobs: Sequence[J], address: str, *, need: WorkerNeed, number: int = 0
) -> Iterator[D]:
    """Do the jobs on a cluster; yields what each leaves as it is done.

    A worker that dies is replaced, and its job done once more.

    Args:
        shop: its `begin` travels to the nodes, and looks there for what it needs.
        jobs: in any order.
        address: of the cluster's head, HOST:PORT.
        need: of each worker.
        number: workers; 0 for as many as the cluster has room for.

    Raises:
        KarmaError: Ray is not installed, the address may not or cannot be reached, a node does not
            have what is needed, or a job takes two workers with it.
    """
    ray = _ray()
    _check_leave(host_of(address))
    try:
        ray.init(
            address=address, log_to_driver=False, logging_level=logging.ERROR,
            job_config=_nothing_of_this_folder(ray),
        )  # fmt: skip
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        raise KarmaError(
            f"no Ray cluster answers at {address}: {error}\n"
            "  To fix: start one (`ray start --head`, on other machines `ray start --address`), "
            "and run this on one of its machines"
        ) from error
    pool = _RayPool(ray, shop, jobs, need)
    try:
        for _ in range(min(number or _room(ray, need), len(jobs))):
            pool.start_one()
        while pool.waiting:
            yield from pool.round()
    finally:
        pool.end_all()
        ray.shutdown()


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


@dataclass(slots=True)
class _RayWorker(Generic[J]):
    """One worker and the job that it is doing."""

    actor: Any
    job: J | None = None


class _RayPool(Generic[J, D]):
    """The workers on a cluster, and the jobs that are left to do."""

    def __init__(self, ray: Any, shop: Workshop[J, D], jobs: Sequence[J], need: WorkerNeed) -> None:
        self.waiting: dict[Any, _RayWorker[J]] = {}  # pending answer -> its worker
        self._ray, self._begin = ray, shop.begin
        self._queue = JobQueue(jobs)
        options = {
            "num_cpus": need.cores,
            "memory": int(need.memory_mb * 1e6),
            "max_restarts": 0,
            "max_task_retries": 0,
        }
        self._kind = ray.remote(**options)(NodeWorker)

    def start_one(self) -> None:
        """Start one more worker, on a node that has room."""
        worker: _RayWorker[J] = _RayWorker(self._kind.remote())
        self.waiting[worker.actor.load.remote(self._begin)] = worker

    def round(self) -> Iterator[D]:
        """Wait for one answer; give that worker its next job, or end it when none is left."""
        (ready, *_), _ = self._ray.wait(list(self.waiting), num_returns=1)
        worker = self.waiting.pop(ready)
        try:
            said: D | WorkerError | None = self._ray.get(ready)
        except self._ray.exceptions.RayActorError as error:
            self._replace(worker, error)
            return
        if isinstance(said, WorkerError):
            raise said.error()
        if self._queue.jobs:
            worker.job = self._queue.next_after(worker.job)
            self.waiting[worker.actor.do.remote(worker.job)] = worker
        else:
            self._ray.kill(worker.actor)
            self._end_idle()
        if said is not None:
            yield said

    def end_all(self) -> None:
        """End all workers, also in the middle of a job."""
        for worker in self.waiting.values():
            self._ray.kill(worker.actor)
        self.waiting.clear()

    def _end_idle(self) -> None:
        """End the workers that have no job yet: none is left for them."""
        for answer, worker in list(self.waiting.items()):
            if worker.job is None:
                del self.waiting[answer]
                self._ray.kill(worker.actor)

    def _replace(self, worker: _RayWorker[J], error: Exception) -> None:
        """Do a dead worker's job again; start another worker."""
        if worker.job is None:
            if not self.waiting:
                raise KarmaError(f"no worker could be started on the cluster: {error}") from error
            _log.warning("a worker was %s while it loaded its models", _CAUSE)
            return
        self._queue.died(worker.job, _CAUSE)
        if self._queue.jobs:
            self.start_one()


def _nothing_of_this_folder(ray: Any) -> Any:
    """Return the setting of a job whose workers do not import what lies in the current folder."""
    return ray.job_config.JobConfig(_client_job=True)  # Ray adds it for all other jobs


class NodeWorker:
    """Does jobs on one node."""

    def __init__(self) -> None:
        self._do: Callable[[Any], Any] | None = None

    def load(self, begin: Callable[[], Callable[[Any], Any]]) -> WorkerError | None:
        """Load what jobs need, or say what this node has not."""
        try:
            go_offline()
            self._do = begin()
        except Exception as error:  # noqa: BLE001  it is raised where the run is
            return WorkerError.of(_at_node(error))
        return None

    def do(self, job: Any) -> Any:
        """Do one job; returns what it leaves, or why the run must end."""
        if self._do is None:
            raise RuntimeError("load first")
        try:
            return self._do(job)
        except Exception as error:  # noqa: BLE001  it is raised where the run is
            return WorkerError.of(_at_node(error))


def _at_node(error: Exception) -> Exception:
    """Return an error that says where it happened."""
    if not isinstance(error, KarmaError):
        return error
    return KarmaError(f"node {_ray().util.get_node_ip_address()}: {error}")


def _room(ray: Any, need: WorkerNeed) -> int:
    """Return how many workers the cluster has cores and memory for, at least 1."""
    has = [node["Resources"] for node in ray.nodes() if node["Alive"]]
    return max(1, sum(need.workers(one.get("CPU", 0), one.get("memory", 0)) for one in has))


def _ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise KarmaError(
            f"--ray needs the package ray: {error}\n  To fix: pip install 'karma-offline[ray]'"
        ) from error
    return ray
