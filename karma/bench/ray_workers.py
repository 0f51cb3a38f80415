"""Episodes on the machines of a Ray cluster that is there already.

Every node has this package and its own models, which are found by their SHA-256; nothing but the
tasks and imported floor plans travels. A node that has another model, version, prompt or scene than
the run says so by name, and the run ends. What an episode leaves comes back with its record, so the
run's folder lies on one machine only.
"""

import logging
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from karma.bench.experiment import Models, Row
from karma.bench.experiment_tasks import scene_path
from karma.bench.pool import JobQueue, WorkerError
from karma.bench.provenance import (
    model_hashes,
    parts_of_planner,
    prompt_hashes,
    scene_hashes,
    versions,
)
from karma.bench.run_folder import Finished, Header, differences
from karma.bench.worker_count import worker_mb
from karma.bench.workers import Job, Performer, Stage, lost_episode
from karma.contracts import SceneRef
from karma.errors import FileError, KarmaError, ModelError, UnknownNameError
from karma.files import write_atomic
from karma.infer.manifest.manifest import read_manifest, resolve_planner
from karma.offline import allow_host, go_offline, is_local, network_allowed
from karma.tasks.files import in_rooms

_CAUSE = "lost with its node or killed, as happens when memory runs out"
_log = logging.getLogger(__name__)


def perform_on_ray(
    stage: Stage,
    jobs: Sequence[Job],
    address: str,
    *,
    header: Header,
    scenes: Mapping[str, bytes],
    number: int = 0,
) -> Iterator[Finished]:
    """Do the episodes on a cluster; yields each as it is done.

    Args:
        stage: what workers need to know; its folder stays here.
        jobs: the episodes.
        address: of the cluster's head, HOST:PORT.
        header: what the run depends on, held against every node.
        scenes: imported floor plans, which travel.
        number: workers; 0 for as many as the cluster has cores and memory for.

    Raises:
        KarmaError: Ray is not installed, the address may not or cannot be reached, or a node does
            not have what the run depends on.
    """
    ray = _ray()
    _check_leave(host_of(address))
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        raise KarmaError(
            f"no Ray cluster answers at {address}: {error}\n"
            "  To fix: start one (`ray start --head`, on other machines `ray start --address`), "
            "and run this on one of its machines"
        ) from error
    pool = _RayPool(ray, stage, jobs, header, scenes)
    try:
        for _ in range(min(number or _room(ray, stage.models), len(jobs))):
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
class _RayWorker:
    """One worker and the episode that it is doing."""

    actor: Any
    job: Job | None = None


class _RayPool:
    """The workers on a cluster, and the episodes that are left to do."""

    def __init__(
        self,
        ray: Any,
        stage: Stage,
        jobs: Sequence[Job],
        header: Header,
        scenes: Mapping[str, bytes],
    ) -> None:
        self.waiting: dict[Any, _RayWorker] = {}  # pending answer -> its worker
        self._ray, self._queue = ray, JobQueue(jobs, lost_episode)
        self._briefing = (stage, header, dict(scenes))
        options = {
            "num_cpus": max(1, stage.models.threads),
            "memory": int(worker_mb(stage.models, stage.rows) * 1e6),
            "max_restarts": 0,
            "max_task_retries": 0,
        }
        self._kind = ray.remote(**options)(NodeWorker)

    def start_one(self) -> None:
        """Start one more worker, on a node that has room."""
        worker = _RayWorker(self._kind.remote())
        self.waiting[worker.actor.load.remote(*self._briefing)] = worker

    def round(self) -> Iterator[Finished]:
        """Wait for one answer; give that worker its next episode, or end it when none is left."""
        (ready, *_), _ = self._ray.wait(list(self.waiting), num_returns=1)
        worker = self.waiting.pop(ready)
        try:
            said: Finished | WorkerError | None = self._ray.get(ready)
        except self._ray.exceptions.RayActorError as error:
            yield from self._replace(worker, error)
            return
        if isinstance(said, WorkerError):
            raise said.error()
        if self._queue.jobs:
            worker.job = self._queue.jobs.popleft()
            self.waiting[worker.actor.do.remote(worker.job)] = worker
        else:
            self._ray.kill(worker.actor)
            self._end_idle()
        if said is not None:
            yield said

    def end_all(self) -> None:
        """End all workers, also in the middle of an episode."""
        for worker in self.waiting.values():
            self._ray.kill(worker.actor)
        self.waiting.clear()

    def _end_idle(self) -> None:
        """End the workers that have no episode yet: none is left for them."""
        for answer, worker in list(self.waiting.items()):
            if worker.job is None:
                del self.waiting[answer]
                self._ray.kill(worker.actor)

    def _replace(self, worker: _RayWorker, error: Exception) -> Iterator[Finished]:
        """Do a dead worker's episode again, or yield it as lost; start another worker."""
        if worker.job is None:
            if not self.waiting:
                raise KarmaError(f"no worker could be started on the cluster: {error}") from error
            _log.warning("a worker was %s while it loaded its models", _CAUSE)
            return
        yield from self._queue.died(worker.job, _CAUSE)
        if self._queue.jobs:
            self.start_one()


class NodeWorker:
    """Does episodes on one node, in a folder of its own."""

    def __init__(self) -> None:
        self._performer: Performer | None = None
        self._there = Path()  # the run's folder, on another machine
        self._here = Path()
        self._sent: set[str] = set()

    def load(self, stage: Stage, header: Header, scenes: dict[str, bytes]) -> WorkerError | None:
        """Check that this node has what the run depends on, and load it."""
        try:
            go_offline()
            self._there = stage.folder
            self._here = Path(tempfile.mkdtemp(prefix="karma-run-"))
            for name, data in scenes.items():
                write_atomic(scene_path(self._here, name), data)
            models = models_here(stage.models, header.models)
            check_node(header, models, scenes, stage.rows)
            self._performer = Performer(replace(stage, folder=self._here, models=models))
        except Exception as error:  # noqa: BLE001  it is raised where the run is
            return WorkerError.of(_at_node(error))
        return None

    def do(self, job: Job) -> Finished | WorkerError:
        """Do one episode; what it leaves goes with it."""
        if self._performer is None:
            raise RuntimeError("load first")
        job = replace(job, task=in_rooms(job.task, self._place))
        try:
            one = self._performer.do(job)
        except Exception as error:  # noqa: BLE001  it is raised where the run is
            return WorkerError.of(_at_node(error))
        said = one.record.error.replace(str(self._here), str(self._there))
        return replace(one, record=replace(one.record, error=said), files=self._new_files())

    def _place(self, scene: SceneRef) -> SceneRef:
        """Return where a room lies on this node; the name of one of ours."""
        imported = scene_path(self._here, scene.name)
        return replace(scene, path=str(imported)) if imported.exists() else scene

    def _new_files(self) -> dict[str, bytes]:
        found = {}
        for path in sorted(self._here.rglob("*")):
            name = str(path.relative_to(self._here))
            if path.is_file() and name not in self._sent and not name.startswith("scenes/"):
                found[name] = path.read_bytes()
        self._sent.update(found)
        return found


def models_here(models: Models, wanted: Mapping[str, str]) -> Models:
    """Return the models as this machine names them: the planner is what has the run's hash.

    Args:
        models: of the experiment.
        wanted: role -> name and SHA-256.

    Raises:
        ModelError: the manifest of this machine has no such file.
    """
    name, sha256, _ = parts_of_planner(wanted["planner"])
    try:
        if parts_of_planner(model_hashes(models)["planner"])[1] == sha256:
            return models
    except (FileError, ModelError, UnknownNameError):
        pass  # not under that name; perhaps under another
    for entry in read_manifest().models:
        if entry.role == "planner" and entry.files[0].sha256 == sha256:
            found = resolve_planner(entry.name)
            profile = models.profile or found.prompt_profile
            return msgspec.structs.replace(models, planner=entry.name, profile=profile)
    raise ModelError(
        f"planner {name}: no model of SHA-256 {sha256} is in the manifest here\n"
        "  To fix: bring the file there and run `karma models add PATH`"
    )


def check_node(
    header: Header, models: Models, scenes: Mapping[str, bytes], rows: Sequence[Row] = ()
) -> None:
    """Check that this machine has what a run depends on.

    Raises:
        KarmaError: something is another; names it.
    """
    hashes = model_hashes(models, rows)
    _, sha256, rest = parts_of_planner(hashes["planner"])
    hashes["planner"] = f"{parts_of_planner(header.models['planner'])[0]} {sha256}{rest}"
    mine = replace(
        header,
        versions=versions(),
        models=hashes,
        prompts=prompt_hashes(models.profile),
        scenes=scene_hashes((SceneRef(name=name) for name in header.scenes), scenes),
    )
    if found := differences(header, mine):
        raise KarmaError("not what the run depends on:\n  " + "\n  ".join(found))


def _at_node(error: Exception) -> Exception:
    """Return an error that says where it happened."""
    if not isinstance(error, KarmaError):
        return error
    return KarmaError(f"node {_ray().util.get_node_ip_address()}: {error}")


def _room(ray: Any, models: Models) -> int:
    """Return how many workers the cluster has cores and memory for, at least 1."""
    cores, memory = max(1, models.threads), worker_mb(models) * 1e6
    found = 0
    for node in ray.nodes():
        if node["Alive"]:
            has = node["Resources"]
            found += int(min(has.get("CPU", 0) // cores, has.get("memory", 0) // memory))
    return max(1, found)


def _ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise KarmaError(
            f"--ray needs the package ray: {error}\n  To fix: pip install 'karma-offline[ray]'"
        ) from error
    return ray
