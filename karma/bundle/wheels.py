"""Find the wheels of a bundle, fetch them if asked to, read their licences and needs."""

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from email.message import Message
from email.parser import HeaderParser
from functools import cache
from pathlib import Path

from packaging.requirements import InvalidRequirement, Requirement
from packaging.tags import sys_tags
from packaging.utils import InvalidWheelFilename, canonicalize_name, parse_wheel_filename

from karma.bundle.contents import BundleError
from karma.errors import FileError
from karma.files import read_bytes

BUILT = ".karma-llama"  # set-up's note, in the virtual environment, about llama.cpp's wheel
EPOCH = "315532800"  # 1980-01-01, the first day that a zip can name
_LICENCE_NAMES = ("licen", "copying", "notice", "authors")
_SOURCES = ("karma", "pyproject.toml", "README.md", "LICENSE")


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheel:
    """One wheel and what its metadata say."""

    path: Path
    name: str  # canonical
    version: str
    licence: str  # SPDX where the package gives it so
    needs: tuple[Requirement, ...]  # those that hold here, without extras
    licence_files: tuple[str, ...]  # paths inside the wheel
    unpacked: int  # bytes


def read_lock(path: Path) -> list[Requirement]:
    """Return the pinned requirements that hold on this machine.

    Raises:
        FileError: a line is none.
    """
    found = []
    for number, line in enumerate(read_bytes(path).decode().splitlines(), start=1):
        text = line.split(" #")[0].strip()
        if not text or text.startswith("#"):
            continue
        try:
            one = Requirement(text)
        except InvalidRequirement as error:
            raise FileError(path, f"line {number}: {error}") from error
        if one.marker is None or one.marker.evaluate():
            found.append(one)
    return found


def find_wheels(wanted: Iterable[Requirement], folders: Sequence[Path]) -> list[Wheel]:
    """Return a wheel for each requirement and for whatever those need, by name.

    Raises:
        BundleError: some are not there; names them.
    """
    there = _by_name(folders)
    chosen: dict[str, Wheel] = {}
    missing: list[str] = []
    todo = [(one, "") for one in wanted]
    while todo:
        one, by = todo.pop(0)
        name = canonicalize_name(one.name)
        if name in chosen:
            continue
        path = _best(there.get(name, ()), one)
        if path is None:
            missing.append(f"{one}{by}")
            continue
        chosen[name] = read_wheel(path)
        todo += [(need, f" (needed by {name})") for need in chosen[name].needs]
    if missing:
        missing = list(dict.fromkeys(missing))
        places = ", ".join(map(str, folders))
        more = f" and {len(missing) - 10} more" if len(missing) > 10 else ""
        raise BundleError(
            f"no wheel that fits this machine for {'; '.join(missing[:10])}{more}\n"
            f"  Looked in: {places}\n"
            "  To fix: `karma bundle build ... --download` where there is a package index"
        )
    return [chosen[name] for name in sorted(chosen)]


def _by_name(folders: Sequence[Path]) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for folder in folders:
        for path in sorted(folder.glob("*.whl")):
            try:
                found.setdefault(parse_wheel_filename(path.name)[0], []).append(path)
            except InvalidWheelFilename as error:
                raise FileError(path, str(error)) from error
    return found


def _best(paths: Iterable[Path], wanted: Requirement) -> Path | None:
    """Return the wheel that fits this machine best; equal ones by name."""
    fitting = []
    for path in paths:
        _, version, _, tags = parse_wheel_filename(path.name)
        ranks = [_ranks()[str(tag)] for tag in tags if str(tag) in _ranks()]
        if ranks and wanted.specifier.contains(version, prereleases=True):
            fitting.append((min(ranks), path.name, path))
    return min(fitting)[2] if fitting else None


@cache
def _ranks() -> dict[str, int]:
    return {str(tag): rank for rank, tag in enumerate(sys_tags())}


def read_wheel(path: Path) -> Wheel:
    """Read a wheel's metadata.

    Raises:
        FileError: it is damaged.
    """
    name, version, _, _ = parse_wheel_filename(path.name)
    try:
        with zipfile.ZipFile(path) as wheel:
            entries = wheel.infolist()
            info = next(e.filename for e in entries if e.filename.endswith(".dist-info/METADATA"))
            said = HeaderParser().parsestr(wheel.read(info).decode("utf-8", "replace"))
    except (zipfile.BadZipFile, OSError, StopIteration, KeyError) as error:
        raise FileError(path, f"not a whole wheel: {error}", fix="fetch it again") from error
    folder = info.removesuffix("METADATA")
    inside = [e.filename for e in entries if e.filename.startswith(folder)]
    needs = [Requirement(text) for text in said.get_all("Requires-Dist") or ()]
    return Wheel(
        path=path,
        name=name,
        version=str(version),
        licence=_licence(said),
        needs=tuple(r for r in needs if r.marker is None or r.marker.evaluate({"extra": ""})),
        licence_files=tuple(sorted(p for p in inside if _is_licence(p.removeprefix(folder)))),
        unpacked=sum(entry.file_size for entry in entries),
    )


def _is_licence(inside: str) -> bool:
    if inside.endswith("/"):
        return False
    return inside.startswith("licenses/") or inside.lower().startswith(_LICENCE_NAMES)


def _licence(said: Message) -> str:
    """Return a package's licence in a line, as far as its metadata say."""
    if expression := said.get("License-Expression"):
        return str(expression)
    classifiers = [str(line) for line in said.get_all("Classifier") or ()]
    named = [line.split(" :: ")[-1] for line in classifiers if line.startswith("License ::")]
    first = str(said.get("License") or "").strip().split("\n")[0].strip()
    if first and first != "UNKNOWN" and len(first) <= 60:
        return first
    return "; ".join(named) or first[:60] or "not stated"


def licence_texts(wheel: Wheel) -> dict[str, bytes]:
    """Return a wheel's licence files by their name without the folder of its metadata."""
    with zipfile.ZipFile(wheel.path) as file:
        return {
            path.split("/", 1)[1].removeprefix("licenses/"): file.read(path)
            for path in wheel.licence_files
        }


# ----------------------------------------------------------------- made and fetched


def own_wheel(project: Path, folder: Path) -> Path:
    """Build this package's wheel; equal sources give equal bytes.

    It is built from a copy, since setuptools leaves things in the sources and takes them up again.

    Raises:
        BundleError: it cannot be built.
    """
    if not (project / "pyproject.toml").is_file():
        raise BundleError(f"{project}: no checkout of the project, so no wheel can be made of it")
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name)
        for source in _SOURCES:
            if (project / source).is_dir():
                ignored = shutil.ignore_patterns("__pycache__", "*.pyc")
                shutil.copytree(
                    project / source, copy / source, ignore=ignored, copy_function=shutil.copyfile
                )
            elif (project / source).exists():
                shutil.copyfile(project / source, copy / source)
        for path in copy.rglob("*"):
            path.chmod(0o755 if path.is_dir() else 0o644)
        _pip(
            ["--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(folder), name],
            SOURCE_DATE_EPOCH=EPOCH,
        )
    (made,) = folder.glob("karma_offline-*.whl")
    return made


def kept_wheels() -> Path:
    """Return where scripts/setup.sh keeps the llama-cpp-python wheel that runs here.

    There is a folder per set of build options; without a note of set-up's, the one above them.
    """
    try:
        _, _, folder = (Path(sys.prefix) / BUILT).read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return cache_folder() / "wheels"
    return Path(folder)


def cache_folder() -> Path:
    """Return $KARMA_CACHE, by default ~/.cache/karma."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(os.environ.get("KARMA_CACHE") or f"{home}/karma")


def download(wanted: Sequence[Requirement], folder: Path) -> None:
    """Fetch into `folder`, by the index that pip is configured for, what is not there.

    The one thing here that reaches out; pip does it, in a process of its own. What exists as source
    only is built.

    Raises:
        BundleError: pip could not.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        fetched = Path(name)
        listed = fetched / "wanted.txt"
        lines = [str(one) for one in wanted if canonicalize_name(one.name) != "llama-cpp-python"]
        listed.write_text("\n".join([*lines, "pip", ""]))
        known = ["--find-links", str(folder), "--find-links", str(kept_wheels())]
        _pip([*known, "--wheel-dir", name, "-r", str(listed)])
        for wheel in sorted(fetched.glob("*.whl")):
            shutil.move(wheel, folder / wheel.name)


def _pip(arguments: Sequence[str], **environment: str) -> None:
    done = subprocess.run(
        [sys.executable, "-I", "-m", "pip", "wheel", "--no-input", "--quiet", *arguments],
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        tail = "\n".join((done.stderr or done.stdout).strip().splitlines()[-12:])
        raise BundleError(f"pip wheel failed (exit code {done.returncode}):\n{tail}")
