"""Recall by words and pictures in one space (`recall = "multimodal"`)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from karma.errors import FileError, KarmaError
from karma.memory.recall import CosineRecall, UnitIndex, verbaliser
from karma.types.memory import MemoryUnit
from karma.types.roles import Embedder
from karma.types.space import Frame, Vectors


@runtime_checkable
class ImageEmbedder(Embedder, Protocol):
    """Text and pictures to unit vectors of one space."""

    def embed_images(self, frames: Sequence[Frame]) -> Vectors:
        """Return one row of length 1 per picture, shape (n, dimension); n may be 0."""


class MultimodalRecall(CosineRecall):
    """Top-K units by cosine between the query's words and each unit's words and picture (§3.4).

    The paper has each unit turned into one vector by "a multi-modality embedding model" and does
    not say how its parts are joined; here it is the mean of the two vectors, brought to length 1.
    A unit of which no picture was kept stands by its words alone.

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
        self._embedder, self._pictures = embedder, embedder
        self._text, self._folder = verbaliser(text), folder
        self._index = UnitIndex(self._row, self._text_and_image)

    def _asked(self, query: str) -> Vectors:
        return self._embedder.embed([query])

    def _text_and_image(self, unit: MemoryUnit) -> tuple[str, str]:
        """Return what a unit's vector is made of; equal ones share a row."""
        return self._text(unit), (unit.image or "") if self._folder is not None else ""

    def _row(self, parts: tuple[str, str]) -> Vectors:
        """Return a unit's vector, shape (1, dimension).

        Raises:
            ValueError: its text and its picture point in opposite directions.

        Source: KARMA 3.4; the mean is ours, see the class.
        """
        text, image = parts
        row = self._embedder.embed([text])
        if not image or self._folder is None:
            return row
        shown = self._pictures.embed_images([picture(self._folder / image)])
        both = np.asarray(row, np.float32) + np.asarray(shown, np.float32)
        length = np.linalg.norm(both, axis=1, keepdims=True)
        if not length.all():
            raise ValueError("a text and its picture point in opposite directions")
        return np.asarray(both / length, np.float32)


def picture(path: Path) -> np.ndarray:
    """Return a kept picture, uint8 (H, W, 3).

    Raises:
        FileError: it is missing or damaged.
    """
    from PIL import Image  # only who keeps pictures waits for it

    try:
        with Image.open(path) as opened:
            return np.asarray(opened.convert("RGB"))
    except OSError as error:
        fix = "run the experiment anew, with --fresh: it keeps the pictures that it looks at"
        raise FileError(path, f"no picture: {error}", fix=fix) from error
