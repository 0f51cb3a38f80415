"""An experiment is a TOML file: tasks, models, and one row per method; a run is a folder."""

import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from karma import __version__, registry
from karma.bench.authors import load_authors_tasks, resolve
from karma.bench.episode import run_episode
from karma.bench.records import EpisodeRecord, read_records, write_record
from karma.bench.tasks import load_tasks
from karma.contracts import LanguageModel, Task
from karma.errors import FileError
from karma.files import read_bytes, read_json, read_toml, to_json, write_atomic
from karma.infer.cassette import Cassette
from karma.infer.hosted_session import Endpoint, Hosted, Session
from karma.infer.manifest import resolve_planner
from karma.methods.kit import Kit
from karma.offline import network_allowed, settle
from karma.planner import Decoding, Planner
from karma.world.importers import import_dump
from karma.world.scene import Scene

OPENAI = "openai"  # the name of the hosted implementation in every role


class Row(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One row of the table."""

    name: str
    method: str = "karma"
    options: dict[str, Any] = {}


class Models(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which models fill the roles."""

    planner: str = "karma-nano"  # a name of models/manifest.toml, a GGUF's path, or "openai"
    profile: str = ""  # "compact" or "full"; "" = what the manifest says
    chat: bool = False  # through the GGUF's own chat template
    embedder: str = "minilm"  # or "sentence:MODEL", "clip:MODEL", of the manifest or a folder
    recall: str = "cosine"
    recall_text: str = "sentence"  # how a unit is put in words for recall
    vision: str = "metadata"
    constrained: bool = True
    temperature: float = 0.0
    threads: int = 1
    hosted: Hosted = Hosted()  # where the roles are that have "openai"

    def __post_init__(self) -> None:
        """Refuse a hosted role without a place, and a place without its role."""
        for role in ("planner", "vision", "embedder"):
            if (getattr(self, role) == OPENAI) != (getattr(self.hosted, role) is not None):
                raise ValueError(f"{role} = {OPENAI!r} and [models.hosted.{role}] go together")


class Experiment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One table: every row on every task with every seed."""

    name: str
    rows: tuple[Row, ...]
    tasks: str = ""  # our JSONL
    authors: tuple[str, ...] = ()  # or the authors' JSON files
    scenes: str = ""  # an AI2-THOR dump that the authors' floor plans come from
    layouts: str = ""  # reachable cells for them
    only: tuple[str, ...] = ()  # task ids; () = all
    world: str = "embedded"
    models: Models = Models()
    seeds: tuple[int, ...] = (0,)


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """What a run's records depend on; a folder never mixes two."""

    version: str
    experiment: str  # SHA-256 of the experiment's content
    tasks: str
    planner: str
    network: bool = False  # started with --allow-network


class Run:
    """An experiment in its folder.

    Args:
        path: the TOML file; paths in it are relative to the working directory.
        folder: takes records, header, maps and imported scenes.
        fresh: throw away what an earlier run left there.
        cassette: records hosted models or stands for them, and is the run's clock.
        base_url: of all hosted models, in place of the experiment's.

    Raises:
        FileError: the experiment is damaged, or the folder holds a run of something else.
    """

    def __init__(
        self,
        path: Path,
        folder: Path,
        *,
        fresh: bool = False,
        cassette: Cassette | None = None,
        base_url: str = "",
    ) -> None:
        self.path, self.folder = path, folder
        self.experiment = read_toml(path, Experiment)
        self._session = Session(cassette)
        self._models = self.experiment.models
        if base_url:
            self._models = msgspec.structs.replace(
                self._models, hosted=self._models.hosted.at(base_url)
            )
        names = [row.name for row in self.experiment.rows]
        if twice := [name for name in names if names.count(name) > 1]:
            raise FileError(path, f"rows: the name {twice[0]!r} stands twice")
        self.records_path = folder / "episodes.jsonl"
        self.tasks = self._load_tasks()
        self._planner = planner_identity(self.experiment.models)
        if fresh:
            self.records_path.unlink(missing_ok=True)
            (folder / "header.json").unlink(missing_ok=True)
        self._check_header()
        self.records = read_records(self.records_path)

    @property
    def total(self) -> int:
        """How many episodes the experiment has."""
        wanted = self.experiment
        return len(wanted.rows) * len(self.tasks) * len(wanted.seeds)

    def episodes(self) -> Iterator[EpisodeRecord]:
        """Run what is missing; each record is on the disk before it is yielded."""
        done = {(record.row, record.task, record.seed) for record in self.records}
        todo = [
            (row, task, seed)
            for seed in self.experiment.seeds
            for row in self.experiment.rows
            for task in self.tasks
            if (row.name, task.id, seed) not in done
        ]
        if not todo:
            return
        kit = self._kit()
        world = registry.load("worlds", self.experiment.world)()
        methods = {  # all of them now: a wrong row must not come to light hours later
            row.name: registry.load("methods", row.method).build(kit, row.options)
            for row in self.experiment.rows
        }
        for row, task, seed in todo:
            record = run_episode(
                methods[row.name],
                world,
                task,
                row=row.name,
                seed=seed,
                folder=self.folder,
                ledger=self._session.ledger,
                cassette=self._session.cassette,
            )
            settle()
            write_record(self.records_path, record)
            self.records.append(record)
            yield record

    # ------------------------------------------------------------- parts

    def _kit(self) -> Kit:
        return make_kit(
            self._models,
            maps=self.folder / "maps",
            seed=self.experiment.seeds[0],
            session=self._session,
        )

    def _load_tasks(self) -> tuple[Task, ...]:
        wanted = self.experiment
        if bool(wanted.tasks) == bool(wanted.authors):
            raise FileError(self.path, "give either `tasks` or `authors`")
        found = load_tasks(wanted.tasks) if wanted.tasks else self._authors_tasks()
        known = [task.id for task in found]
        if missing := [name for name in wanted.only if name not in known]:
            raise FileError(self.path, f"only: no task {missing[0]!r}; there are {known}")
        return tuple(t for t in found if not wanted.only or t.id in wanted.only)

    def _authors_tasks(self) -> tuple[Task, ...]:
        """Load the authors' tasks and import the floor plans they play in."""
        wanted = self.experiment
        raw = load_authors_tasks([beside(path) for path in wanted.authors])
        plans = {task.scene for task in raw}
        layouts = beside(wanted.layouts) if wanted.layouts else None
        dump = import_dump(beside(wanted.scenes), layouts=layouts)
        scenes = {scene.name: scene for scene in dump if scene.name in plans}
        return tuple(self._in_scene(task, scenes) for task in raw)

    def _in_scene(self, task: Task, scenes: Mapping[str, Scene]) -> Task:
        scene = scenes.get(task.scene)
        if scene is None:
            return replace(task, notes=(*task.notes, f"no dump of {task.scene}"))
        path = self.folder / "scenes" / f"{task.scene}.json"
        write_atomic(path, to_json(scene))
        found = resolve(task, sorted({thing.type for thing in scene.objects}))
        return replace(found, scene=str(path))

    def _check_header(self) -> None:
        header = Header(
            version=__version__,
            experiment=_sha(read_bytes(self.path)),
            tasks=_sha(to_json(self.tasks)),
            planner=self._planner,
            network=network_allowed(),
        )
        path = self.folder / "header.json"
        if path.exists() and read_json(path, Header) != header:
            raise FileError(
                path,
                "this folder holds a run of another experiment, task file or model",
                fix=f"karma eval {self.path} --fresh, or --out another folder",
            )
        write_atomic(path, to_json(header, indent=2))


def beside(path: str) -> Path:
    """Return a path, with $KARMA_SHARED in place of "../shared" where that is set."""
    shared = os.environ.get("KARMA_SHARED")
    inside = path.removeprefix("../shared/")
    return Path(shared) / inside if shared and inside != path else Path(path)


def planner_identity(models: Models) -> str:
    """Return what tells one planner from another: its hash, its path, or its name at its host."""
    endpoint = models.hosted.planner
    if endpoint is not None:
        return f"{models.planner}: {endpoint.model}"
    file = resolve_planner(models.planner)
    return file.sha256 or str(file.path)


def make_kit(
    models: Models,
    *,
    maps: Path | None,
    seed: int,
    learn: bool = False,
    session: Session | None = None,
) -> Kit:
    """Load the models of a run, each once.

    Raises:
        ModelError: a model is missing, damaged or of the wrong kind, or a hosted one out of reach.
        UnknownNameError: a role has no such implementation.
    """
    session = session or Session()
    model, profile = _language_model(models, session)
    decoding = Decoding(constrained=models.constrained, temperature=models.temperature, seed=seed)
    embedder = _filled("embedders", models.embedder, models.hosted.embedder, session)
    return Kit(
        planner=Planner(model, profile, decoding),
        recall=registry.load("recalls", models.recall)(embedder, text=models.recall_text),
        vision=_filled("vision_models", models.vision, models.hosted.vision, session),
        maps=maps,
        learn=learn,
        embedder=embedder,
    )


def _filled(role: str, name: str, endpoint: Endpoint | None, session: Session) -> Any:
    """Return a role's implementation: "minilm", or with its model, "sentence:bge-small-en".

    One that is hosted is told where.
    """
    kind, _, model = name.partition(":")
    made = registry.load(role, kind)
    if endpoint is not None:
        return made(endpoint, session=session)
    return made(model) if model else made()


def _language_model(models: Models, session: Session) -> tuple[LanguageModel, str]:
    """Return the planner's model and its prompt profile."""
    if models.hosted.planner is not None:
        model = _filled("language_models", models.planner, models.hosted.planner, session)
        return model, models.profile or "full"
    file = resolve_planner(models.planner)
    local = registry.load("language_models", "llama")(
        file.path,
        n_ctx=file.context_length or 4096,
        n_threads=models.threads,
        name=file.name,
        sha256=file.sha256,
        chat=models.chat or file.chat,
    )
    return local, models.profile or file.prompt_profile


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
