"""Find the two GGUF files of a picture model: the language part and its projector (mmproj)."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from karma.errors import ModelError
from karma.infer.checks.gguf import is_gguf, read_header
from karma.infer.manifest.manifest import find_model, verify


@dataclass(frozen=True, slots=True, kw_only=True)
class PicturePair:
    """A picture model's two files, chosen by name (then both are verified) or by their folder."""

    name: str
    model: Path
    projector: Path
    sha256: str | None = None  # of the model; None where no manifest vouches for the files


def resolve_pair(text: str | Path, path: str | Path | None = None) -> PicturePair:
    """Find a pair by its name in the manifest, or take a folder that holds nothing else of GGUF.

    Raises:
        UnknownNameError: neither a name nor a folder; never looked for anywhere else.
        ModelError: the model is of another role or format, or a file is missing or wrong.
    """
    folder = Path(text)
    if isinstance(text, Path) or folder.is_dir():
        if not folder.is_dir():
            raise ModelError(f"{folder}: no such folder\n  To fix: `karma models list`")
        model, projector = split_pair(folder, sorted(folder.iterdir()))
        return PicturePair(name=folder.name, model=model, projector=projector)
    entry = find_model(text, path)
    if entry.role != "vlm" or entry.format != "gguf":
        what = f"a {entry.format} model for role {entry.role!r}"
        raise ModelError(
            f"model {text!r} is no pair of GGUF files that reads pictures, but {what}\n"
            f'  To fix: vision = "transformers:{text}" for a folder of safetensors'
        )
    places = verify(entry, path)
    model, projector = split_pair(places[0].parent, places)
    hashes = dict(zip(places, (file.sha256 for file in entry.files), strict=True))
    return PicturePair(name=entry.name, model=model, projector=projector, sha256=hashes[model])


def split_pair(folder: Path, files: Iterable[Path]) -> tuple[Path, Path]:
    """Return the language part and the projector, told apart by what their headers say.

    Raises:
        ModelError: there are not just these two, or one is damaged.
    """
    weights = [file for file in files if is_gguf(file)]
    projectors = [file for file in weights if is_projector(file)]
    models = [file for file in weights if file not in projectors]
    if len(projectors) != 1 or len(models) != 1:
        raise ModelError(
            f"{folder}: a picture model is two .gguf files, the model and its projector (mmproj); "
            f"here are {len(models)} and {len(projectors)}\n"
            "  To fix: a folder with just these two"
        )
    return models[0], projectors[0]


def is_projector(path: Path) -> bool:
    """Return whether a GGUF is the picture part of another.

    Raises:
        ModelError: it is damaged.
    """
    return bool(read_header(path, sizes=()).metadata.get("general.architecture") == "clip")
