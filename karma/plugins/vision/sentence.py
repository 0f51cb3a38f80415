"""Embed texts by sentence-transformers, with any model of its kind in a folder."""

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from karma.errors import FileError, ModelError
from karma.files import read_bytes
from karma.models.checks.folder import PICKLES
from karma.models.embed import REMEMBERED, stacked, unit_row
from karma.models.manifest import resolve_folder
from karma.plugins.vision.model_folder import CheckedFolder, check_folder
from karma.plugins.vision.torch_load import (
    check_room,
    foreign,
    import_transformers,
    place_of,
    quiet,
    threads,
)
from karma.types.space import Vectors

FAMILIES: Mapping[str, tuple[str, ...]] = {  # of transformers; any head will do
    family: () for family in ("bert", "distilbert", "mpnet", "roberta", "xlm-roberta", "modernbert")
}
DEFAULT = "all-mpnet-base-v2"
NEEDS = (("tokenizer.json", "vocab.txt", "sentencepiece.bpe.model"),)


class SentenceEmbedder:
    """An `Embedder` over a folder that sentence-transformers wrote: modules.json and safetensors.

    Texts go through one at a time on one thread, so that a row is the same bits in any company. A
    model's prompt for queries is not used: recall compares texts of one kind. `model`: a name of
    the manifest (then every file is verified first), or a folder.

    Raises:
        UnknownNameError: neither.
        ModelError: another architecture, a file missing or damaged, modules that are not
            sentence-transformers' own, a pickle among the weights, or too little memory.
    """

    computed_on = ""  # device and numbers, as torch calls them
    default = DEFAULT

    def __init__(self, model: str | Path = DEFAULT, *, device: str = "auto") -> None:
        place = resolve_folder(model, "text-embedder")
        inner = place.path / _check_modules(place.path, place.fix)
        checked = check_folder(inner, FAMILIES, needs=NEEDS, fix=place.fix)
        device = check_room(checked, device)
        self.name = place.name
        self._model = _load(place.path, device)
        self.computed_on = place_of(self._model)
        _refuse_missing(self._model, checked)
        self._row = lru_cache(maxsize=REMEMBERED)(self._computed)
        with foreign(f"{place.path}: it opens and cannot be asked"):
            self.dimension = len(unit_row(self._row("a")))

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, dimension); n may be 0."""
        return stacked(map(self._row, texts), self.dimension)

    def _computed(self, text: str) -> Vectors:
        with threads(1):
            found: Vectors = self._model.encode(
                text, normalize_embeddings=True, show_progress_bar=False, convert_to_numpy=True
            )
        return found


def _check_modules(folder: Path, fix: str) -> str:
    """Check what modules.json would have imported; return the folder of the transformer."""
    path = folder / "modules.json"
    if not path.is_file():
        raise ModelError(f"{path}: missing, so pooling is not known\n  To fix: {fix}")
    try:
        modules = json.loads(read_bytes(path))
        kinds = [(str(module["type"]), str(module["path"])) for module in modules]
    except (ValueError, TypeError, KeyError, FileError, RecursionError) as error:
        raise ModelError(f"{path}: not a list of modules: {error}\n  To fix: {fix}") from error
    for kind, inside in kinds:
        if not kind.startswith("sentence_transformers."):
            raise ModelError(
                f"{path}: {kind!r} is no module of sentence-transformers; not imported"
            )
        if ".." in Path(inside).parts or Path(inside).is_absolute():
            raise ModelError(f"{path}: {inside!r} leaves the model's folder")
        own = folder / inside
        pickled = sorted(file for file in own.glob("*") if file.suffix in PICKLES)
        if pickled and not any(own.glob("*.safetensors")):
            raise ModelError(f"{pickled[0]}: not opened, it may hold code; needs safetensors")
    if not kinds or not kinds[0][0].endswith(".Transformer"):
        raise ModelError(f"{path}: the first module must be a Transformer")
    return kinds[0][1]


def _refuse_missing(model: Any, folder: CheckedFolder) -> None:
    """Refuse a file that lacks weights, which would be random numbers.

    A pooler may be missing, since pooling passes it by. Files saved with a head have another prefix
    before every name ("bert.").
    """
    there = tuple(folder.sizes)
    wanted = (name.partition(".")[2] for name in model[0].state_dict() if ".pooler." not in name)
    missing = [name for name in wanted if not any(n.endswith(name) for n in there)]
    if missing:
        raise ModelError(
            f"{folder.path}: not a whole model: {len(missing)} weights are missing, "
            f"e.g. {missing[0]}"
        )


def _load(folder: Path, device: str) -> Any:
    """Read the model from disk only; no progress bar, and no setting left changed."""
    import_transformers()
    from sentence_transformers import SentenceTransformer

    with quiet(), foreign(f"{folder}: sentence-transformers cannot open it"):
        return SentenceTransformer(
            str(folder), device=device, local_files_only=True, trust_remote_code=False,
            model_kwargs={"use_safetensors": True, "dtype": "float32"},
        ).eval()  # fmt: skip
