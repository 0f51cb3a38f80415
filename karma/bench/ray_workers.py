"""Episodes on the machines of a Ray cluster that is there already.

Every node has this package and its own models, which are found by their SHA-256; nothing but the
tasks and imported floor plans travels. A node that has another model, version, prompt or scene than
the run says so by name, and the run ends. What an episode leaves comes back with its record, so the
run's folder lies on one machine only.
"""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec

from karma.bench.experiment_tasks import scene_path
from karma.bench.pool import Workshop
from karma.bench.ray_pool import WorkerNeed, in_cluster
from karma.bench.worker_count import worker_mb
from karma.bench.workers import Job, Performer, Stage
from karma.contracts import SceneRef
from karma.errors import FileError, KarmaError, ModelError, UnknownNameError
from karma.files import write_atomic
from karma.infer.manifest.manifest import read_manifest, resolve_planner
from karma.journal.not_run import NotRun
from karma.journal.provenance import (
    model_hashes,
    parts_of_planner,
    prompt_hashes,
    scene_hashes,
    versions,
)
from karma.journal.run_folder import Finished, Header, differences
from karma.loading.models import Models, Row
from karma.tasks.files import in_rooms


def perform_on_ray(
    stage: Stage,
    jobs: Sequence[Job],
    address: str,
    *,
    header: Header,
    scenes: Mapping[str, bytes],
    number: int = 0,
) -> Iterator[Finished | NotRun]:
    """Do the episodes on a cluster, see `in_cluster`.

    Args:
        stage: what workers need to know; its folder stays here.
        jobs: the episodes.
        address: of the cluster's head, HOST:PORT.
        header: what the run depends on, held against every node.
        scenes: imported floor plans, which travel.
        number: workers; 0 for as many as the cluster has cores and memory for.
    """
    begin = partial(_begun, stage, header, dict(scenes))
    shop: Workshop[Job, Finished | NotRun] = Workshop(begin=begin)
    need = need_of(stage.models, stage.rows)
    return in_cluster(shop, jobs, address, need=need, number=number)


def need_of(models: Models, rows: Sequence[Row] = ()) -> WorkerNeed:
    """Return what a worker with such models takes."""
    return WorkerNeed(cores=max(1, models.threads), memory_mb=worker_mb(models, rows))


def _begun(
    stage: Stage, header: Header, scenes: Mapping[str, bytes]
) -> Callable[[Job], Finished | NotRun]:
    """Check that this node has what the run depends on, and load it."""
    here = Path(tempfile.mkdtemp(prefix="karma-run-"))
    for name, data in scenes.items():
        write_atomic(scene_path(here, name), data)
    models = models_here(stage.models, header.models)
    check_node(header, models, scenes, stage.rows)
    performer = Performer(replace(stage, folder=here, models=models))
    return _NodePerformer(performer, there=stage.folder, here=here).do


class _NodePerformer:
    """Does episodes on one node, in a folder of its own.

    Args:
        performer: writes below `here`.
        there: the run's folder, on another machine.
        here: that of this node.
    """

    def __init__(self, performer: Performer, *, there: Path, here: Path) -> None:
        self._performer, self._there, self._here = performer, there, here
        self._sent: set[str] = set()

    def do(self, job: Job) -> Finished | NotRun:
        """Do one episode; what it leaves goes with it."""
        one = self._performer.do(replace(job, task=in_rooms(job.task, self._place)))
        if isinstance(one, NotRun):
            return replace(one, reason=one.reason.replace(str(self._here), str(self._there)))
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


def hashes_here(
    models: Models, wanted: Mapping[str, str], rows: Sequence[Row] = ()
) -> dict[str, str]:
    """Return what this machine's models are, the planner by the name that the run has for it.

    Args:
        models: of this machine, see `models_here`.
        wanted: role -> name and SHA-256, of the run.
        rows: that may have models of their own.
    """
    hashes = model_hashes(models, rows)
    _, sha256, rest = parts_of_planner(hashes["planner"])
    return {**hashes, "planner": f"{parts_of_planner(wanted['planner'])[0]} {sha256}{rest}"}


def check_node(
    header: Header, models: Models, scenes: Mapping[str, bytes], rows: Sequence[Row] = ()
) -> None:
    """Check that this machine has what a run depends on.

    Raises:
        KarmaError: something is another; names it.
    """
    mine = replace(
        header,
        versions=versions(),
        models=hashes_here(models, header.models, rows),
        prompts=prompt_hashes(models.profile),
        scenes=scene_hashes((SceneRef(name=name) for name in header.scenes), scenes),
    )
    refuse_node(differences(header, mine))


def refuse_node(found: Sequence[str]) -> None:
    """Raise KarmaError where a node differs from what a run depends on."""
    if found:
        raise KarmaError("not what the run depends on:\n  " + "\n  ".join(found))
