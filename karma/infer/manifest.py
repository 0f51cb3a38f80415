"""What models/manifest.toml says, and the check of every file before a byte of it is parsed."""

import hashlib
import os
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import msgspec

from karma.errors import ModelError, UnknownNameError
from karma.files import read_toml

_VERIFY = "karma models verify"


class ModelFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One file of a model, and what it must be."""

    path: str  # relative to the model's folder, see `ModelEntry.package`
    sha256: str
    bytes: int


class ModelEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One model of the manifest."""

    name: str
    role: Literal["planner", "embedder", "vision"]
    format: Literal["gguf", "safetensors"]
    files: tuple[ModelFile, ...]
    licence: str
    source: str
    restore: str  # the command that brings the files back
    package: str | None = None  # the files lie in this installed package, not beside the manifest
    prompt_profile: Literal["compact", "full"] | None = None  # planners only
    context_length: int | None = None  # planners only, in tokens

    def __post_init__(self) -> None:
        """Refuse an entry that could not be used."""
        if not self.files:
            raise ValueError(f"model {self.name!r} has no files")
        if self.role == "planner" and (self.prompt_profile is None or self.context_length is None):
            raise ValueError(f"planner {self.name!r} needs prompt_profile and context_length")


class Manifest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All models that this project knows."""

    models: tuple[ModelEntry, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerFile:
    """A planner's GGUF, chosen by name or by path."""

    name: str
    path: Path
    sha256: str | None = None  # None for a file that no manifest vouches for
    prompt_profile: Literal["compact", "full"] = "full"
    context_length: int | None = None


def manifest_path() -> Path:
    """Return models/manifest.toml: below $KARMA_MODELS if set, else beside the package."""
    folder = os.environ.get("KARMA_MODELS")
    return (Path(folder) if folder else Path(__file__).parents[2] / "models") / "manifest.toml"


def read_manifest(path: str | Path | None = None) -> Manifest:
    """Read a manifest strictly, by default the project's own.

    Raises:
        FileError: missing, or a key is unknown, absent or of the wrong type.
    """
    path = manifest_path() if path is None else Path(path)
    fix = None if path.exists() else "set KARMA_MODELS to the folder that holds manifest.toml"
    return read_toml(path, Manifest, fix=fix)


def find_model(name: str, path: str | Path | None = None) -> ModelEntry:
    """Return the manifest's entry of that name.

    Raises:
        UnknownNameError: there is none; the message suggests the nearest.
    """
    found = {entry.name: entry for entry in read_manifest(path).models}
    if name not in found:
        near = get_close_matches(name, found, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise UnknownNameError(f"no model named {name!r}.{hint} In the manifest: {sorted(found)}")
    return found[name]


def file_paths(entry: ModelEntry, path: str | Path | None = None) -> tuple[Path, ...]:
    """Return where an entry's files lie, unchecked, in its order.

    Raises:
        ModelError: they lie in a package that is not installed.
    """
    if entry.package is None:
        folder = (manifest_path() if path is None else Path(path)).parent
        return tuple(folder / file.path for file in entry.files)
    spec = find_spec(entry.package)
    if spec is None or not spec.submodule_search_locations:
        file = entry.files[0]
        where = f"{file.path} of package {entry.package}"
        raise _wrong(where, "the package is not installed", file.sha256, entry.restore)
    folder = Path(spec.submodule_search_locations[0])
    return tuple(folder / file.path for file in entry.files)


def verify(entry: ModelEntry, path: str | Path | None = None) -> tuple[Path, ...]:
    """Check size and SHA-256 of an entry's files and return their paths.

    Raises:
        ModelError: a file is missing or differs; names it, the hash it must have, and the fix.
    """
    paths = file_paths(entry, path)
    for file, place in zip(entry.files, paths, strict=True):
        check_file(place, file.sha256, size=file.bytes, restore=entry.restore)
    return paths


def check_file(
    path: Path, sha256: str, *, size: int | None = None, restore: str = "make setup"
) -> None:
    """Check one file, by size first because that costs nothing.

    Raises:
        ModelError: missing, or of another size or hash.
    """
    try:
        found = path.stat().st_size
        if size is not None and found != size:
            raise _wrong(path, f"it has {found} bytes instead of {size}", sha256, restore)
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise _wrong(path, error.strerror or str(error), sha256, restore) from error
    if digest != sha256:
        raise _wrong(path, f"its SHA-256 is {digest}", sha256, restore)


def resolve_planner(text: str, path: str | Path | None = None) -> PlannerFile:
    """Find a planner by its name in the manifest, or take the path of any .gguf file.

    Nothing is opened here; `LlamaModel` checks the hash and the file.

    Raises:
        UnknownNameError: neither a name nor a .gguf path.
        ModelError: the name is not a planner's.
    """
    if text.endswith(".gguf"):
        return PlannerFile(name=Path(text).stem, path=Path(text))
    entry = find_model(text, path)
    if entry.role != "planner" or entry.prompt_profile is None:
        raise ModelError(f"model {text!r} is not a planner but a model for role {entry.role!r}")
    return PlannerFile(
        name=entry.name,
        path=file_paths(entry, path)[0],
        sha256=entry.files[0].sha256,
        prompt_profile=entry.prompt_profile,
        context_length=entry.context_length,
    )


def _wrong(where: str | Path, reason: str, sha256: str, restore: str) -> ModelError:
    return ModelError(
        f"{where}: {reason}\n  Expected SHA-256: {sha256}\n  To fix: {restore}, then `{_VERIFY}`"
    )
