"""Add and remove models that somebody brought (`karma models add` and `remove`).

Added files are copied to `weights/NAME` beside the manifest, hashed on the way, tried, and entered
in local.toml last; with `in_place`, or where they lie there already, they stay as they are.
Nothing is parsed before all hashes that the manifest knows were met, and nothing that was there
before is lost when anything fails.
"""

import os
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec

from karma.errors import FileError, KarmaError, ModelError
from karma.files import sha256_of, write_atomic
from karma.infer.manifest.added_entry import AddOptions, entry_of, entry_toml, files_of, matching
from karma.infer.manifest.manifest import (
    Manifest,
    ModelEntry,
    local_path,
    read_local,
    read_shipped,
)

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
