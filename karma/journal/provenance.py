"""What a run depends on, as versions and SHA-256 hashes."""

import hashlib
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import msgspec

from karma import __version__, registry
from karma.errors import FileError, UnknownNameError
from karma.files import read_bytes, sha256_of, to_json
from karma.journal.header import Header, Kind, Machine, Options
from karma.loading.models import OPENAI, Models, Row
from karma.loading.planner_files import words_path
from karma.models.llama.opening import devices
from karma.models.manifest import find_model, resolve_planner
from karma.offline.guard import network_allowed
from karma.types.space import SceneRef
from karma.types.tasks import Task
from karma.world.core.scene import find

_GROUPS = {"embedder": "embedders", "vision": "vision_models"}
PACKAGE = Path(__file__).parents[1]
COMPUTING = (  # packages whose next version may give other bits
    "faiss-cpu", "llama-cpp-python", "numpy", "sentence-transformers", "tokenizers", "torch",
    "transformers",
)  # fmt: skip


def header_of(
    name: str,
    options: Options,
    models: Models,
    *,
    rows: Sequence[Row],
    tasks: Iterable[Task],
    scenes: Mapping[str, bytes],
    steps: bool,
    kind: Kind = "run",
) -> Header:
    """Return what a run of our own tasks depends on; errors as `model_hashes`.

    `options` are all that was said of it, as plain values; `scenes` are imported floor plans.
    """
    tasks = list(tasks)
    return Header(
        kind=kind,
        name=name,
        options=options,
        files={"tasks": _sha(to_json([_listed(task) for task in tasks]))},
        versions=versions(),
        models=model_hashes(models, rows),
        prompts=prompt_hashes(),
        scenes=scene_hashes({scene for task in tasks for scene in task.scenes}, scenes),
        network=network_allowed(),
        steps=steps,
        machine=machine(models.threads),
    )


def versions() -> dict[str, str]:
    """Return the versions of this package, of Python, and of what computes."""
    found = {"karma": __version__, "python": ".".join(platform.python_version_tuple()[:2])}
    for name in COMPUTING:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine(threads: int) -> Machine:
    """Return what this machine is."""
    return Machine(
        platform=platform.platform(),
        cpu=_cpu(),
        cores=len(os.sched_getaffinity(0)),
        threads=threads,
        devices=tuple(f"{one.name}: {one.description}" for one in devices()),
    )


# ----------------------------------------------------------------- models


def model_hashes(models: Models, rows: Iterable[Row] = ()) -> dict[str, str]:
    """Return role -> name and SHA-256 of the model that fills it, also of rows with their own.

    A role without weights, and one that a host fills, has the name only.

    Raises:
        ModelError: a file is missing.
        UnknownNameError: there is no such model.
    """
    return {
        "planner": _planner(models),
        "embedder": _filled(models, "embedder"),
        "vision": _filled(models, "vision"),
    } | {
        f"vision of {row.name}": _name_and_hash("vision_models", row.vision)
        for row in rows
        if row.vision
    }


def _planner(models: Models) -> str:
    if models.hosted.planner is not None:
        return f"{OPENAI}: {models.hosted.planner.model}"
    file = resolve_planner(models.planner)
    words = words_path(models.planner)
    told = f", words {_file_sha(words)}" if words is not None else ""
    return f"{file.name} {file.sha256 or _file_sha(file.path)}{told}"


def parts_of_planner(told: str) -> tuple[str, str, str]:
    """Return name, SHA-256 of the weights, and what follows, of what is told of a planner.

    >>> parts_of_planner("my planner 5e, words 7a")
    ('my planner', '5e', ', words 7a')
    """
    weights, comma, rest = told.partition(", ")
    name, _, sha256 = weights.rpartition(" ")
    return name, sha256, comma + rest


def _filled(models: Models, role: str) -> str:
    endpoint = getattr(models.hosted, role)
    return (
        f"{OPENAI}: {endpoint.model}"
        if endpoint is not None
        else _name_and_hash(_GROUPS[role], getattr(models, role))
    )


def _name_and_hash(role: str, name: str) -> str:
    """Return the name of an implementation with the hash of its model, if it has one."""
    kind, _, model = name.partition(":")
    if kind == "minilm":
        from karma.models.embed.minilm import FILES

        return f"{name} {_sha(to_json(FILES))}"
    model = model or getattr(registry.load(role, kind), "default", "")
    return f"{name} {_model_sha(model)}" if model else name


def _model_sha(model: str) -> str:
    """Return one hash for all files of a model of the manifest, or of a folder."""
    folder = Path(model)
    if folder.is_dir():
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        return _sha(to_json({str(p.relative_to(folder)): _file_sha(p) for p in files}))
    try:
        entry = find_model(model)
    except UnknownNameError:
        return _file_sha(folder) if folder.is_file() else ""  # whoever loads it says what is wrong
    return _sha(to_json({file.path: file.sha256 for file in entry.files}))


def _file_sha(path: Path) -> str:
    return sha256_of(path, fix="`karma models list` shows what is there")


# ----------------------------------------------------------------- the rest


def prompt_hashes() -> dict[str, str]:
    """Return the hash of each prompt template."""
    files = sorted(PACKAGE.rglob("*.txt"), key=lambda path: path.name)
    return {path.name: _sha(read_bytes(path)) for path in files}


def _listed(task: Task) -> dict[str, Any]:
    """Return a task with its rooms by name: where their files lie changes nothing."""
    plain: dict[str, Any] = msgspec.to_builtins(task)
    plain["scene"] = task.scene.name
    for one, part in zip(task.subtasks, plain["subtasks"], strict=True):
        part["scene"] = one.scene.name if one.scene else ""
    return plain


def scene_hashes(scenes: Iterable[SceneRef], imported: Mapping[str, bytes]) -> dict[str, str]:
    """Return the hash of each scene that is there; the episodes of others record an error."""
    found = {}
    for scene in sorted(scenes, key=lambda scene: scene.source):
        try:
            data = imported.get(scene.name) or read_bytes(find(scene.source))
        except FileError:
            continue
        found[scene.name] = _sha(data)
    return found


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
