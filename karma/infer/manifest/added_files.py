"""Choose the files to take of a model that somebody brought, and tell whose they are."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from karma.errors import ModelError
from karma.infer.checks.folder import PICKLES
from karma.infer.checks.gguf import is_gguf
from karma.infer.manifest.manifest import ModelEntry, ModelFile
from karma.infer.manifest.picture_pair import is_projector

_TAKEN = (".safetensors", ".json", ".txt", ".model", ".jinja")


def files_of(root: Path) -> tuple[dict[str, Path], tuple[str, ...]]:
    """Return the files to take by their path inside the model, and what is left out."""
    if not root.exists():
        raise ModelError(
            f"{root}: no such file or folder\n"
            "  To fix: give the path of a .gguf file or of a folder with safetensors; names of a "
            "hub are never looked up"
        )
    if root.is_file():
        if not is_gguf(root):
            raise ModelError(_refusal(root))
        return {root.name: root}, ()
    every = sorted(p for p in root.rglob("*") if p.is_file() and not _hidden(p, root))
    taken = {p.relative_to(root).as_posix(): p for p in every if p.suffix in _TAKEN or is_gguf(p)}
    ggufs = [part for part, p in taken.items() if is_gguf(p)]
    weights = [part for part in taken if part.endswith(".safetensors")] + ggufs
    if not weights:
        pickled = [p for p in every if p.suffix in PICKLES]
        raise ModelError(_refusal(pickled[0]) if pickled else f"{root}: no .safetensors, no .gguf")
    pair = len(ggufs) == 2 and sum(is_projector(taken[part]) for part in ggufs) == 1
    if ggufs and not (len(weights) == 1 or (pair and len(weights) == 2)):
        raise ModelError(
            f"{root}: more than one model or part: {', '.join(weights[:3])}\n"
            "  To fix: add each .gguf by itself, one that reads pictures with its projector in a "
            "folder; parts of one are joined first: llama-gguf-split --merge FIRST_PART WHOLE.gguf"
        )
    return taken, tuple(sorted({p.relative_to(root).as_posix() for p in every} - taken.keys()))


def _hidden(path: Path, root: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(root).parts)


def _refusal(path: Path) -> str:
    why = (
        "it may hold code"
        if path.suffix in PICKLES
        else "only .gguf and folders of safetensors are"
    )
    return (
        f"{path}: not opened, {why}\n  To fix: take the model's safetensors or GGUF files instead"
    )


def matching(
    models: Iterable[ModelEntry], name: str | None, found: Mapping[str, Path]
) -> ModelEntry | None:
    """Return the manifest's model of that name, or without one the only one whose files fit.

    Without a name, the files of weights must bear the manifest's names, see `_fits`.
    """
    if name is not None:
        return next((entry for entry in models if entry.name == name), None)
    fitting = [entry for entry in models if entry.package is None and _fits(entry, found)]
    return fitting[0] if len(fitting) == 1 else None


def _fits(entry: ModelEntry, found: Mapping[str, Path]) -> bool:
    """Say whether the files of weights bear an entry's names.

    Names that any model has ("model.safetensors") must come with the size too. Any other is taken
    for what it says, so that a wrong file of that name is refused and not made a model of its own.
    """
    heavy = {
        part: file
        for part, file in parts_of(entry).items()
        if part.endswith((".safetensors", ".gguf"))
    }
    return bool(heavy) and all(
        part in found and (not part.startswith("model") or found[part].stat().st_size == file.bytes)
        for part, file in heavy.items()
    )


def parts_of(entry: ModelEntry) -> dict[str, ModelFile]:
    """Return an entry's files by their path inside the model's folder."""
    common = os.path.commonpath([Path(file.path).parent for file in entry.files])
    return {os.path.relpath(file.path, common): file for file in entry.files}
