"""Describe a model that somebody brought: which files, whose they are, what headers say."""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import ModelError
from karma.infer.checks.folder import PICKLES, check_weights, read_config
from karma.infer.checks.gguf import check_gguf, is_gguf
from karma.infer.checks.memory import gguf_parts_mb, projector_mb, weights_mb
from karma.infer.checks.projector import check_projector
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
_TAKEN = (".safetensors", ".json", ".txt", ".model", ".jinja")
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


# ----------------------------------------------------------------- its files


def files_of(root: Path) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Return the files to take by their path inside the model, and what is left out."""
    if not root.exists():
        raise ModelError(
            f"{root}: no such file or folder\n"
            "  To fix: give the path of a .gguf file or of a folder with safetensors; names of a "
            "hub are never looked up"
        )
    if root.is_file():
        if not is_gguf(root):
            raise ModelError(_refusal(root))
        return {root.name: root}, ()
    every = sorted(p for p in root.rglob("*") if p.is_file() and not _hidden(p, root))
    taken = {p.relative_to(root).as_posix(): p for p in every if p.suffix in _TAKEN or is_gguf(p)}
    ggufs = [part for part, p in taken.items() if is_gguf(p)]
    weights = [part for part in taken if part.endswith(".safetensors")] + ggufs
    if not weights:
        pickled = [p for p in every if p.suffix in PICKLES]
        raise ModelError(_refusal(pickled[0]) if pickled else f"{root}: no .safetensors, no .gguf")
    pair = len(ggufs) == 2 and sum(is_projector(taken[part]) for part in ggufs) == 1
    if ggufs and not (len(weights) == 1 or (pair and len(weights) == 2)):
        raise ModelError(
            f"{root}: more than one model or part: {', '.join(weights[:3])}\n"
            "  To fix: add each .gguf by itself, one that reads pictures with its projector in a "
            "folder; parts of one are joined first: llama-gguf-split --merge FIRST_PART WHOLE.gguf"
        )
    return taken, tuple(sorted({p.relative_to(root).as_posix() for p in every} - taken.keys()))


def _hidden(path: Path, root: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(root).parts)


def _refusal(path: Path) -> str:
    why = (
        "it may hold code"
        if path.suffix in PICKLES
        else "only .gguf and folders of safetensors are"
    )
    return (
        f"{path}: not opened, {why}\n  To fix: take the model's safetensors or GGUF files instead"
    )


def matching(
    models: Iterable[ModelEntry], name: str | None, found: Mapping[str, Path]
) -> ModelEntry | None:
    """Return the manifest's model of that name, or without one the only one whose files fit.

    Without a name, the files of weights must bear the manifest's names, see `_fits`.
    """
    if name is not None:
        return next((entry for entry in models if entry.name == name), None)
    fitting = [entry for entry in models if entry.package is None and _fits(entry, found)]
    return fitting[0] if len(fitting) == 1 else None


def _fits(entry: ModelEntry, found: Mapping[str, Path]) -> bool:
    """Say whether the files of weights bear an entry's names.

    Names that any model has ("model.safetensors") must come with the size too. Any other is taken
    for what it says, so that a wrong file of that name is refused and not made a model of its own.
    """
    heavy = {
        part: file
        for part, file in parts_of(entry).items()
        if part.endswith((".safetensors", ".gguf"))
    }
    return bool(heavy) and all(
        part in found and (not part.startswith("model") or found[part].stat().st_size == file.bytes)
        for part, file in heavy.items()
    )


def parts_of(entry: ModelEntry) -> dict[str, ModelFile]:
    """Return an entry's files by their path inside the model's folder."""
    common = os.path.commonpath([Path(file.path).parent for file in entry.files])
    return {os.path.relpath(file.path, common): file for file in entry.files}
