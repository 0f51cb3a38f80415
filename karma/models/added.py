"""Add models that the user has, and remove them again (`karma models add` and `remove`).

Added files stay where they are: they are hashed there, tried, and entered in local.toml by their
absolute paths. Nothing is parsed before all hashes that the manifest knows were met.
"""

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import KarmaError, ModelError
from karma.files import sha256_of, write_atomic
from karma.models.checks.folder import PICKLES, check_weights, read_config
from karma.models.checks.gguf import check_gguf, check_projector, is_gguf, is_projector, split_pair
from karma.models.checks.memory import gguf_parts_mb, projector_mb, weights_mb
from karma.models.manifest import (
    Manifest,
    ModelEntry,
    ModelFile,
    Role,
    local_path,
    read_local,
    read_shipped,
)

Progress = Callable[[str, int, int], None]  # file, bytes done, bytes in all
Trial = Callable[[ModelEntry, Path], None]  # of an entry whose files lie in a folder
Hashes = Mapping[str, tuple[str, int]]  # path inside the model -> SHA-256, size

_FAMILIES: Mapping[Role, Sequence[str]] = {  # `model_type` of config.json
    "image-embedder": ("clip", "siglip", "siglip2"),
    "text-embedder": ("bert", "distilbert", "modernbert", "mpnet", "xlm-roberta", "roberta"),
    "vlm": ("qwen2_5_vl", "smolvlm", "idefics3", "llava", "llava_onevision"),
}
_ROLES = {family: role for role, families in _FAMILIES.items() for family in families}
_TAKEN = (".safetensors", ".json", ".txt", ".model", ".jinja")
_BATCH = 512
_HEAD = "# Models that `karma models add` brought; `karma models remove NAME` takes one out.\n\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class AddOptions:
    """What the user said of a model that is added; None where nothing was said."""

    name: str | None = None
    role: Role | None = None
    licence: str | None = None
    source: str | None = None
    revision: str | None = None
    prompt_profile: str | None = None
    context_length: int | None = None
    chat: bool | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """What `add_model` did."""

    entry: ModelEntry
    known: bool  # the manifest names this model, and its hashes were met
    left_out: tuple[str, ...] = ()  # files of the folder that were not taken


def add_model(
    path: str | Path,
    options: AddOptions | None = None,
    *,
    progress: Progress | None = None,
    trial: Trial | None = None,
) -> Added:
    """Take a GGUF file or a folder of safetensors into the list of models.

    `progress` hears how far the hashing is; `trial` asks the model before it is listed, and what
    it raises leaves nothing behind.

    Raises:
        ModelError: a pickle, a damaged file, or not the file that the manifest wants; by name.
        FileError: something cannot be read, or local.toml cannot be written.
    """
    options = options or AddOptions()
    root = Path(path).expanduser().absolute()  # a link's name tells more than its target's
    found, left_out = _files_of(root)
    folder = root if root.is_dir() else root.parent
    if options.name is not None:
        _check_free(options.name)
    hashes = _hashed(folder, found, progress)
    shipped = _matching(options.name, hashes)
    name = options.name or (shipped.name if shipped else root.stem if root.is_file() else root.name)
    _check_free(name)
    if shipped is not None:
        hashes = _met(shipped, hashes)
    elif name in {entry.name for entry in read_shipped().models}:
        raise ModelError(f"{name!r} is another model of the manifest; use another --name")
    files = tuple(
        ModelFile(path=(folder / part).as_posix(), sha256=digest, bytes=size)
        for part, (digest, size) in hashes.items()
    )
    seen = _seen(folder, [folder / part for part in hashes if is_gguf(folder / part)])
    if shipped is not None:
        entry = msgspec.structs.replace(shipped, files=files)
    else:
        entry = _described(name, options, files, seen)
    if trial is not None:
        trial(entry, folder)
    _write_local([*read_local().models, entry])
    return Added(entry=entry, known=shipped is not None, left_out=left_out)


def remove_model(name: str) -> ModelEntry:
    """Take back what `add_model` did; the files stay where they are.

    Raises:
        ModelError: nothing of that name was added.
        FileError: local.toml cannot be written.
    """
    models = {entry.name: entry for entry in read_local().models}
    entry = models.pop(name, None)
    if entry is None:
        added = ", ".join(models) or "nothing"
        raise ModelError(f"{name!r} was not added, so it stays. Added: {added}")
    _write_local(list(models.values()))
    return entry


def _check_free(name: str) -> None:
    """Refuse a name that is taken, or is none; ModelError says why."""
    packaged = {entry.name: entry.package for entry in read_shipped().models if entry.package}
    if name in packaged:
        raise ModelError(f"{name!r} comes with the package {packaged[name]}; use another --name")
    if any(entry.name == name for entry in read_local().models):
        raise ModelError(f"{name!r} was added before; `karma models remove {name}`, or use --name")
    if "/" in name or name.startswith(".") or not name.isprintable():
        raise ModelError(f"{name!r} is not a name: printable, without '/', not beginning with '.'")


# ----------------------------------------------------------------- its files


def _files_of(root: Path) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Return the files to take by their path inside the model, and what is left out."""
    if not root.exists():
        raise ModelError(
            f"{root}: no such file or folder\n"
            "  To fix: give the path of a .gguf file or of a folder with safetensors; names of a "
            "hub are never looked up"
        )
    if root.is_file():
        if not is_gguf(root):
            raise _refused(root)
        return {root.name: root}, ()
    files = ((p.relative_to(root), p) for p in sorted(root.rglob("*")) if p.is_file())
    every = {
        part.as_posix(): path
        for part, path in files
        if not any(name.startswith(".") for name in part.parts)
    }
    ggufs = [part for part, path in every.items() if is_gguf(path)]
    taken = {part: p for part, p in every.items() if p.suffix in _TAKEN or part in ggufs}
    weights = [part for part in taken if part.endswith(".safetensors")] + ggufs
    if not weights:
        pickled = [path for path in every.values() if path.suffix in PICKLES]
        raise _refused(pickled[0]) if pickled else ModelError(f"{root}: no .safetensors, no .gguf")
    pair = len(ggufs) == 2 and sum(is_projector(taken[part]) for part in ggufs) == 1
    if ggufs and not (len(weights) == 1 or (pair and len(weights) == 2)):
        raise ModelError(
            f"{root}: more than one model or part: {', '.join(weights[:3])}\n"
            "  To fix: add each .gguf by itself, one that reads pictures with its projector in a "
            "folder; parts of one are joined first: llama-gguf-split --merge FIRST_PART WHOLE.gguf"
        )
    return taken, tuple(sorted(every.keys() - taken.keys()))


def _refused(path: Path) -> ModelError:
    pickled = path.suffix in PICKLES
    why = "it may hold code" if pickled else "only .gguf and folders of safetensors are"
    fix = "take the model's safetensors or GGUF files instead"
    return ModelError(f"{path}: not opened, {why}\n  To fix: {fix}")


def _hashed(folder: Path, parts: Iterable[str], progress: Progress | None) -> Hashes:
    """Return SHA-256 and size of each file of a folder, read once."""
    sizes = {part: (folder / part).stat().st_size for part in parts}
    total, done = sum(sizes.values()), 0

    def digest(part: str) -> str:
        def advance(count: int) -> None:
            nonlocal done
            done += count
            if progress is not None:
                progress(part, done, total)

        return sha256_of(folder / part, progress=advance)

    return {part: (digest(part), size) for part, size in sizes.items()}


# ----------------------------------------------------------------- what it is


def _matching(name: str | None, hashes: Hashes) -> ModelEntry | None:
    """Return the manifest's model of that name, or without one the one whose files these are."""
    models = read_shipped().models
    if name is not None:
        return next((entry for entry in models if entry.name == name), None)
    digests = {digest for digest, _ in hashes.values()}
    return next((entry for entry in models if _weights_of(entry) <= digests), None)


def _weights_of(entry: ModelEntry) -> set[str | None]:
    """Return the hashes of an entry's weights; a hash that is not known fits none."""
    heavy = (".safetensors", ".gguf")
    return {file.sha256 for file in entry.files if file.path.endswith(heavy)} or {None}


def _parts_of(entry: ModelEntry) -> dict[str, ModelFile]:
    """Return an entry's files by their path inside the model's folder."""
    common = os.path.commonpath([Path(file.path).parent for file in entry.files])
    return {os.path.relpath(file.path, common): file for file in entry.files}


def _met(shipped: ModelEntry, hashes: Hashes) -> Hashes:
    """Return the files that the manifest wants; refuses by name what is not as it must be."""
    wanted = _parts_of(shipped)
    for part, file in wanted.items():
        expected = f"  Expected SHA-256: {file.sha256 or 'not known'}"
        if part not in hashes:
            raise ModelError(
                f"{Path(part).name}: missing, and model {shipped.name!r} needs {part}\n"
                f"{expected}\n  To fix: {shipped.fix}"
            )
        digest, size = hashes[part]
        if file.sha256 not in (None, digest) or file.bytes not in (None, size):
            raise ModelError(
                f"{part}: not the file of model {shipped.name!r}: its SHA-256 is {digest}, "
                f"{size} bytes\n{expected}, {file.bytes or 'not known how many'} bytes\n"
                f"  To fix: {shipped.fix}; or add it as another model with --name"
            )
    return {part: hashes[part] for part in wanted}


def _seen(folder: Path, weights: Sequence[Path]) -> dict[str, Any]:
    """Return what the headers say: of safetensors, of one GGUF, or of a model and its projector."""
    if not weights:
        fix = "bring the model's whole folder"
        parameters = sum(check_weights(folder, fix=fix).values())
        config = read_config(folder / "config.json", fix=fix)
        role = _ROLES.get(str(config.get("model_type")))
        return {"format": "safetensors", "role": role, "memory_mb": weights_mb(parameters)}
    if len(weights) == 1:
        if is_projector(weights[0]):
            raise ModelError(
                f"{weights[0]}: the picture part of a model, without the model\n"
                "  To fix: put both .gguf files into one folder, and add that"
            )
        return _gguf(weights[0])
    model, projector = split_pair(folder, weights)
    check_projector(projector)
    seen = _gguf(model)
    return seen | {"role": "vlm", "memory_mb": seen["memory_mb"] + projector_mb(projector)}


def _gguf(path: Path) -> dict[str, Any]:
    metadata = check_gguf(path)
    context = min(int(metadata[f"{metadata['general.architecture']}.context_length"]), 8192)
    return {
        "format": "gguf",
        "role": "planner",
        "context_length": context,
        "licence": metadata.get("general.license"),
        "memory_mb": gguf_parts_mb(path, metadata, context=context, batch=_BATCH),
    }


def _described(
    name: str, options: AddOptions, files: tuple[ModelFile, ...], seen: Mapping[str, Any]
) -> ModelEntry:
    usual = {"licence": "not known", "source": "added by hand", "prompt_profile": "full"}
    fields = usual | {
        key: value
        for key, value in (*seen.items(), *asdict(options).items())
        if value not in (None, "")
    }
    if "role" not in fields:
        raise ModelError(f"{name!r}: its config.json does not tell what it is for; give --role")
    if fields["role"] != "planner":
        fields |= {"prompt_profile": None, "chat": None}
    fields |= {
        "name": name,
        "files": msgspec.to_builtins(files),
        "restore": f"bring {name}'s files back, or `karma models remove {name}`",
        "memory_mb": round(seen["memory_mb"]),
    }
    try:
        return msgspec.convert(fields, ModelEntry)
    except (msgspec.ValidationError, ValueError) as error:
        raise ModelError(f"{name!r} cannot be described: {error}") from error


# ----------------------------------------------------------------- local.toml


def entry_toml(entry: ModelEntry) -> str:
    """Write one entry; a JSON string of printable characters is a TOML string."""

    def pairs(values: dict[str, object]) -> list[str]:
        return [
            f"{key} = {json.dumps(value, ensure_ascii=False)}"
            for key, value in values.items()
            if value is not None
        ]

    values = msgspec.to_builtins(entry)
    files = [f"  {{ {', '.join(pairs(file))} }}," for file in values.pop("files")]
    return "\n".join(["[[models]]", *pairs(values), "files = [", *files, "]", ""])


def _write_local(models: Sequence[ModelEntry]) -> None:
    path = local_path()
    if not models:
        path.unlink(missing_ok=True)
        return
    text = _HEAD + "\n".join(map(entry_toml, models))
    try:
        back = msgspec.toml.decode(text, type=Manifest)
    except (msgspec.DecodeError, ValueError) as error:
        raise KarmaError(f"{path}: this cannot be written down: {error}") from error
    if back.models != tuple(models):
        raise KarmaError(f"{path}: an entry would not be read back as it is")
    write_atomic(path, text.encode())
