"""Add and remove models that somebody brought (`karma models add` and `remove`).

Added files are copied to `weights/NAME` beside the manifest, hashed on the way, tried, and entered
in local.toml last; with `in_place`, or where they lie there already, they stay as they are.
Nothing is parsed before all hashes that the manifest knows were met, and nothing that was there
before is lost when anything fails.
"""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec

from karma.errors import FileError, KarmaError, ModelError
from karma.files import sha256_of, write_atomic
from karma.infer.manifest.added_entry import AddOptions, entry_of, entry_toml
from karma.infer.manifest.added_files import files_of, matching
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
    intake = _Intake(found, place, progress)
    own = local_path(manifest).parent / "weights" / name
    if options.in_place or place.resolve() == own.resolve():
        hashes = {part: intake.hashed(part) for part in found}
        entry = entry_of(name, shipped, options, place, hashes, prefix=place)
        if trial is not None:
            trial(entry, place)
        _write_local([*read_local(manifest).models, entry], manifest)
    else:
        entry = _copied(name, shipped, options, intake, manifest, trial)
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


class _Intake:
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
    options: AddOptions,
    intake: _Intake,
    manifest: str | Path | None,
    trial: Trial | None,
) -> ModelEntry:
    """Copy, check, try, and only then put in place and enter in local.toml."""
    base = local_path(manifest).parent
    final = base / "weights" / name
    if final.exists():
        fix = f"`karma models add {final} --name {name}` if it is this model, or remove it by hand"
        raise FileError(final, "there is something already", fix=fix)
    temporary = _temporary_beside(final)
    try:
        _check_space(temporary, intake.found.values())
        hashes = {part: intake.hashed(part, copy=temporary / part) for part in intake.found}
        prefix = Path("weights") / name
        try:
            entry = entry_of(name, shipped, options, temporary, hashes, prefix=prefix)
            if trial is not None:
                trial(entry, temporary)
        except ModelError as error:  # about the copy; the user knows the file that was given
            raise ModelError(str(error).replace(str(temporary), str(intake.place))) from error
        temporary.chmod(0o755)
        temporary.rename(final)
        try:
            _write_local([*read_local(manifest).models, entry], manifest)
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
