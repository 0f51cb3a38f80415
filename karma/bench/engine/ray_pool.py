"""Jobs done on the machines of a Ray cluster that is there already, as `pool` does in processes.

Every node has this package and its own files, and says so itself when it lacks something: what a
worker begins with travels, and looks for them there. What jobs leave comes back here.
"""

import logging
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic

from karma.bench.engine.pool import Begin, D, Died, J, WorkerError, done_by
from karma.errors import KarmaError
from karma.offline.guard import allow_host, go_offline, is_local, network_allowed

_CAUSE = "lost with its node or killed, as happens when memory runs out"


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerNeed:
    """What one worker takes of its node."""

    cores: int
    memory_mb: float

    def workers(self, cores: float, memory_bytes: float) -> int:
        """Return how many workers there is room for."""
        return int(min(cores // self.cores, memory_bytes // (self.memory_mb * 1e6)))


def in_cluster(
    begin: Begin[J, D], jobs: Sequence[J], address: str, *, need: WorkerNeed, number: int = 0
) -> Iterator[D]:
    """Do the jobs on a cluster with so many workers, 0 for as many as it has room for.

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
    workers = _Actors(ray, begin, need)
    yield from done_by(workers, jobs, number or _room(ray, need))


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


class _Actors(Generic[J, D]):
    """Workers on a cluster, see `Workers`; each is named by its actor."""

    unloaded = "no worker could be started on the cluster: {0.why}"

    def __init__(self, ray: Any, begin: Begin[J, D], need: WorkerNeed) -> None:
        self._ray, self._begin = ray, begin
        self._pending: dict[Any, Any] = {}  # actor -> its pending answer
        options = {
            "num_cpus": need.cores,
            "memory": int(need.memory_mb * 1e6),
            "max_restarts": 0,
            "max_task_retries": 0,
        }
        self._kind = ray.remote(**options)(NodeWorker)

    def start(self) -> Any:
        """Start a worker on a node that has room."""
        actor = self._kind.remote()
        self._pending[actor] = actor.load.remote(self._begin)
        return actor

    def send(self, worker: Any, job: J) -> None:
        self._pending[worker] = worker.do.remote(job)

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
    """Does jobs on one node."""

    def __init__(self) -> None:
        self._do: Callable[[Any], Any] | None = None

    def load(self, begin: Begin[Any, Any]) -> Any:
        """Load what jobs need, or say what this node has not."""

        def load() -> None:
            go_offline()
            self._do = begin()

        return _or_error(load)

    def do(self, job: Any) -> Any:
        """Do one job; returns what it leaves, or why the run must end."""
        assert self._do is not None, "load first"
        return _or_error(partial(self._do, job))


def _or_error(call: Callable[[], Any]) -> Any:
    try:
        return call()
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
