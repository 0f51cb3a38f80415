"""Build a bundle, a tar of wheels, models, scenes, experiments and licences with their SHA-256.

Equal inputs give equal bytes: members are sorted, and the tar knows no time, owner or machine.
"""

import hashlib
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import Distribution
from pathlib import Path

import msgspec
from packaging.utils import canonicalize_name

import karma
from karma.errors import FileError, KarmaError
from karma.files import cache
from karma.models.added import entry_toml
from karma.models.manifest import (
    ModelEntry,
    check,
    file_paths,
    find_model,
    read_manifest,
    verify,
)
from karma.models.manifest import manifest_path as models_manifest
from karma.plugins.airgap import install

PROJECT = Path(karma.__file__).parents[1]

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class BundleSpec:
    """What goes into a bundle."""

    wheels: Path  # folder
    download: bool = False
    models: tuple[str, ...] = ()  # () = all that are here and right
    scenes: tuple[Path, ...] = ()  # files or folders, beside those of the package
    thor: Path | None = None  # a Unity build's folder
    lock: Path = PROJECT / "requirements.lock"
    extras: Path | None = None  # pins of what only extras need, if that is to come along
    own: Path | None = None  # the project's wheel, if it is built already


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltBundle:
    """A bundle that lies on the disk."""

    path: Path
    sha256: str
    bytes: int
    members: int
    wheels: int
    models: tuple[str, ...]


Source = tuple[str, Path | bytes]  # a member's path, and its file or its bytes


def build(out: Path, spec: BundleSpec, *, say: Say = lambda _: None) -> BuiltBundle:
    """Put a bundle together and write it, whole or not at all.

    Raises:
        KarmaError: a wheel is missing, or a path cannot be carried.
        ModelError: a model is missing or not as it must be.
        FileError: something cannot be read or written.
    """
    entries = _models(spec.models)
    with tempfile.TemporaryDirectory() as folder:
        if not spec.download and not spec.wheels.is_dir():
            fix = "give --wheels FOLDER, or --download where there is a package index"
            raise FileError(spec.wheels, "no such folder", fix=fix)
        say("collecting wheels; with --download this takes minutes")
        own = spec.own or own_wheel(PROJECT, Path(folder))
        pins = [path for path in (spec.lock, spec.extras) if path is not None]
        chosen = Path(folder) / "wheels"
        collect(pins, own, spec.wheels, chosen, download=spec.download)
        wheels = sorted(chosen.glob("*.whl"))
        packages = {canonicalize_name(one.name.partition("-")[0]) for one in wheels}
        python, machine = install.here()
        models = [entry.name for entry in entries]
        about = {
            "karma": karma.__version__, "python": python, "platform": machine, "models": models
        }  # fmt: skip
        papers = {
            "LICENSE": PROJECT / "LICENSE", "AIRGAP.md": PROJECT / "docs/plugins/airgap.md"
        }  # fmt: skip
        sources: dict[str, Path | bytes] = {  # models may share a file
            install.ABOUT: json.dumps(about, indent=1).encode(),
            install.INSTALLER: Path(install.__file__),
            **{f"wheels/{one.name}": one for one in wheels},
            **dict(_model_sources(entries, packages)),
            **dict(_folder("eval", PROJECT / "eval")),
            **dict(_scene_sources(spec.scenes)),
            **({} if spec.thor is None else dict(_folder("thor", spec.thor))),
            **dict(_licence_sources(wheels, entries)),
            **{name: path for name, path in papers.items() if path.is_file()},
        }
        say(f"writing {len(sources)} files into {out}")
        digest = _write(out, sources)
    return BuiltBundle(
        path=out, sha256=digest, bytes=out.stat().st_size, members=len(sources),
        wheels=len(wheels), models=tuple(models),
    )  # fmt: skip


# ----------------------------------------------------------------- what goes in


def _models(names: Sequence[str]) -> tuple[ModelEntry, ...]:
    """Return the named models, or all that are here; each verified."""
    if names:
        entries = [find_model(name) for name in dict.fromkeys(names)]
    else:
        entries = [one for one in read_manifest().models if check(one).state != "absent"]
    for entry in entries:
        verify(entry)
    return tuple(entries)


def _model_sources(entries: Sequence[ModelEntry], packages: Set[str]) -> Iterator[Source]:
    """Yield the manifest, the cards, and the chosen models' files, all below models/.

    Of a model in a package the wheel comes along; where it does not, its files do.
    """
    manifest = models_manifest()
    yield "models/manifest.toml", manifest
    yield from _folder("models/cards", manifest.parent / "cards")
    brought: list[ModelEntry] = []
    for entry in entries:
        if entry.package is not None and canonicalize_name(entry.package) in packages:
            continue
        places = file_paths(entry)
        names = [file.path for file in entry.files]
        if entry.package is not None or any(Path(name).is_absolute() for name in names):
            shared = Path(os.path.commonpath([place.parent for place in places]))
            names = [f"weights/{entry.name}/{place.relative_to(shared)}" for place in places]
        files = tuple(
            msgspec.structs.replace(file, path=name)
            for file, name in zip(entry.files, names, strict=True)
        )
        if any(name.startswith("weights/") for name in names):
            brought.append(msgspec.structs.replace(entry, files=files, package=None))
        for name, place in zip(names, places, strict=True):
            yield f"models/{name}", place
    if brought:
        text = "# Models that came with the bundle.\n\n" + "\n".join(map(entry_toml, brought))
        yield "models/local.toml", text.encode()


def _scene_sources(given: Sequence[Path]) -> Iterator[Source]:
    """Yield scene files, each read first: a damaged one must not come to light over there."""
    from karma.world.core import scene

    for place in given:
        paths = sorted(place.glob("*.json")) if place.is_dir() else [place]
        if not paths:
            raise FileError(place, "no scene files (*.json) in this folder")
        for path in paths:
            scene.load(path)
            yield f"scenes/{path.name}", path


def _folder(name: str, folder: Path) -> Iterator[Source]:
    """Yield a folder's files; hidden ones stay, links are refused."""
    if not folder.is_dir():
        raise FileError(folder, "no such folder")
    for path in sorted(folder.rglob("*")):
        inside = path.relative_to(folder).as_posix()
        if inside.startswith(".") or "/." in inside or "__pycache__" in inside:
            continue
        if path.is_symlink():
            raise FileError(path, "a link cannot be carried", fix="put the file in its place")
        if path.is_file():
            yield f"{name}/{inside}", path


def _licence_sources(wheels: Sequence[Path], models: Sequence[ModelEntry]) -> Iterator[Source]:
    """Yield each package's licence files and one list of all licences."""
    lines = []
    for wheel in wheels:
        line, texts = licence(wheel)
        lines.append(line)
        for name, text in texts.items():
            path = f"licences/{'-'.join(wheel.name.split('-')[:2])}/{name}"
            if not install.unsafe(path):
                yield path, text
    lines += [f"model {one.name}: {one.licence}" for one in models]
    yield "licences/LICENCES.txt", ("\n".join(lines) + "\n").encode()


# ----------------------------------------------------------------- the tar


def _write(out: Path, sources: Mapping[str, Path | bytes]) -> str:
    """Write the tar beside its place and move it there; return its SHA-256."""
    part = out.with_name(f".{out.name}.part")
    sums = []
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with part.open("w+b") as file:
            with tarfile.open(fileobj=file, mode="w", format=tarfile.GNU_FORMAT) as tar:
                for path, source in sources.items():
                    sums.append(f"{_add(tar, path, source)}  {path}\n")
                _add(tar, install.SUMS, "".join(sums).encode())
            file.flush()
            os.fsync(file.fileno())
            file.seek(0)
            whole = hashlib.file_digest(file, "sha256").hexdigest()
        part.replace(out)
    except OSError as error:
        fix = "free some space there, or choose another folder"
        raise FileError(out, f"cannot write: {error.strerror or error}", fix=fix) from error
    finally:
        with suppress(OSError):
            part.unlink()
    return whole


def _add(tar: tarfile.TarFile, path: str, source: Path | bytes) -> str:
    """Append a file without time or owner; return its SHA-256."""
    if install.unsafe(path):
        raise FileError(path, "its name cannot be carried", fix="rename it")
    info = tarfile.TarInfo(path)
    info.mode = 0o644
    try:
        with io.BytesIO(source) if isinstance(source, bytes) else source.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            info.size = file.seek(0, os.SEEK_END)
            file.seek(0)
            if path.startswith("thor/") and os.access(str(source), os.X_OK):
                info.mode = 0o755  # nothing but a Unity build has programs
            tar.addfile(info, file)
    except OSError as error:
        raise FileError(path, error.strerror or str(error)) from error
    return digest


BUILT = ".karma-llama"  # set-up's note, in the virtual environment, about llama.cpp's wheel
EPOCH = "315532800"  # 1980-01-01, the first day that a zip can name
_LICENCE_NAMES = ("licenses/", "licen", "copying", "notice", "authors")
_SOURCES = ("karma", "pyproject.toml", "README.md", "LICENSE")


def collect(pins: Sequence[Path], own: Path, kept: Path, out: Path, *, download: bool) -> None:
    """Put our own wheel and what the pins and it need into `out`, chosen by pip for this machine.

    With `download` what is missing in `kept` is first fetched there from the index that pip is
    configured for, the one thing here that reaches out. What exists as source only is built.

    Raises:
        KarmaError: pip could not; names what is missing.
        FileError: a wheel is none.
    """
    known = ["--find-links", str(kept), "--find-links", str(kept_wheels())]
    wanted = [word for path in pins for word in ("-r", str(path))] + [str(own)]
    if download:
        kept.mkdir(parents=True, exist_ok=True)
        _pip([*known, "--wheel-dir", str(kept), *wanted, "pip"])
    if any(kept.glob("pip-*.whl")):  # then no ensurepip is needed on the other side
        wanted.append("pip")
    for wheel in sorted(kept.glob("*.whl")):
        if not zipfile.is_zipfile(wheel):
            raise FileError(wheel, "not a whole wheel", fix="remove it, then --download")
    fix = "`karma bundle build ... --download` where there is a package index"
    _pip(["--no-index", *known, "--wheel-dir", str(out), *wanted], fix=fix)


def licence(wheel: Path) -> tuple[str, dict[str, bytes]]:
    """Return a line of a package's name, version and licence, and its licence files by name."""
    (one,) = Distribution.discover(path=[str(wheel)])
    said = one.metadata
    classifiers = said.get_all("Classifier") or ()
    named = [line.split(" :: ")[-1] for line in classifiers if line.startswith("License ::")]
    keys = ("License-Expression", "License")
    given = next((str(said[key]).strip() for key in keys if key in said), "")
    short = given.split("\n")[0][:60] or "; ".join(named) or "not stated"
    texts = {}
    with zipfile.ZipFile(wheel) as file:
        for path in file.namelist():
            folder, _, inside = path.partition("/")
            if folder.endswith(".dist-info") and inside.lower().startswith(_LICENCE_NAMES):
                texts[inside.removeprefix("licenses/")] = file.read(path)
    texts = {name: text for name, text in texts.items() if name and not name.endswith("/")}
    return f"{one.name} {one.version}: {short}", texts


def own_wheel(project: Path, folder: Path) -> Path:
    """Build this package's wheel; equal sources give equal bytes.

    It is built from a copy, since setuptools leaves things in the sources and takes them up again.

    Raises:
        KarmaError: it cannot be built.
    """
    if not (project / "pyproject.toml").is_file():
        raise KarmaError(f"{project}: no checkout of the project, so no wheel can be made of it")
    with tempfile.TemporaryDirectory() as name:
        copy = Path(name)
        ignored = shutil.ignore_patterns("__pycache__", "*.pyc")
        for source in (project / name for name in _SOURCES):
            if source.is_dir():
                shutil.copytree(
                    source, copy / source.name, ignore=ignored, copy_function=shutil.copyfile
                )
            elif source.exists():
                shutil.copyfile(source, copy / source.name)
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
        return cache() / "wheels"
    return Path(folder)


def _pip(arguments: Sequence[str], *, fix: str = "see the lines above", **more: str) -> None:
    """Run `pip wheel`, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-I", "-m", "pip", "wheel", "--no-input", "--quiet", *arguments],
        env={**os.environ, "PIP_DISABLE_PIP_VERSION_CHECK": "1", **more},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        tail = "\n".join((done.stderr or done.stdout).strip().splitlines()[-12:])
        raise KarmaError(
            f"pip wheel failed (exit code {done.returncode}):\n{tail}\n  To fix: {fix}"
        )
