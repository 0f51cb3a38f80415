"""Embed texts and pictures in one space, by CLIP or SigLIP, from a folder of safetensors.

It is what `recall = "multimodal"` asks (`multimodal.py`).
"""

import re
import string
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from karma.errors import ModelError
from karma.models.embed import REMEMBERED, stacked, unit_row
from karma.plugins.vision.model_folder import CheckedFolder
from karma.plugins.vision.torch_load import (
    checked_folder,
    foreign,
    load_image_processor,
    load_tokenizer,
    load_weights,
    place_of,
    threads,
)
from karma.types.space import Frame, Vectors

FAMILIES = {"clip": ("CLIPModel",), "siglip": ("SiglipModel",)}
NEEDS = (("tokenizer.json",), ("preprocessor_config.json",))
DEFAULT = "siglip-base"

_PUNCTUATION = re.compile(f"[{re.escape(string.punctuation)}]")


class ClipEmbedder:
    """An `Embedder` and an `ImageEmbedder`: one row per text or picture, all in one space.

    Every text and every picture goes through the network alone, on one thread, so its row is the
    same bits in any company. `model`: a name of the manifest (then every file is verified first),
    or a folder.

    Raises:
        UnknownNameError: neither.
        ModelError: another architecture, a file missing or damaged, or too little memory.
    """

    computed_on = ""  # device and numbers, as torch calls them
    default = DEFAULT

    def __init__(self, model: str | Path = DEFAULT, *, device: str = "auto") -> None:
        folder = checked_folder(model, "image-embedder", FAMILIES, needs=NEEDS)
        self.name = folder.name
        self._words = _Words(folder)
        self._pictures = load_image_processor(folder)
        self._model = load_weights(FAMILIES[folder.model_type][0], folder, device)
        self.computed_on = place_of(self._model)
        with foreign(f"{folder.path}: it opens and cannot be asked"):
            self.dimension = len(self._text("a"))
            self._picture(np.full((37, 53, 3), 100, np.uint8))
        self._row = lru_cache(maxsize=REMEMBERED)(self._text)

    def embed(self, texts: Sequence[str]) -> Vectors:
        """Return one row of length 1 per text, shape (n, dimension); n may be 0.

        What exceeds the model's context (77 or 64 tokens for those that are published) is cut.
        """
        return stacked(map(self._row, texts), self.dimension)

    def embed_images(self, frames: Sequence[Frame]) -> Vectors:
        """Return one row of length 1 per picture, shape (n, dimension); n may be 0.

        ValueError where a frame is not of shape (H, W, 3) and type uint8.
        """
        return stacked(map(self._picture, frames), self.dimension)

    def _text(self, text: str) -> Vectors:
        import torch

        with threads(1), torch.inference_mode():
            ids = torch.tensor([self._words.ids(text)], device=self._model.device)
            return self._unit(_features(self._model.get_text_features(input_ids=ids)))

    def _picture(self, frame: Frame) -> Vectors:
        import torch

        if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8:
            raise ValueError(f"a frame is (H, W, 3) of uint8, not {frame.shape} of {frame.dtype}")
        with threads(1), torch.inference_mode():
            pixels = self._pictures(images=[frame], return_tensors="pt")["pixel_values"]
            pixels = pixels.to(self._model.device, self._model.dtype)
            return self._unit(_features(self._model.get_image_features(pixel_values=pixels)))

    def _unit(self, row: Any) -> Vectors:
        try:
            return unit_row(row[0].float().cpu().numpy())
        except ValueError as error:
            raise ModelError(f"{self.name}: {error}: damaged weights") from error


class _Words:
    """Text to token ids, as the family's own processor does it."""

    def __init__(self, folder: CheckedFolder) -> None:
        usual = 77 if folder.model_type == "clip" else 64
        text = folder.config.get("text_config") or {}
        self._length = int(text.get("max_position_embeddings", usual))
        self._tokenizer = load_tokenizer(folder)
        self._tokenizer.no_padding()
        self._tokenizer.enable_truncation(self._length)
        self._padding: int | None = None
        if folder.model_type == "siglip":  # trained on texts padded to the full length
            self._padding = self._tokenizer.token_to_id("</s>")
            if self._padding is None:
                raise ModelError(f"{folder.path / 'tokenizer.json'}: no token '</s>'")

    def ids(self, text: str) -> list[int]:
        if self._padding is None:
            found: list[int] = self._tokenizer.encode(text).ids
            return found
        plain = " ".join(_PUNCTUATION.sub("", text.lower()).split())
        words: list[int] = self._tokenizer.encode(plain, add_special_tokens=False).ids
        words = words[: self._length - 1]
        return words + [self._padding] * (self._length - len(words))


def _features(found: Any) -> Any:
    """Return the tensor of features: transformers 5 wraps what 4 gave as it is."""
    return getattr(found, "pooler_output", found)
