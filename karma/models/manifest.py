"""Read models/manifest.toml, and verify every file before a byte of it is parsed.

Two files make the list: `manifest.toml`, which ships and is only read, and `local.toml` beside it,
which holds what `karma models add` brought (`added`) and which git ignores.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import msgspec

from karma.errors import FileError, KarmaError, ModelError, UnknownNameError, did_you_mean
from karma.files import read_bytes, read_toml, repair, sha256_of, shipped
from karma.models.checks.gguf import check_gguf, is_gguf, split_pair

Role = Literal["planner", "vlm", "text-embedder", "image-embedder", "parser"]
State = Literal["ok", "absent", "wrong"]

PLANNERS = ("karma-mini", "karma-nano")  # of these the first that is here plans, if none is named
PLANNER = "KARMA_PLANNER"  # names another

_SHA256 = re.compile(r"[0-9a-f]{64}")


class ModelFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One file of a model, and what it must be."""

    path: str  # below the models folder, or `ModelEntry.package`; in local.toml also absolute
    sha256: str
    bytes: int

    def __post_init__(self) -> None:
        """Refuse a path that leaves its folder, and what is not a hash."""
        if ".." in PurePosixPath(self.path).parts or not self.path:
            raise ValueError(f"path {self.path!r} is empty or contains '..'")
        if not _SHA256.fullmatch(self.sha256):
            raise ValueError(f"{self.path}: sha256 is not 64 hexadecimal digits, lower case")


Profile = Literal["compact", "full", "goals", "tools"]
CAPABLE_BYTES = 3_000_000_000  # of a GGUF; from here on a model is left to call tools itself


def suited_profile(metadata: Mapping[str, Any], size_bytes: int) -> Profile:
    """Return the mode that suits a GGUF which nobody has described, by its header and size.

    A model with a chat template says goals if it is small, and calls tools if it is not; one
    without continues the text of the full prompt.
    """
    if "tokenizer.chat_template" not in metadata:
        return "full"
    return "tools" if size_bytes >= CAPABLE_BYTES else "goals"


class ModelEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One model of the manifest."""

    name: str
    role: Role
    format: Literal["gguf", "safetensors", "spacy"]
    files: tuple[ModelFile, ...]
    licence: str
    source: str
    assistant: str = ""  # planners only: the name in karma.assistants that suits it
    revision: str | None = None  # of the source, as its own version control names it
    restore: str | None = None  # the command that brings the files back
    package: str | None = None  # the files lie in this installed package, not beside the manifest
    pieces: tuple[str, ...] = ()  # packages, NAME==VERSION, that hold its file cut into pieces
    base: str = ""  # the model that its adapter changes: its first file is made of both
    prompt_profile: Profile | None = None  # planners only
    chat: bool | None = None  # planners only: by the GGUF's chat template; None: if it has one
    refuses: bool = False  # planners only: it has learnt to refuse requests
    words: str = ""  # planners only: path of the words file, of `files`, whose hints it reads
    context_length: int | None = None  # in tokens; planners: what is opened by default
    memory_mb: int | None = None  # once loaded, estimated upwards (docs/models.md)

    def __post_init__(self) -> None:
        """Refuse an entry that could not be used."""
        if not self.files:
            raise ValueError(f"model {self.name!r} has no files")
        if self.role == "planner" and (self.prompt_profile is None or self.context_length is None):
            raise ValueError(f"planner {self.name!r} needs prompt_profile and context_length")
        if self.base and len(self.files) < 3:
            raise ValueError(f"{self.name!r} needs its file, an adapter and the adapter's config")
        if self.words and self.words not in [file.path for file in self.files]:
            raise ValueError(f"words = {self.words!r} of {self.name!r} is none of its files")
        if not self.name or not self.name.isprintable() or "/" in self.name:
            raise ValueError(f"{self.name!r} is not a name: printable, without '/'")

    @property
    def fix(self) -> str:
        """The step that brings the files."""
        if self.pieces or self.base:
            return f"karma models bring {self.name}"
        if self.restore:
            in_git = self.restore.startswith("git ")
            return repair(self.restore) if in_git else self.restore
        at = f" at revision {self.revision}" if self.revision else ""
        return f"fetch {self.source}{at} where there is a network, then `karma models add FOLDER`"


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All models of one manifest file."""

    models: tuple[ModelEntry, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerFile:
    """A planner's GGUF, chosen by name or by path."""

    name: str
    path: Path
    sha256: str | None = None  # None for a file that no manifest vouches for
    prompt_profile: Profile = "full"
    chat: bool | None = None  # through its own chat template; None: if it has one
    fix: str = ""  # the step that brings the file back, where a manifest says
    refuses: bool = False  # it has learnt to refuse requests


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFolder:
    """A folder of safetensors, chosen by name (then every file is verified) or by path."""

    name: str
    path: Path
    fix: str  # the step that brings its files back


@dataclass(frozen=True, slots=True, kw_only=True)
class PicturePair:
    """A picture model's two files, chosen by name (then both are verified) or by their folder."""

    name: str
    model: Path
    projector: Path
    sha256: str | None = None  # of the model; None where no manifest vouches for the files


@dataclass(frozen=True, slots=True)
class ModelCheck:
    """Condition of a model's files."""

    name: str
    state: State
    detail: str


# ----------------------------------------------------------------- reading


def manifest_path() -> Path:
    """Return models/manifest.toml: below $KARMA_MODELS if set, else the one that ships."""
    folder = os.environ.get("KARMA_MODELS")
    return (Path(folder) if folder else shipped("models")) / "manifest.toml"


def local_path() -> Path:
    """Return the list of what was added: local.toml beside the manifest."""
    return manifest_path().with_name("local.toml")


def read_shipped() -> Manifest:
    """Read the manifest strictly, without what was added.

    FileError: missing, or a key is unknown, absent or of the wrong type, or a name twice.
    """
    path = manifest_path()
    fix = None if path.exists() else "set KARMA_MODELS to the folder that holds manifest.toml"
    return _parsed(path, read_bytes(path, fix=fix))


@lru_cache(maxsize=4)
def _parsed(path: Path, data: bytes) -> Manifest:
    """Return a manifest that was read: parsing takes 20 ms, and each model asks for it."""
    found = read_toml(path, Manifest)
    for entry in found.models:
        if any(PurePosixPath(file.path).is_absolute() for file in entry.files):
            raise FileError(path, f"model {entry.name!r}: absolute paths are for local.toml only")
    return _unique(found, path)


def read_local() -> Manifest:
    """Read what was added, nothing where there is no such file; FileError where it does not fit."""
    place = local_path()
    return _unique(read_toml(place, Manifest), place) if place.exists() else Manifest()


def read_manifest() -> Manifest:
    """Read the manifest together with what was added, which replaces a model of its name."""
    models = {entry.name: entry for entry in (*read_shipped().models, *read_local().models)}
    return Manifest(models=tuple(models.values()))


def find_model(name: str) -> ModelEntry:
    """Return the entry of that name; UnknownNameError suggests the nearest, and how to add one."""
    found = {entry.name: entry for entry in read_manifest().models}
    if name not in found:
        hint = did_you_mean(name, found)
        raise UnknownNameError(
            f"no model named {name!r}, nor such a file.{hint} In the manifest: {sorted(found)}\n"
            "  Nothing is ever fetched. To use another: `karma models add PATH` (docs/models.md)"
        )
    return found[name]


# ----------------------------------------------------------------- checking


def file_paths(entry: ModelEntry) -> tuple[Path, ...]:
    """Return where an entry's files lie, unchecked, in its order.

    ModelError where they lie in a package that is not installed.
    """
    folder = manifest_path().parent
    if entry.package is not None:
        spec = find_spec(entry.package)
        if spec is None or not spec.submodule_search_locations:
            file = entry.files[0]
            where = f"{file.path} of package {entry.package}"
            raise _wrong(where, "the package is not installed", file.sha256, entry.fix)
        folder = Path(spec.submodule_search_locations[0])
    return tuple(folder / file.path for file in entry.files)


def verify(entry: ModelEntry) -> tuple[Path, ...]:
    """Check size and SHA-256 of an entry's files and return their paths.

    Raises:
        ModelError: a file is missing or differs; names it, the hash it must have, and the fix.
    """
    paths = file_paths(entry)
    for file, place in zip(entry.files, paths, strict=True):
        check_file(place, file.sha256, size=file.bytes, restore=entry.fix)
    return paths


def check(entry: ModelEntry) -> ModelCheck:
    """Return an entry's condition instead of raising; every file that is there is hashed."""
    state: State = "absent"
    try:
        places = file_paths(entry)
        if not any(place.exists() for place in places):
            return ModelCheck(entry.name, "absent", entry.fix)
        state = "wrong"
        verify(entry)
    except ModelError as error:
        return ModelCheck(entry.name, state, str(error))
    return ModelCheck(entry.name, "ok", f"{len(places)} files as they must be")


def is_present(entry: ModelEntry) -> bool:
    """Return whether all files of an entry are there, whatever is in them."""
    try:
        return all(place.is_file() for place in file_paths(entry))
    except ModelError:
        return False


def check_file(path: Path, sha256: str, *, size: int | None = None, restore: str = "") -> None:
    """Check size and hash of a file; ModelError if it is missing or differs."""
    try:
        found = path.stat().st_size  # first, because it costs nothing
        digest = sha256_of(path) if size in (None, found) else ""
    except (FileError, OSError) as error:
        reason = error.reason if isinstance(error, FileError) else error.strerror or str(error)
        raise _wrong(path, reason, sha256, restore) from error
    if not digest:
        raise _wrong(path, f"it has {found} bytes instead of {size}", sha256, restore)
    if digest != sha256:
        raise _wrong(path, f"its SHA-256 is {digest}", sha256, restore)


# ----------------------------------------------------------------- choosing


def is_gguf_path(text: str) -> bool:
    """Return whether a planner is named by the path of a GGUF, and not by a model's name."""
    path = Path(text)
    named = path.suffix == "" and "/" not in text  # it may be either
    return is_gguf(path) and not (named and text in {one.name for one in read_manifest().models})


def default_planner() -> str:
    """Return the planner of who names none: $KARMA_PLANNER, else the best that is here."""
    named = os.environ.get(PLANNER)
    return named or next((one for one in PLANNERS if is_present(find_model(one))), PLANNERS[-1])


def resolve_planner(text: str) -> PlannerFile:
    """Find a planner by its name in the manifest, or take the path of any .gguf file.

    Nothing is opened here; `LlamaModel` checks the hash and the file.

    Raises:
        UnknownNameError: neither a name nor a .gguf path.
        ModelError: the name is not a planner's.
    """
    if is_gguf_path(text):
        return PlannerFile(name=Path(text).stem, path=Path(text), prompt_profile=_suited(text))
    entry = find_model(text)
    if entry.role != "planner" or entry.prompt_profile is None:
        raise ModelError(f"model {text!r} is not a planner but a model for role {entry.role!r}")
    return PlannerFile(
        name=entry.name, path=file_paths(entry)[0], sha256=entry.files[0].sha256,
        prompt_profile=entry.prompt_profile, chat=entry.chat, fix=entry.fix, refuses=entry.refuses,
    )  # fmt: skip


def _suited(path: str) -> Profile:
    """Return the mode that suits a file; "full" where it cannot be read, which opening it says."""
    try:
        return suited_profile(check_gguf(Path(path)), Path(path).stat().st_size)
    except (KarmaError, OSError):
        return "full"


def resolve_folder(text: str | Path, role: Role) -> ModelFolder:
    """Find a model of safetensors by its name in the manifest, or take the path of a folder.

    A named model's files are verified here, every one of them; a folder given by path has nobody
    to vouch for it, and adapters look at its headers only before they open it.

    Raises:
        UnknownNameError: neither a name nor a folder; never looked for anywhere else.
        ModelError: the model is of another role or format, or a file is missing or wrong.
    """
    if (folder := _given_folder(text)) is not None:
        fix = "bring the model's whole folder and run `karma models add FOLDER`"
        return ModelFolder(name=folder.name, path=folder, fix=fix)
    entry = find_model(str(text))
    if entry.role != role:
        raise ModelError(f"model {text!r} is not for role {role} but for {entry.role!r}")
    if entry.format != ("spacy" if entry.role == "parser" else "safetensors"):
        raise ModelError(f"model {text!r} is a {entry.format} file, not a folder of safetensors")
    places = verify(entry)
    common = Path(os.path.commonpath([place.parent for place in places]))
    return ModelFolder(name=entry.name, path=common, fix=entry.fix)


def resolve_pair(text: str | Path) -> PicturePair:
    """Find the two GGUF files of a picture model by its name, or take a folder of just these two.

    Raises:
        UnknownNameError, ModelError: as `resolve_folder`.
    """
    if (folder := _given_folder(text)) is not None:
        model, projector = split_pair(folder, sorted(folder.iterdir()))
        return PicturePair(name=folder.name, model=model, projector=projector)
    entry = find_model(str(text))
    if entry.role != "vlm" or entry.format != "gguf":
        what = f"a {entry.format} model for role {entry.role!r}"
        raise ModelError(
            f"model {text!r} is no pair of GGUF files that reads pictures, but {what}\n"
            f'  To fix: vision = "transformers:{text}" for a folder of safetensors'
        )
    places = verify(entry)
    model, projector = split_pair(places[0].parent, places)
    hashes = dict(zip(places, (file.sha256 for file in entry.files), strict=True))
    return PicturePair(name=entry.name, model=model, projector=projector, sha256=hashes[model])


def _given_folder(text: str | Path) -> Path | None:
    """Return the folder that a model is given by; None where it is given by its name."""
    folder = Path(text)
    if folder.is_dir():
        return folder
    if isinstance(text, Path):
        raise ModelError(f"{folder}: no such folder\n  To fix: `karma models list`")
    return None


def _unique(found: Manifest, path: Path) -> Manifest:
    names = [entry.name for entry in found.models]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise FileError(path, f"model {twice[0]!r} is there twice")
    return found


def _wrong(where: str | Path, reason: str, sha256: str, restore: str) -> ModelError:
    return ModelError(
        f"{where}: {reason}\n  Expected SHA-256: {sha256}\n"
        f"  To fix: {restore or repair()}, then `karma models verify`"
    )
