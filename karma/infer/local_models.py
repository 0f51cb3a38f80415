"""`karma models add` and `remove`: files that somebody brought, taken in or refused by name.

Added files are copied to `weights/NAME` beside the manifest, hashed on the way, and entered in
local.toml last; with `in_place`, or where they lie there already, they stay as they are. Nothing is
parsed before all hashes that the manifest knows were met, and nothing that was there before is lost
when anything fails.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import FileError, KarmaError, ModelError
from karma.files import write_atomic
from karma.infer.folder_check import PICKLES, check_weights, read_config
from karma.infer.gguf_check import check_gguf
from karma.infer.manifest import (
    Manifest,
    ModelEntry,
    ModelFile,
    Role,
    local_path,
    read_local,
    read_shipped,
    sha256_of,
)
from karma.infer.memory_check import gguf_parts_mb, weights_mb

_TAKEN = (".safetensors", ".json", ".txt", ".model", ".jinja", ".gguf")
_ROLES: Mapping[str, Role] = {
    "clip": "image-embedder",
    "siglip": "image-embedder",
    "siglip2": "image-embedder",
    "grounding-dino": "detector",
    "sam": "detector",
    "bert": "text-embedder",
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
Progress = Callable[[str, int, int], None]  # file, bytes done, bytes in all


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """What `add_model` did."""

    entry: ModelEntry
    known: bool  # the manifest names this model, and its hashes were met
    left_out: tuple[str, ...] = ()  # files of the folder that were not taken


def add_model(
    path: str | Path,
    wishes: Wishes | None = None,
    *,
    manifest: str | Path | None = None,
    progress: Progress | None = None,
) -> Added:
    """Take a GGUF file or a folder of safetensors into the list of models.

    Args:
        path: the file or folder.
        wishes: what cannot be read from the files, and what should be otherwise.
        manifest: by default the project's own.
        progress: told how far the hashing is.

    Raises:
        ModelError: a pickle, a damaged file, or not the file that the manifest wants; by name.
        FileError: something cannot be read, or written; nothing half-done stays.
    """
    wishes = wishes or Wishes()
    root = Path(path).expanduser().resolve()
    found, left_out = _files_of(root)
    shipped = _matching(read_shipped(manifest).models, wishes.name, found)
    name = _free_name(shipped, wishes, root, manifest)
    place = root if root.is_dir() else root.parent
    steps = _Steps(found, place, progress)
    if wishes.in_place or place == (local_path(manifest).parent / "weights" / name).resolve():
        hashes = {part: steps.hashed(part) for part in found}
        entry = _entry(name, shipped, wishes, place, hashes, prefix=place)
        _write_local(_with(read_local(manifest).models, entry), manifest)
    else:
        entry = _copied(name, shipped, wishes, steps, manifest)
    return Added(entry=entry, known=shipped is not None, left_out=left_out)


def remove_model(name: str, *, manifest: str | Path | None = None) -> ModelEntry:
    """Take back what `add_model` did: its entry, and the copies it made; never another's files.

    Raises:
        ModelError: nothing of that name was added.
        FileError: local.toml cannot be written; then nothing is removed.
    """
    models = read_local(manifest).models
    found = [entry for entry in models if entry.name == name]
    if not found:
        added = ", ".join(entry.name for entry in models) or "nothing"
        raise ModelError(f"{name!r} was not added, so it stays. Added: {added}")
    _write_local([entry for entry in models if entry.name != name], manifest)
    if any(not Path(file.path).is_absolute() for file in found[0].files):
        folder = local_path(manifest).parent / "weights" / name
        try:
            shutil.rmtree(folder)
        except FileNotFoundError:
            pass
        except OSError as error:
            fix = "the model is no longer listed; remove this folder by hand"
            raise FileError(folder, error.strerror or str(error), fix=fix) from error
    return found[0]


# ----------------------------------------------------------------- what is there


def _files_of(root: Path) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Return the files to take by their path inside the model, and what is left out."""
    if not root.exists():
        raise ModelError(
            f"{root}: no such file or folder\n"
            "  To fix: give the path of a .gguf file or of a folder with safetensors; names of a "
            "hub are never looked up"
        )
    if root.is_file():
        if root.suffix != ".gguf":
            raise ModelError(_refusal(root))
        return {root.name: root}, ()
    every = sorted(p for p in root.rglob("*") if p.is_file() and not _hidden(p, root))
    taken = {p.relative_to(root).as_posix(): p for p in every if p.suffix in _TAKEN}
    weights = [part for part in taken if part.endswith((".safetensors", ".gguf"))]
    if not weights:
        pickled = [p for p in every if p.suffix in PICKLES]
        raise ModelError(_refusal(pickled[0]) if pickled else f"{root}: no .safetensors, no .gguf")
    if len({Path(part).suffix for part in weights}) > 1 or _many_gguf(weights):
        raise ModelError(
            f"{root}: more than one model or part: {', '.join(weights[:3])}\n"
            "  To fix: add each .gguf by itself; parts of one are joined first: "
            "llama-gguf-split --merge FIRST_PART WHOLE.gguf"
        )
    return taken, tuple(p.relative_to(root).as_posix() for p in every if p.suffix not in _TAKEN)


def _hidden(path: Path, root: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(root).parts)


def _many_gguf(weights: Sequence[str]) -> bool:
    return len(weights) > 1 and weights[0].endswith(".gguf")


def _refusal(path: Path) -> str:
    why = (
        "it may hold code"
        if path.suffix in PICKLES
        else "only .gguf and folders of safetensors are"
    )
    return (
        f"{path}: not opened, {why}\n  To fix: take the model's safetensors or GGUF files instead"
    )


def _matching(
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
        for part, file in _parts(entry).items()
        if part.endswith((".safetensors", ".gguf"))
    }
    return bool(heavy) and all(
        part in found and (not part.startswith("model") or found[part].stat().st_size == file.bytes)
        for part, file in heavy.items()
    )


def _parts(entry: ModelEntry) -> dict[str, ModelFile]:
    """Return an entry's files by their path inside the model's folder."""
    common = os.path.commonpath([Path(file.path).parent for file in entry.files])
    return {os.path.relpath(file.path, common): file for file in entry.files}


def _free_name(
    shipped: ModelEntry | None, wishes: Wishes, root: Path, manifest: str | Path | None
) -> str:
    name = wishes.name or (shipped.name if shipped else root.stem if root.is_file() else root.name)
    if shipped is not None and shipped.package is not None:
        raise ModelError(f"{name!r} comes with the package {shipped.package}; use another --name")
    if any(entry.name == name for entry in read_local(manifest).models):
        raise ModelError(f"{name!r} was added before; `karma models remove {name}`, or use --name")
    taken = {entry.name for entry in read_shipped(manifest).models}
    if shipped is None and name in taken:
        raise ModelError(f"{name!r} is another model of the manifest; use another --name")
    if "/" in name or name.startswith(".") or not name.isprintable():
        raise ModelError(f"{name!r} is not a name: printable, without '/', not beginning with '.'")
    return name


# ----------------------------------------------------------------- taking in


class _Steps:
    """Reads the files, once each, and tells how far it is."""

    def __init__(self, found: Mapping[str, Path], place: Path, progress: Progress | None) -> None:
        self.found, self.place = found, place
        self._progress = progress
        self._total = sum(path.stat().st_size for path in found.values())
        self._done = 0

    def hashed(self, part: str, *, copy: Path | None = None) -> tuple[str, int]:
        """Return SHA-256 and size of what was read, and with `copy` written there."""
        path = self.found[part]
        try:
            if copy is not None:
                copy.parent.mkdir(parents=True, exist_ok=True)
                self._copy(path, copy)
                path = copy  # what is hashed is what will be used
            before = self._done
            digest = sha256_of(path, progress=lambda count: self._tell(part, count))
            return digest, self._done - before
        except OSError as error:
            fix = "free some space there, or use --in-place" if copy is not None else None
            raise FileError(path, error.strerror or str(error), fix=fix) from error

    def _copy(self, path: Path, copy: Path) -> None:
        shutil.copyfile(path, copy)
        with copy.open("rb") as file:
            os.fsync(file.fileno())

    def _tell(self, part: str, count: int) -> None:
        self._done += count
        if self._progress is not None:
            self._progress(part, self._done, self._total)


def _copied(
    name: str,
    shipped: ModelEntry | None,
    wishes: Wishes,
    steps: _Steps,
    manifest: str | Path | None,
) -> ModelEntry:
    """Copy, check, and only then put in place and enter in local.toml."""
    base = local_path(manifest).parent
    final = base / "weights" / name
    if final.exists():
        fix = f"`karma models add {final} --name {name}` if it is this model, or remove it by hand"
        raise FileError(final, "there is something already", fix=fix)
    temporary = _temporary_beside(final)
    try:
        _check_space(temporary, steps.found.values())
        hashes = {part: steps.hashed(part, copy=temporary / part) for part in steps.found}
        prefix = Path("weights") / name
        try:
            entry = _entry(name, shipped, wishes, temporary, hashes, prefix=prefix)
        except ModelError as error:  # about the copy; the user knows the file that was given
            raise ModelError(str(error).replace(str(temporary), str(steps.place))) from error
        temporary.chmod(0o755)
        temporary.rename(final)
        try:
            _write_local(_with(read_local(manifest).models, entry), manifest)
        except BaseException:
            shutil.rmtree(final, ignore_errors=True)
            raise
        return entry
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _temporary_beside(final: Path) -> Path:
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(dir=final.parent, prefix=f".{final.name}.adding-"))
    except OSError as error:
        fix = "set KARMA_MODELS to a folder you may write to (with a manifest.toml)"
        raise FileError(final.parent, error.strerror or str(error), fix=fix) from error


def _check_space(folder: Path, files: Iterable[Path]) -> None:
    needed = sum(path.stat().st_size for path in files)
    free = shutil.disk_usage(folder).free
    if needed > free:
        fix = "free some space there, or use --in-place"
        raise FileError(
            folder.parent, f"{needed / 1e6:.0f} MB are needed, {free / 1e6:.0f} are free", fix=fix
        )


def _entry(
    name: str,
    shipped: ModelEntry | None,
    wishes: Wishes,
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
    weights = [part for part in hashes if part.endswith(".gguf")]
    seen = _gguf(folder / weights[0]) if weights else _safetensors(folder)
    if shipped is not None:
        return msgspec.structs.replace(shipped, files=files)
    return _described(name, wishes, files, seen)


def _met(
    shipped: ModelEntry, folder: Path, hashes: Mapping[str, tuple[str, int]]
) -> dict[str, tuple[str, int]]:
    """Return the files that the manifest wants; refuses by name what is not as it must be."""
    wanted = _parts(shipped)
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


def _gguf(path: Path) -> dict[str, Any]:
    metadata = check_gguf(path)
    trained = int(metadata[f"{metadata['general.architecture']}.context_length"])
    context = min(trained, 8192)
    return {
        "format": "gguf",
        "role": "planner",
        "chat": "tokenizer.chat_template" in metadata,
        "context_length": context,
        "licence": metadata.get("general.license"),
        "memory_mb": gguf_parts_mb(path, metadata, context=context, batch=_BATCH),
    }


def _safetensors(folder: Path) -> dict[str, Any]:
    fix = "bring the model's whole folder"
    weights = check_weights(folder, fix=fix)
    config = read_config(folder / "config.json", fix=fix)
    return {
        "format": "safetensors",
        "role": _ROLES.get(str(config.get("model_type"))),
        "context_length": None,
        "memory_mb": weights_mb(weights.parameters),
    }


def _described(
    name: str, wishes: Wishes, files: tuple[ModelFile, ...], seen: Mapping[str, Any]
) -> ModelEntry:
    role = wishes.role or seen["role"]
    if role is None:
        raise ModelError(f"{name!r}: its config.json does not tell what it is for; give --role")
    planner = role == "planner"
    chat = seen.get("chat", False) if wishes.chat is None else wishes.chat
    fields = {
        "name": name,
        "role": role,
        "format": seen["format"],
        "files": msgspec.to_builtins(files),
        "licence": wishes.licence or seen.get("licence") or "not known",
        "source": wishes.source or "added by hand",
        "revision": wishes.revision,
        "restore": f"bring {name}'s files back, or `karma models remove {name}`",
        "prompt_profile": (wishes.prompt_profile or "full") if planner else None,
        "chat": bool(chat) and planner,
        "context_length": wishes.context_length or seen["context_length"],
        "memory_mb": round(seen["memory_mb"]),
    }
    try:
        return msgspec.convert(fields, ModelEntry)
    except (msgspec.ValidationError, ValueError) as error:
        raise ModelError(f"{name!r} cannot be described: {error}") from error


# ----------------------------------------------------------------- local.toml


def _with(models: Sequence[ModelEntry], entry: ModelEntry) -> list[ModelEntry]:
    return [*models, entry]


def _write_local(models: Sequence[ModelEntry], manifest: str | Path | None) -> None:
    path = local_path(manifest)
    if not models:
        with suppress(FileNotFoundError):
            path.unlink()
        return
    text = _HEAD + "\n".join(_toml(entry) for entry in models)
    try:
        back = msgspec.toml.decode(text, type=Manifest)
    except (msgspec.DecodeError, ValueError) as error:
        raise KarmaError(f"{path}: this cannot be written down: {error}") from error
    if back.models != tuple(models):
        raise KarmaError(f"{path}: an entry would not be read back as it is")
    write_atomic(path, text.encode())


_HEAD = "# Models that `karma models add` brought; `karma models remove NAME` takes one out.\n\n"


def _toml(entry: ModelEntry) -> str:
    """Write one entry; a JSON string of printable characters is a TOML string."""
    values = msgspec.to_builtins(entry)
    files = values.pop("files")
    lines = [f"{key} = {_value(value)}" for key, value in values.items() if value is not None]
    for file in files:
        inside = (f"{key} = {_value(value)}" for key, value in file.items() if value is not None)
        lines.append("  { " + ", ".join(inside) + " },")
    lines.insert(len(lines) - len(files), "files = [")
    return "\n".join(["[[models]]", *lines, "]", ""])


def _value(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
