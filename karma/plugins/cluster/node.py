"""What a machine of a cluster loads to do chains: its own files and models, checked by hash.

A node that has another model, version, prompt or file than the run names it, and the run ends. What
an episode leaves comes back with its record, so the run's folder lies on one machine only.
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import msgspec

from karma import __version__
from karma.bench.engine.benchmark_runs import BenchmarkSuite
from karma.bench.engine.experiment import scene_path
from karma.bench.engine.experiment_file import beside
from karma.bench.engine.our_tasks import OurTasks
from karma.bench.engine.suite import Do, Done, Suite
from karma.bench.engine.workers import loaded
from karma.errors import FileError, KarmaError, ModelError, UnknownNameError
from karma.files import shipped, write_atomic
from karma.journal.header import Header, changed, each_path
from karma.journal.provenance import (
    model_hashes,
    parts_of_planner,
    prompt_hashes,
    scene_hashes,
    versions,
)
from karma.journal.records import NotRun
from karma.loading.models import Models, Row
from karma.models.manifest import read_manifest, resolve_planner
from karma.models.session import Session
from karma.types.space import SceneRef

T = TypeVar("T", bound=msgspec.Struct)


class DataFolders(NamedTuple):
    """Where a machine has what experiments read."""

    ours: Path  # eval/, which ships with the package
    shared: Path  # the reference data

    @classmethod
    def here(cls) -> Self:
        """Return those of this machine."""
        ours = shipped("eval")
        return cls(ours=ours, shared=beside(ours, "../../shared/"))


def with_places_here(experiment: T, there: DataFolders) -> T:
    """Return another machine's experiment with the paths that it has in this one's folders.

    What lies in none of the other machine's folders keeps its path.
    """
    pairs = tuple(zip(there, DataFolders.here(), strict=True))

    def here(path: str) -> str:
        lies = (pair for pair in pairs if Path(path).is_relative_to(pair[0]))
        inside = (new / Path(path).relative_to(old) for old, new in lies)
        return str(next(inside, path))

    return msgspec.convert(each_path(msgspec.to_builtins(experiment), "", here), type(experiment))


def begin_on_node(suite: Suite, header: Any, there: DataFolders) -> Do:
    """Find this machine's files and models, check them against the run's header, and load them.

    `there` are folders on the run's machine.

    Raises:
        KarmaError: something here is not what the run depends on.
    """
    if isinstance(suite, OurTasks):
        return _begin_our_tasks(suite, header)
    if isinstance(suite, BenchmarkSuite):
        return _begin_benchmark(suite, header, there)
    refuse_node(changed("versions", header.versions, {"karma": __version__}))
    return loaded(suite, Session())


def _begin_our_tasks(suite: OurTasks, header: Header) -> Do:
    node = NodeFolder(suite.folder, suite.scenes)
    models = node.models(header, suite.models, suite.rows)
    return node.bringing(loaded(replace(suite, folder=node.path, models=models), Session()))


def _begin_benchmark(suite: BenchmarkSuite, header: Header, there: DataFolders) -> Do:
    kind: Any = type(suite.experiment)
    experiment: Any = with_places_here(msgspec.convert(header.options, kind), there)
    if experiment.plans:
        models = models_here(experiment.models, header.models)
        experiment = msgspec.structs.replace(experiment, models=models)
    here = BenchmarkSuite(experiment, experiment, suite.path)
    mine = replace(
        header,
        files=here.file_hashes(),
        versions=versions(),
        models=hashes_here(models, header.models) if experiment.plans else {},
    )
    refuse_node(header.apart(mine))
    return loaded(here, Session())


class NodeFolder:
    """A folder of this machine that episodes are done in.

    `there` is the run's folder on another machine; its tasks bring the scenes along, by name.
    """

    def __init__(self, there: Path, scenes: Mapping[str, bytes]) -> None:
        self._there, self._scenes = there, scenes
        self.path = Path(tempfile.mkdtemp(prefix="karma-run-"))
        for name, data in scenes.items():
            write_atomic(scene_path(self.path, name), data)
        self._sent: set[str] = set()

    def models(self, header: Header, models: Models, rows: Sequence[Row]) -> Models:
        """Return the models as this machine names them; KarmaError where something is another."""
        found = models_here(models, header.models)
        check_node(header, found, self._scenes, rows)
        return found

    def bringing(self, do: Do) -> Do:
        """Return what does a chain, and brings along what its episodes leave here."""
        return lambda chain: [self._brought(one) for one in do(chain)]

    def _brought(self, one: Done) -> Done:
        here, there = str(self.path), str(self._there)
        if isinstance(one, NotRun):
            return replace(one, reason=one.reason.replace(here, there))
        said = one.record.error.replace(here, there)
        return replace(one, record=replace(one.record, error=said), files=self._new_files())

    def _new_files(self) -> dict[str, bytes]:
        found = {}
        for path in sorted(self.path.rglob("*")):
            name = str(path.relative_to(self.path))
            if path.is_file() and name not in self._sent and not name.startswith("scenes/"):
                found[name] = path.read_bytes()
        self._sent.update(found)
        return found


def models_here(models: Models, wanted: Mapping[str, str]) -> Models:
    """Return the models as this machine names them: the planner is what has the run's hash.

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
    """Return what this machine's models are, the planner by the name that the run has for it."""
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
        prompts=prompt_hashes(),
        scenes=scene_hashes((SceneRef(name=name) for name in header.scenes), scenes),
    )
    refuse_node(header.apart(mine))


def refuse_node(found: Sequence[str]) -> None:
    """Raise KarmaError where a node differs from what a run depends on."""
    if found:
        raise KarmaError("not what the run depends on:\n  " + "\n  ".join(found))
