"""Add models that the user has, and remove them again (`karma models add` and `remove`).

Added files stay where they are. They are hashed, tried, and entered in local.toml by their absolute
paths. Nothing is parsed before all hashes that the manifest knows were met.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import ModelError
from karma.files import sha256_of, write_atomic
from karma.models.checks.folder import PICKLES, check_weights, read_config
from karma.models.checks.gguf import check_gguf, check_projector, is_gguf, is_projector, split_pair
from karma.models.checks.memory import gguf_parts_mb, projector_mb, weights_mb
from karma.models.manifest import (
    ModelEntry,
    ModelFile,
    Role,
    local_path,
    read_local,
    read_shipped,
    suited_profile,
)

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
_HEAD = "# Models that `karma models add` entered; `karma models remove NAME` removes one.\n\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class AddOptions:
    """Properties of an added model that the user names; None: by its files."""

    name: str | None = None
    role: Role | None = None
    licence: str | None = None
    source: str | None = None
    prompt_profile: str | None = None


def add_model(
    path: str | Path, options: AddOptions | None = None, *, trial: Trial | None = None
) -> ModelEntry:
    """Enter a GGUF file or a folder of safetensors into the list of models.

    `trial` asks the model before it is listed; if it raises, nothing changes.

    Raises:
        ModelError: a pickle, a damaged file, or not the file that the manifest wants; by name.
        FileError: a file cannot be read, or local.toml cannot be written.
    """
    options = options or AddOptions()
    root = Path(path).expanduser().absolute()  # a link's name tells more than its target's
    parts = _parts_in(root)
    folder = root if root.is_dir() else root.parent
    hashes = _hashed(folder, parts)
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
    entry = (
        _described(name, options, files, seen)
        if shipped is None
        else msgspec.structs.replace(shipped, files=files, package=None)
    )
    if trial is not None:
        trial(entry, folder)
    _write_local([*read_local().models, entry])
    return entry


def remove_model(name: str) -> ModelEntry:
    """Remove an added model from the list; its files stay where they are.

    Raises:
        ModelError: no model of that name was added.
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
    """Check that a name can be given to a model; ModelError says why not."""
    packaged = {entry.name: entry.package for entry in read_shipped().models if entry.package}
    if name in packaged:
        raise ModelError(f"{name!r} comes with the package {packaged[name]}; use another --name")
    if any(entry.name == name for entry in read_local().models):
        raise ModelError(f"{name!r} was added before; `karma models remove {name}`, or use --name")


# ----------------------------------------------------------------- its files


def _parts_in(root: Path) -> list[str]:
    """Return the files of a model by their path inside it; ModelError if it is no model."""
    if not root.exists():
        raise ModelError(
            f"{root}: no such file or folder\n"
            "  To fix: give the path of a .gguf file or of a folder with safetensors; names of a "
            "hub are never looked up"
        )
    if root.is_file():
        if not is_gguf(root):
            raise _refused(root)
        return [root.name]
    paths = (path for path in sorted(root.rglob("*")) if path.is_file())
    every = [
        path for path in paths if not any(p.startswith(".") for p in path.relative_to(root).parts)
    ]
    ggufs = [path for path in every if is_gguf(path)]
    weights = [path for path in every if path.suffix == ".safetensors"] + ggufs
    if not weights:
        pickled = [path for path in every if path.suffix in PICKLES]
        raise _refused(pickled[0]) if pickled else ModelError(f"{root}: no .safetensors, no .gguf")
    pair = len(ggufs) == 2 and sum(map(is_projector, ggufs)) == 1
    if ggufs and not (len(weights) == 1 or (pair and len(weights) == 2)):
        raise ModelError(
            f"{root}: more than one model or part: {', '.join(p.name for p in weights[:3])}\n"
            "  To fix: add each .gguf by itself, one that reads pictures with its projector in a "
            "folder; parts of one are joined first: llama-gguf-split --merge FIRST_PART WHOLE.gguf"
        )
    taken = (path for path in every if path.suffix in _TAKEN or path in ggufs)
    return [path.relative_to(root).as_posix() for path in taken]


def _hashed(folder: Path, parts: Sequence[str]) -> Hashes:
    return {part: (sha256_of(folder / part), (folder / part).stat().st_size) for part in parts}


def _refused(path: Path) -> ModelError:
    pickled = path.suffix in PICKLES
    why = "it may hold code" if pickled else "only .gguf and folders of safetensors are"
    fix = "take the model's safetensors or GGUF files instead"
    return ModelError(f"{path}: not opened, {why}\n  To fix: {fix}")


# ----------------------------------------------------------------- its description


def _matching(name: str | None, hashes: Hashes) -> ModelEntry | None:
    """Return the manifest's model of that name, or without a name the one with these weights."""
    models = read_shipped().models
    if name is not None:
        return next((entry for entry in models if entry.name == name), None)
    digests = {digest for digest, _ in hashes.values()}
    return next((entry for entry in models if _weights_of(entry) <= digests), None)


def _weights_of(entry: ModelEntry) -> set[str]:
    heavy = (".safetensors", ".gguf")
    return {file.sha256 for file in entry.files if file.path.endswith(heavy)} or {"none"}


def _met(shipped: ModelEntry, hashes: Hashes) -> Hashes:
    """Return the files that the manifest wants; ModelError names a missing or different file."""
    common = os.path.commonpath([Path(file.path).parent for file in shipped.files])
    wanted = {os.path.relpath(file.path, common): file for file in shipped.files}
    for part, file in wanted.items():
        digest, size = hashes.get(part, ("", 0))
        if digest != file.sha256:
            found = f"its SHA-256 is {digest}, {size} bytes" if digest else "it is missing"
            raise ModelError(
                f"{part}: not the file of model {shipped.name!r}: {found}\n"
                f"  Expected SHA-256: {file.sha256}\n"
                f"  To fix: {shipped.fix}; or add it as another model with --name"
            )
    return {part: hashes[part] for part in wanted}


def _seen(folder: Path, weights: Sequence[Path]) -> dict[str, Any]:
    """Return what headers tell: of safetensors, of a GGUF, or of a model and its projector."""
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
        "prompt_profile": suited_profile(metadata, path.stat().st_size),
        "licence": metadata.get("general.license"),
        "memory_mb": gguf_parts_mb(path, metadata, context=context, batch=_BATCH),
    }


def _described(
    name: str, options: AddOptions, files: tuple[ModelFile, ...], seen: Mapping[str, Any]
) -> ModelEntry:
    fields = {"licence": "not known", "source": "added by hand"}
    named = (*seen.items(), *asdict(options).items())
    fields |= {key: value for key, value in named if value not in (None, "")}
    if "role" not in fields:
        raise ModelError(f"{name!r}: its config.json does not tell what it is for; give --role")
    if fields["role"] != "planner":
        fields.pop("prompt_profile", None)
    restore = f"bring {name}'s files back, or `karma models remove {name}`"
    memory_mb = round(seen["memory_mb"])
    try:
        return msgspec.convert(
            fields | {"name": name, "files": files, "restore": restore, "memory_mb": memory_mb},
            ModelEntry,
        )
    except (msgspec.ValidationError, ValueError) as error:
        raise ModelError(f"{name!r} cannot be described: {error}") from error


# ----------------------------------------------------------------- local.toml


def entry_toml(entry: ModelEntry) -> str:
    """Write an entry; a JSON string of printable characters is a TOML string."""

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
    if models:
        write_atomic(local_path(), (_HEAD + "\n".join(map(entry_toml, models))).encode())
    else:
        local_path().unlink(missing_ok=True)
