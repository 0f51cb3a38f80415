"""Recall by what a unit looked like too: its words and its picture in one space (KARMA §3.4).

The paper has each unit turned into one vector by "a multi-modality embedding model" and does not
say how its parts are joined; here it is the mean of the two vectors, brought to length 1. A unit of
which no picture was kept (those of a vision model that needs none) stands by its words alone.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from karma.contracts import Embedder, ImageEmbedder, MemoryUnit, Recalled, Vectors
from karma.errors import FileError, KarmaError
from karma.memory.index import UnitIndex
from karma.memory.recall import verbaliser


class MultimodalRecall:
    """Top-K units by cosine between the query's words and each unit's words and picture.

    Args:
        embedder: of texts and pictures.
        text: how a unit is put in words: a name in `VERBALISERS`.
        folder: the run folder, below which the units' pictures lie; None: words alone.

    Raises:
        KarmaError: the embedder knows no pictures.
        UnknownNameError: no verbaliser of that name.
    """

    def __init__(
        self, embedder: Embedder | None, *, text: str = "sentence", folder: Path | None = None
    ) -> None:
        if not isinstance(embedder, ImageEmbedder):
            raise KarmaError(
                "recall = 'multimodal' needs an embedder of texts and pictures\n"
                '  To fix: embedder = "clip:NAME" in [models], a CLIP or SigLIP of the manifest '
                "or its folder; `karma models list` names those that are here"
            )
        self._embedder, self._text, self._folder = embedder, verbaliser(text), folder
        self._index = UnitIndex(self._row, self._text_and_image)

    def recall(self, query: str, units: Sequence[MemoryUnit], k: int) -> list[Recalled]:
        """Return the units closest to the query, best first; ties keep the order of `units`.

        Args:
            query: the instruction, or the phrase that names what is wanted.
            units: what is remembered.
            k: how many; fewer come back when there are fewer units.

        Raises:
            ValueError: k < 1.
            FileError: a unit's picture is missing or damaged.

        Source: KARMA §3.5, the smallest cosine distance to the embedding of the instruction.
        """
        if k < 1:
            raise ValueError(f"k must be at least 1, not {k}")
        self._index.follow(units)
        asked = self._embedder.embed([query])
        return self._index.recalled(self._index.best(asked, k)) if units else []

    def _text_and_image(self, unit: MemoryUnit) -> tuple[str, str]:
        """Return what a unit's vector is made of; equal ones share a row."""
        return self._text(unit), (unit.image or "") if self._folder is not None else ""

    def _row(self, parts: tuple[str, str]) -> Vectors:
        """Return a unit's vector, shape (1, dimension)."""
        text, image = parts
        row = self._embedder.embed([text])
        if image and self._folder is not None:
            shown = self._embedder.embed_images([picture(self._folder / image)])
            row = unit_vectors(row, shown)
        return row


def picture(path: Path) -> np.ndarray:
    """Return a kept picture, uint8 (H, W, 3).

    Raises:
        FileError: it is missing or damaged.
    """
    try:
        with Image.open(path) as opened:
            return np.asarray(opened.convert("RGB"))
    except OSError as error:
        fix = "run the experiment anew, with --fresh: it keeps the pictures that it looks at"
        raise FileError(path, f"no picture: {error}", fix=fix) from error


def unit_vectors(texts: Vectors, images: Vectors) -> Vectors:
    """Return one row of length 1 per memory unit from the rows of its text and of its picture.

    Args:
        texts: shape (n, d), rows of length 1.
        images: shape (n, d), rows of length 1; row i is of the same unit as row i of `texts`.

    Raises:
        ValueError: the shapes differ, or two rows cancel out.

    Source: KARMA 3.4; the mean is ours, see the module's docstring.
    """
    if texts.shape != images.shape:
        raise ValueError(f"texts {texts.shape} and images {images.shape} do not fit together")
    rows = np.asarray(texts, np.float32) + np.asarray(images, np.float32)
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    if (length == 0).any():
        raise ValueError("a text and its picture point in opposite directions")
    return np.asarray(rows / length, np.float32)
