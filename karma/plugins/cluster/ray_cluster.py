"""Workers on a Ray cluster that is there already: each is an actor on one of its nodes."""

import logging
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from typing import Any

from karma.bench.engine.pool import Begin, Died, done_by, sendable
from karma.bench.engine.suite import Chain, Done, Suite
from karma.bench.engine.workers import worker_mb
from karma.errors import KarmaError
from karma.offline.guard import allow_host, go_offline, is_local, network_allowed
from karma.plugins.cluster.node import DataFolders, begin_on_node

_CAUSE = "lost with its node or killed, as happens when memory runs out"


def in_cluster(
    suite: Suite, chains: Sequence[Chain], number: int, address: str, header: Any
) -> Iterator[Sequence[Done]]:
    """Run the chains on a cluster with `number` workers, 0 for as many as it has room for.

    The suite travels to the nodes, which look for its files and models there; the address is of the
    cluster's head, HOST:PORT.

    Raises:
        KarmaError: as `done_by`; or Ray is not installed, the address may not or cannot be reached,
            or a node does not have what is needed.
    """
    ray, models = _ray(), suite.models
    begin = partial(begin_on_node, suite, header, DataFolders.here())
    cores, memory_mb = max(1, models.threads), worker_mb(models, suite.rows)
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
            f"--ray needs the package ray: {error}\n  To fix: pip install 'karma-offline[cluster]'"
        ) from error
    return ray
