"""Build a bundle: wheels, models, scenes, experiments, licences.

Equal inputs give equal bytes: members are sorted, and the tar knows no time, owner or machine.
"""

import hashlib
import io
import os
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import msgspec
from packaging.requirements import Requirement

import karma
from karma.bundle.contents import (
    CHUNK,
    END,
    MANIFEST,
    BundleError,
    Member,
    header,
    manifest_bytes,
    padding,
    unsafe,
)
from karma.bundle.install import here
from karma.bundle.verify import Say
from karma.bundle.wheels import (
    Wheel,
    download,
    find_wheels,
    kept_wheels,
    licence_texts,
    own_wheel,
    read_lock,
    read_wheel,
)
from karma.errors import FileError
from karma.infer.manifest.added_entry import entry_toml
from karma.infer.manifest.manifest import (
    ModelEntry,
    check,
    file_paths,
    find_model,
    read_manifest,
    verify,
)
from karma.infer.manifest.manifest import manifest_path as models_manifest

PROJECT = Path(karma.__file__).parents[1]
_SHIPPED = ("__init__.py", "errors.py", "bundle/__init__.py", "bundle/contents.py")
INSTALLER = (*_SHIPPED, "bundle/verify.py", "bundle/install.py")
_MAIN = b"import sys\n\nfrom karma.bundle.install import main\n\nsys.exit(main())\n"


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
    project: Path = PROJECT
    own: Path | None = None  # the project's wheel, if it is built already


@dataclass(frozen=True, slots=True, kw_only=True)
class MemberSource:
    """Where a member's bytes come from."""

    path: str
    file: Path | None = None
    data: bytes = b""
    unpacked: int | None = None

    def open(self) -> IO[bytes]:
        """Open it for reading."""
        return io.BytesIO(self.data) if self.file is None else self.file.open("rb")

    @property
    def executable(self) -> bool:
        """Whether it is a program; nothing but a Unity build has any."""
        return self.path.startswith("thor/") and os.access(self.file or "", os.X_OK)


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltBundle:
    """A bundle that lies on the disk."""

    path: Path
    sha256: str
    bytes: int
    members: int
    wheels: int
    models: tuple[str, ...]


def build(out: Path, spec: BundleSpec, *, say: Say = lambda _: None) -> BuiltBundle:
    """Put a bundle together and write it, whole or not at all.

    Raises:
        BundleError: a wheel is missing, or a path cannot be carried.
        ModelError: a model is missing or not as it must be.
        FileError: something cannot be read or written.
    """
    entries = _models(spec.models)
    with tempfile.TemporaryDirectory() as folder:
        wheels = _wheels(spec, Path(folder), say)
        sources = [
            *map(_wheel_source, wheels),
            *_model_sources(entries, {one.name for one in wheels}),
            *_folder("eval", spec.project / "eval"),
            *_scene_sources(spec.scenes),
            *(() if spec.thor is None else _folder("thor", spec.thor)),
            *_licence_sources(wheels, entries),
            *_papers(spec.project),
        ]
        say(f"hashing {len(sources)} files")
        members = _members(sources)
        python, machine = here()
        about: dict[str, object] = {
            "karma": karma.__version__,
            "python": python,
            "platform": machine,
            "models": [entry.name for entry in entries],
        }
        say(f"writing {out}")
        digest = _write(out, manifest_bytes(about, members), sources, members)
    return BuiltBundle(
        path=out,
        sha256=digest,
        bytes=out.stat().st_size,
        members=len(members),
        wheels=len(wheels),
        models=tuple(entry.name for entry in entries),
    )


# ----------------------------------------------------------------- what goes in


def _wheel_source(wheel: Wheel) -> MemberSource:
    return MemberSource(path=f"wheels/{wheel.path.name}", file=wheel.path, unpacked=wheel.unpacked)


def _wheels(spec: BundleSpec, scratch: Path, say: Say) -> list[Wheel]:
    wanted = read_lock(spec.lock)
    if spec.extras is not None:
        wanted += read_lock(spec.extras)
    if spec.download:
        say(f"fetching {len(wanted)} packages into {spec.wheels}; this takes minutes")
        download(wanted, spec.wheels)
    elif not spec.wheels.is_dir():
        fix = "give --wheels FOLDER, or --download where there is a package index"
        raise FileError(spec.wheels, "no such folder", fix=fix)
    folders = (spec.wheels, kept_wheels())
    if any(spec.wheels.glob("pip-*.whl")):  # then no ensurepip is needed on the other side
        wanted = [*wanted, Requirement("pip")]
    found = find_wheels(wanted, folders)
    if spec.own is None:
        say("building the wheel of karma-offline")
    ours = read_wheel(spec.own or own_wheel(spec.project, scratch))
    named = {one.name for one in found}
    lacking = [one for one in find_wheels(ours.needs, folders) if one.name not in named]
    kept = [one for one in [*found, *lacking] if one.name != ours.name]
    return sorted([*kept, ours], key=lambda one: one.name)


def _models(names: Sequence[str]) -> tuple[ModelEntry, ...]:
    """Return the named models, or all that are here; each verified."""
    if names:
        entries = [find_model(name) for name in dict.fromkeys(names)]
    else:
        entries = [one for one in read_manifest().models if check(one).state != "absent"]
    for entry in entries:
        verify(entry)
    return tuple(entries)


def _model_sources(entries: Sequence[ModelEntry], packages: Set[str]) -> Iterator[MemberSource]:
    """Yield the manifest, the cards, and the chosen models' files, all below models/.

    Of a model in a package the wheel comes along; where it does not, its files do.
    """
    manifest = models_manifest()
    yield MemberSource(path="models/manifest.toml", file=manifest)
    yield from _folder("models/cards", manifest.parent / "cards")
    brought: list[ModelEntry] = []
    for entry in entries:
        if entry.package is not None and entry.package.replace("_", "-") in packages:
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
            yield MemberSource(path=f"models/{name}", file=place)
    if brought:
        text = "# Models that came with the bundle.\n\n" + "\n".join(map(entry_toml, brought))
        yield MemberSource(path="models/local.toml", data=text.encode())


def _scene_sources(given: Sequence[Path]) -> Iterator[MemberSource]:
    """Yield scene files, each read first: a damaged one must not come to light over there."""
    from karma.world.core import scene

    for place in given:
        paths = sorted(place.glob("*.json")) if place.is_dir() else [place]
        if not paths:
            raise FileError(place, "no scene files (*.json) in this folder")
        for path in paths:
            scene.load(path)
            yield MemberSource(path=f"scenes/{path.name}", file=path)


def _folder(name: str, folder: Path) -> Iterator[MemberSource]:
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
            yield MemberSource(path=f"{name}/{inside}", file=path)


def _licence_sources(
    wheels: Sequence[Wheel], models: Sequence[ModelEntry]
) -> Iterator[MemberSource]:
    """Yield each package's licence files and one list of all licences."""
    lines = [f"{one.name} {one.version}: {one.licence}" for one in wheels]
    lines += [f"model {one.name}: {one.licence}" for one in models]
    yield MemberSource(path="licences/LICENCES.txt", data=("\n".join(lines) + "\n").encode())
    for wheel in wheels:
        for name, text in licence_texts(wheel).items():
            path = f"licences/{wheel.name}-{wheel.version}/{name}"
            if not unsafe(path):
                yield MemberSource(path=path, data=text)


def _papers(project: Path) -> Iterator[MemberSource]:
    for name, path in (("LICENSE", "LICENSE"), ("AIRGAP.md", "docs/airgap.md")):
        if (project / path).is_file():
            yield MemberSource(path=name, file=project / path)
    yield MemberSource(path="install.pyz", data=installer())


def installer() -> bytes:
    """Return the program that installs a bundle: a zip that Python runs, always the same bytes."""
    package = Path(karma.__file__).parent
    result = io.BytesIO()
    with zipfile.ZipFile(result, "w", zipfile.ZIP_STORED) as file:
        file.writestr(zipfile.ZipInfo("__main__.py"), _MAIN)
        for name in INSTALLER:
            file.writestr(zipfile.ZipInfo(f"karma/{name}"), (package / name).read_bytes())
    return result.getvalue()


# ----------------------------------------------------------------- the tar


def _members(sources: Sequence[MemberSource]) -> list[Member]:
    members = []
    for one in sources:
        header(one.path, 0)  # refuses a path that is too long
        digest, size = hashlib.sha256(), 0
        try:
            with one.open() as file:
                while part := file.read(CHUNK):
                    digest.update(part)
                    size += len(part)
        except OSError as error:
            raise FileError(one.file or one.path, error.strerror or str(error)) from error
        members.append(
            Member(
                path=one.path,
                bytes=size,
                sha256=digest.hexdigest(),
                executable=one.executable,
                unpacked=one.unpacked,
            )
        )
    return members


def _write(
    out: Path, manifest: bytes, sources: Sequence[MemberSource], members: Sequence[Member]
) -> str:
    """Write the tar beside its place and move it there; return its SHA-256."""
    places = {one.path: one for one in sources}
    whole = hashlib.sha256()
    part = out.with_name(f".{out.name}.part")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:

            def put(data: bytes) -> None:
                whole.update(data)
                file.write(data)

            put(header(MANIFEST, len(manifest)) + manifest + bytes(padding(len(manifest))))
            for member in members:
                put(header(member.path, member.bytes, executable=member.executable))
                _copy(places[member.path], member, put)
                put(bytes(padding(member.bytes)))
            put(END)
            file.flush()
            os.fsync(file.fileno())
        part.replace(out)
    except OSError as error:
        fix = "free some space there, or choose another folder"
        raise FileError(out, f"cannot write: {error.strerror or error}", fix=fix) from error
    finally:
        with suppress(OSError):
            part.unlink()
    return whole.hexdigest()


def _copy(source: MemberSource, member: Member, put: Callable[[bytes], None]) -> None:
    """Write a member's bytes, which must still be those that were hashed."""
    digest = hashlib.sha256()
    with source.open() as file:
        while data := file.read(CHUNK):
            digest.update(data)
            put(data)
    if digest.hexdigest() != member.sha256:
        raise BundleError(f"{source.file or source.path}: it changed while the bundle was written")
