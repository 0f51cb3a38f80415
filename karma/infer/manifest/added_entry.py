"""Describe a model that somebody brought: compare hashes, then read headers."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import ModelError
from karma.infer.checks.folder import check_weights, read_config
from karma.infer.checks.gguf import check_gguf, is_gguf
from karma.infer.checks.memory import gguf_parts_mb, projector_mb, weights_mb
from karma.infer.checks.projector import check_projector
from karma.infer.manifest.added_files import parts_of
from karma.infer.manifest.manifest import ModelEntry, ModelFile, Role
from karma.infer.manifest.picture_pair import is_projector, split_pair

_ROLES: Mapping[str, Role] = {
    "clip": "image-embedder",
    "siglip": "image-embedder",
    "siglip2": "image-embedder",
    "bert": "text-embedder",
    "distilbert": "text-embedder",
    "modernbert": "text-embedder",
    "mpnet": "text-embedder",
    "xlm-roberta": "text-embedder",
    "roberta": "text-embedder",
    "qwen2_5_vl": "vlm",
    "smolvlm": "vlm",
    "idefics3": "vlm",
    "llava": "vlm",
    "llava_onevision": "vlm",
}
_BATCH = 512


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
    in_place: bool = False


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


def entry_of(
    name: str,
    shipped: ModelEntry | None,
    options: AddOptions,
    folder: Path,
    hashes: Mapping[str, tuple[str, int]],
    *,
    prefix: Path,
) -> ModelEntry:
    """Compare with what the manifest knows, then look at headers, then describe the model."""
    if shipped is not None:
        hashes = _met(shipped, folder, hashes)
    files = tuple(
        ModelFile(path=(prefix / part).as_posix(), sha256=digest, bytes=size)
        for part, (digest, size) in hashes.items()
    )
    weights = [part for part in hashes if is_gguf(folder / part)]
    seen = _seen(folder, [folder / part for part in weights])
    if shipped is not None:
        return msgspec.structs.replace(shipped, files=files)
    return _described(name, options, files, seen)


def _met(
    shipped: ModelEntry, folder: Path, hashes: Mapping[str, tuple[str, int]]
) -> dict[str, tuple[str, int]]:
    """Return the files that the manifest wants; refuses by name what is not as it must be."""
    wanted = parts_of(shipped)
    for part, file in wanted.items():
        where = folder / part
        if part not in hashes:
            raise ModelError(
                f"{where.name}: missing, and model {shipped.name!r} needs {part}\n"
                f"  Expected SHA-256: {file.sha256 or 'not known'}\n  To fix: {shipped.fix}"
            )
        digest, size = hashes[part]
        if file.sha256 not in (None, digest) or file.bytes not in (None, size):
            raise ModelError(
                f"{part}: not the file of model {shipped.name!r}: its SHA-256 is {digest}, "
                f"{size} bytes\n  Expected SHA-256: {file.sha256 or 'not known'}, "
                f"{file.bytes or 'not known how many'} bytes\n"
                f"  To fix: {shipped.fix}; or add it as another model with --name"
            )
    return {part: hashes[part] for part in wanted}


def _seen(folder: Path, weights: Sequence[Path]) -> dict[str, Any]:
    """Return what the headers say: of safetensors, of one GGUF, or of a model and its projector."""
    if not weights:
        return _safetensors(folder)
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
    trained = int(metadata[f"{metadata['general.architecture']}.context_length"])
    context = min(trained, 8192)
    return {
        "format": "gguf",
        "role": "planner",
        "context_length": context,
        "licence": metadata.get("general.license"),
        "memory_mb": gguf_parts_mb(path, metadata, context=context, batch=_BATCH),
    }


def _safetensors(folder: Path) -> dict[str, Any]:
    fix = "bring the model's whole folder"
    parameters = sum(check_weights(folder, fix=fix).values())
    config = read_config(folder / "config.json", fix=fix)
    return {
        "format": "safetensors",
        "role": _ROLES.get(str(config.get("model_type"))),
        "context_length": None,
        "memory_mb": weights_mb(parameters),
    }


def _described(
    name: str, options: AddOptions, files: tuple[ModelFile, ...], seen: Mapping[str, Any]
) -> ModelEntry:
    role = options.role or seen["role"]
    if role is None:
        raise ModelError(f"{name!r}: its config.json does not tell what it is for; give --role")
    planner = role == "planner"
    fields = {
        "name": name,
        "role": role,
        "format": seen["format"],
        "files": msgspec.to_builtins(files),
        "licence": options.licence or seen.get("licence") or "not known",
        "source": options.source or "added by hand",
        "revision": options.revision,
        "restore": f"bring {name}'s files back, or `karma models remove {name}`",
        "prompt_profile": (options.prompt_profile or "full") if planner else None,
        "chat": options.chat if planner else None,
        "context_length": options.context_length or seen["context_length"],
        "memory_mb": round(seen["memory_mb"]),
    }
    try:
        return msgspec.convert(fields, ModelEntry)
    except (msgspec.ValidationError, ValueError) as error:
        raise ModelError(f"{name!r} cannot be described: {error}") from error
