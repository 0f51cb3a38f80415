"""Add and remove models that somebody brought (`karma models add` and `remove`).

Added files are copied to `weights/NAME` beside the manifest, hashed on the way, tried, and entered
in local.toml last; with `in_place`, or where they lie there already, they stay as they are.
Nothing is parsed before all hashes that the manifest knows were met, and nothing that was there
before is lost when anything fails.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import FileError, KarmaError, ModelError
from karma.files import sha256_of, write_atomic
from karma.infer.checks.folder import PICKLES, check_weights, read_config
from karma.infer.checks.gguf import check_gguf, is_gguf
from karma.infer.checks.memory import gguf_parts_mb, projector_mb, weights_mb
from karma.infer.checks.projector import check_projector
from karma.infer.manifest.manifest import (
    Manifest,
    ModelEntry,
    ModelFile,
    Role,
    local_path,
    read_local,
    read_shipped,
)
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


Progress = Callable[[str, int, int], None]  # file, bytes done, bytes in all
Trial = Callable[[ModelEntry, Path], None]  # of an entry whose files lie in a folder


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
    manifest: str | Path | None = None,
    progress: Progress | None = None,
    trial: Trial | None = None,
) -> Added:
    """Take a GGUF file or a folder of safetensors into the list of models.

    Args:
        path: the file or folder.
        options: what cannot be read from the files, and what should be otherwise.
        manifest: by default the project's own.
        progress: told how far the hashing is.
        trial: asks it before it is listed; what it raises leaves nothing behind.

    Raises:
        ModelError: a pickle, a damaged file, or not the file that the manifest wants; by name.
        FileError: something cannot be read, or written; nothing half-done stays.
    """
    options = options or AddOptions()
    root = Path(path).expanduser().absolute()  # a link's name tells more than its target's
    found, left_out = files_of(root)
    shipped = matching(read_shipped(manifest).models, options.name, found)
    name = _free_name(shipped, options, root, manifest)
    place = root if root.is_dir() else root.parent
    final = local_path(manifest).parent / "weights" / name
    stays = options.in_place or place.resolve() == final.resolve()
    prefix = place if stays else Path("weights") / name
    with nullcontext(place) if stays else _copies(final, found.values(), place) as folder:
        hashes = _taken_in(found, None if stays else folder, progress)
        entry = entry_of(name, shipped, options, folder, hashes, prefix=prefix)
        if trial is not None:
            trial(entry, folder)
        if not stays:
            folder.chmod(0o755)
            folder.rename(final)
        try:
            _write_local([*read_local(manifest).models, entry], manifest)
        except BaseException:
            if not stays:
                shutil.rmtree(final, ignore_errors=True)
            raise
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


def _free_name(
    shipped: ModelEntry | None, options: AddOptions, root: Path, manifest: str | Path | None
) -> str:
    name = options.name or (shipped.name if shipped else root.stem if root.is_file() else root.name)
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


def _taken_in(
    found: Mapping[str, Path], copies: Path | None, progress: Progress | None
) -> dict[str, tuple[str, int]]:
    """Return SHA-256 and size of each file, read once; of its copy where there are some."""
    total, done = sum(path.stat().st_size for path in found.values()), 0
    hashes = {}
    for part, path in found.items():
        before = done

        def tell(count: int, part: str = part) -> None:
            nonlocal done
            done += count
            if progress is not None:
                progress(part, done, total)

        try:
            if copies is not None:  # what is hashed is what will be used
                path = _copied(path, copies / part)
            hashes[part] = sha256_of(path, progress=tell), done - before
        except OSError as error:
            fix = "free some space there, or use --in-place" if copies is not None else None
            raise FileError(path, error.strerror or str(error), fix=fix) from error
    return hashes


def _copied(path: Path, copy: Path) -> Path:
    copy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, copy)
    with copy.open("rb") as file:
        os.fsync(file.fileno())
    return copy


@contextmanager
def _copies(final: Path, files: Collection[Path], place: Path) -> Iterator[Path]:
    """Give a folder beside the final one for copies of files; it goes, unless it was moved there.

    Args:
        final: where they will lie.
        files: that will be copied.
        place: where they are, which errors speak of instead of the copies.
    """
    if final.exists():
        fix = f"`karma models add {final} --name {final.name}` if it is this model, or remove it"
        raise FileError(final, "there is something already", fix=f"{fix} by hand")
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(dir=final.parent, prefix=f".{final.name}.adding-"))
    except OSError as error:
        fix = "set KARMA_MODELS to a folder you may write to (with a manifest.toml)"
        raise FileError(final.parent, error.strerror or str(error), fix=fix) from error
    try:
        needed, free = sum(path.stat().st_size for path in files), shutil.disk_usage(folder).free
        if needed > free:
            reason = f"{needed / 1e6:.0f} MB are needed, {free / 1e6:.0f} are free"
            fix = "free some space there, or use --in-place"
            raise FileError(final.parent, reason, fix=fix)
        yield folder
    except ModelError as error:
        raise ModelError(str(error).replace(str(folder), str(place))) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


# ----------------------------------------------------------------- local.toml


def _write_local(models: Sequence[ModelEntry], manifest: str | Path | None) -> None:
    path = local_path(manifest)
    if not models:
        with suppress(FileNotFoundError):
            path.unlink()
        return
    text = _HEAD + "\n".join(map(entry_toml, models))
    try:
        back = msgspec.toml.decode(text, type=Manifest)
    except (msgspec.DecodeError, ValueError) as error:
        raise KarmaError(f"{path}: this cannot be written down: {error}") from error
    if back.models != tuple(models):
        raise KarmaError(f"{path}: an entry would not be read back as it is")
    write_atomic(path, text.encode())


_HEAD = "# Models that `karma models add` brought; `karma models remove NAME` takes one out.\n\n"
