"""Add and remove models that somebody brought (`karma models add` and `remove`).

Added files are copied to `weights/NAME` beside the manifest, hashed there, tried, and entered in
local.toml last; with `in_place`, or where they lie there already, they stay as they are. Nothing
is parsed before all hashes that the manifest knows were met, and nothing that was there before is
lost when anything fails.
"""

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import FileError, KarmaError, ModelError
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
_SPACE = "free some space there, or use --in-place"


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
        FileError: something cannot be read, or written; nothing half-done stays.
    """
    options = options or AddOptions()
    root = Path(path).expanduser().absolute()  # a link's name tells more than its target's
    found, left_out = _files_of(root)
    shipped = _matching(options.name, found)
    name = _free_name(shipped, options, root)
    place = root if root.is_dir() else root.parent
    final = local_path().parent / "weights" / name
    stays = options.in_place or place.resolve() == final.resolve()
    prefix = place if stays else Path("weights") / name
    with nullcontext(place) if stays else _copies(final, found, place) as folder:
        hashes = _hashed(folder, found, progress)
        if shipped is not None:
            hashes = _met(shipped, folder, hashes)
        files = tuple(
            ModelFile(path=(prefix / part).as_posix(), sha256=digest, bytes=size)
            for part, (digest, size) in hashes.items()
        )
        seen = _seen(folder, [folder / part for part in hashes if is_gguf(folder / part)])
        if shipped is not None:
            entry = msgspec.structs.replace(shipped, files=files)
        else:
            entry = _described(name, options, files, seen)
        if trial is not None:
            trial(entry, folder)
        if not stays:
            folder.chmod(0o755)
            folder.rename(final)
        try:
            _write_local([*read_local().models, entry])
        except BaseException:
            if not stays:
                shutil.rmtree(final, ignore_errors=True)
            raise
    return Added(entry=entry, known=shipped is not None, left_out=left_out)


def remove_model(name: str) -> ModelEntry:
    """Take back what `add_model` did: its entry, and the copies it made; never another's files.

    Raises:
        ModelError: nothing of that name was added.
        FileError: local.toml cannot be written; then nothing is removed.
    """
    models = {entry.name: entry for entry in read_local().models}
    entry = models.pop(name, None)
    if entry is None:
        added = ", ".join(models) or "nothing"
        raise ModelError(f"{name!r} was not added, so it stays. Added: {added}")
    _write_local(list(models.values()))
    folder = local_path().parent / "weights" / name
    if any(not Path(file.path).is_absolute() for file in entry.files) and folder.exists():
        try:
            shutil.rmtree(folder)
        except OSError as error:
            fix = "the model is no longer listed; remove this folder by hand"
            raise FileError(folder, error.strerror or str(error), fix=fix) from error
    return entry


def _free_name(shipped: ModelEntry | None, options: AddOptions, root: Path) -> str:
    name = options.name or (shipped.name if shipped else root.stem if root.is_file() else root.name)
    if shipped is not None and shipped.package is not None:
        raise ModelError(f"{name!r} comes with the package {shipped.package}; use another --name")
    if any(entry.name == name for entry in read_local().models):
        raise ModelError(f"{name!r} was added before; `karma models remove {name}`, or use --name")
    if shipped is None and name in {entry.name for entry in read_shipped().models}:
        raise ModelError(f"{name!r} is another model of the manifest; use another --name")
    if "/" in name or name.startswith(".") or not name.isprintable():
        raise ModelError(f"{name!r} is not a name: printable, without '/', not beginning with '.'")
    return name


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


@contextmanager
def _copies(final: Path, files: Mapping[str, Path], place: Path) -> Iterator[Path]:
    """Copy files into a folder beside the final one; it goes, unless it was moved there.

    Errors speak of `place`, where the files are, instead of the copies.
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
        needed = sum(path.stat().st_size for path in files.values())
        free = shutil.disk_usage(folder).free
        if needed > free:
            reason = f"{needed / 1e6:.0f} MB are needed, {free / 1e6:.0f} are free"
            raise FileError(final.parent, reason, fix=_SPACE)
        for part, path in files.items():
            try:
                _copy(path, folder / part)
            except OSError as error:
                raise FileError(path, error.strerror or str(error), fix=_SPACE) from error
        yield folder
    except ModelError as error:
        raise ModelError(str(error).replace(str(folder), str(place))) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _copy(path: Path, copy: Path) -> None:
    copy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, copy)
    with copy.open("rb") as file:
        os.fsync(file.fileno())


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


def _matching(name: str | None, found: Mapping[str, Path]) -> ModelEntry | None:
    """Return the manifest's model of that name, or without one the only one whose files fit.

    Without a name, the files of weights must bear the manifest's names, see `_fits`.
    """
    models = read_shipped().models
    if name is not None:
        return next((entry for entry in models if entry.name == name), None)
    fitting = [entry for entry in models if entry.package is None and _fits(entry, found)]
    return fitting[0] if len(fitting) == 1 else None


def _fits(entry: ModelEntry, found: Mapping[str, Path]) -> bool:
    """Return whether the files of weights bear an entry's names.

    Names that any model has ("model.safetensors") must come with the size too. Any other is taken
    for what it says, so that a wrong file of that name is refused and not made a model of its own.
    """
    parts = _parts_of(entry)
    heavy = [part for part in parts if part.endswith((".safetensors", ".gguf"))]
    return bool(heavy) and all(
        part in found
        and (not part.startswith("model") or found[part].stat().st_size == parts[part].bytes)
        for part in heavy
    )


def _parts_of(entry: ModelEntry) -> dict[str, ModelFile]:
    """Return an entry's files by their path inside the model's folder."""
    common = os.path.commonpath([Path(file.path).parent for file in entry.files])
    return {os.path.relpath(file.path, common): file for file in entry.files}


def _met(shipped: ModelEntry, folder: Path, hashes: Hashes) -> Hashes:
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
        if value not in (None, "") and key != "in_place"
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
