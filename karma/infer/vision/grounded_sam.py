"""Detect named things in a picture: GroundingDINO's boxes, SAM's masks.

The simulator labels objects by itself (KARMA 4.1); a real robot has a camera only. Words go in, so
the labels that come out are always words that were asked for.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.contracts import Detection, Frame, Region
from karma.errors import ModelError
from karma.infer.checks.folder import CheckedFolder, read_config, whole_number
from karma.infer.torch_load import (
    checked_folder,
    foreign,
    load_image_processor,
    load_tokenizer,
    load_weights,
    place_of,
    threads,
)
from karma.infer.torch_options import TorchOptions

BOXES = {"grounding-dino": ("GroundingDinoForObjectDetection",)}
MASKS = {"sam": ("SamModel",)}
PICTURES = ("preprocessor_config.json",)

_BRING = "bring the model's whole folder and run `karma models add FOLDER`"

_GREY = np.full((37, 53, 3), 100, np.uint8)  # to see at once whether pictures can be prepared

Span = tuple[int, int]  # first token, and one after the last


class GroundedSam:
    """A `Detector`: zero-shot boxes by GroundingDINO, and if wanted SAM's mask for each.

    Args:
        boxes: GroundingDINO, a name of the manifest (then every file is verified) or a folder; with
            "+" behind it the SAM in the same text, as experiment files have it.
        masks: SAM, likewise; None for boxes only.
        threshold: least score of a box, in [0, 1]; 0.25 is what its authors use.
        torch_options: on which device, in which numbers.

    Raises:
        UnknownNameError: neither a name nor a folder.
        ModelError: another architecture, a file missing or damaged, or too little memory.
    """

    name = "grounded-sam"

    def __init__(
        self,
        boxes: str | Path = "grounding-dino-tiny",
        masks: str | Path | None = "sam-base",
        *,
        threshold: float = 0.25,
        torch_options: TorchOptions | None = None,
    ) -> None:
        self._threshold = threshold
        if isinstance(boxes, str) and "+" in boxes:
            boxes, _, masks = boxes.partition("+")
        self._boxes = _Boxes(boxes, torch_options)
        self._masks = None if masks is None else _Masks(masks, torch_options)

    @property
    def computed_on(self) -> str:
        """Device and numbers, as torch calls them."""
        return place_of(self._boxes.model)

    def detect(self, image: Frame, words: Sequence[str]) -> tuple[Detection, ...]:
        """Return what was found of the words, the best score first, equal ones by place.

        Args:
            image: RGB, shape (H, W, 3), uint8.
            words: what to look for, e.g. ("apple", "coffee machine"); () finds nothing.

        Raises:
            ValueError: the picture is of another shape or type, or a word has no letter in it.
            ModelError: more words than the model's context holds.
        """
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise ValueError(f"a frame is (H, W, 3) of uint8, not {image.shape} of {image.dtype}")
        if not words:
            return ()
        with threads(1):
            found = self._boxes.find(image, tuple(dict.fromkeys(words)), self._threshold)
            masks = self._masks.cut(image, [one.box_px for one in found]) if self._masks else []
        if not masks:
            return found
        return tuple(
            Detection(label=one.label, score=one.score, box_px=one.box_px, mask=mask)
            for one, mask in zip(found, masks, strict=True)
        )


class _Boxes:
    """GroundingDINO, asked with words."""

    def __init__(self, model: str | Path, options: TorchOptions | None) -> None:
        needs = (PICTURES, ("tokenizer.json",))
        folder = checked_folder(model, "detector", BOXES, needs=needs)
        self._name = folder.name
        self._longest = folder.number("max_text_len", default=256)
        self._tokenizer = load_tokenizer(folder)
        self._tokenizer.no_padding()
        self._tokenizer.no_truncation()
        self._pictures = load_image_processor(folder)
        work_mb = _boxes_work_mb(folder)
        kind = "GroundingDinoForObjectDetection"
        self.model = load_weights(kind, folder, options, work_mb=work_mb)
        with foreign(f"{folder.path}: it opens and cannot be asked"):
            self._prepared(_GREY)

    def _prepared(self, image: Frame) -> tuple[Any, Any]:
        """Return the picture's numbers and which of them are not padding."""
        found = self._pictures(images=[image], return_tensors="pt")
        pixels = found["pixel_values"].to(self.model.device, self.model.dtype)
        return pixels, found["pixel_mask"].to(self.model.device)

    def find(self, image: Frame, words: Sequence[str], threshold: float) -> tuple[Detection, ...]:
        import torch

        ids, spans = self._asked(words)
        tokens = torch.tensor([ids], device=self.model.device)
        with torch.inference_mode(), foreign(f"{self._name}: cannot be asked"):
            pixels, mask = self._prepared(image)
            out = self.model(
                pixel_values=pixels,
                pixel_mask=mask,
                input_ids=tokens,
                attention_mask=torch.ones_like(tokens),
                token_type_ids=torch.zeros_like(tokens),
            )
        scores = out.logits[0].float().sigmoid().cpu().numpy()  # (queries, longest text)
        centres = (
            out.pred_boxes[0].float().cpu().numpy()
        )  # (queries, 4): x, y, width, height in [0, 1]
        if not np.isfinite(centres).all():
            raise ModelError(f"{self._name}: boxes that are no numbers: damaged weights")
        # of each word the best of its tokens, then of each query the best word
        by_word = np.stack([scores[:, a:b].max(axis=1) for a, b in spans], axis=1)
        height, width = image.shape[:2]
        found = [
            Detection(
                label=words[best], score=float(row[best]), box_px=_corners(centre, width, height)
            )
            for row, best, centre in zip(by_word, by_word.argmax(axis=1), centres, strict=True)
            if row[best] >= threshold
        ]
        return tuple(sorted(found, key=lambda one: (-one.score, one.box_px, one.label)))

    def _asked(self, words: Sequence[str]) -> tuple[list[int], list[Span]]:
        """Write the words as it was trained, "apple. red mug.", and find each again in tokens."""
        text, places = "", []
        for word in words:
            plain = " ".join(word.lower().replace(".", " ").split())
            if not any(letter.isalnum() for letter in plain):
                raise ValueError(f"{word!r} is nothing that can be looked for")
            places.append((len(text), len(text) + len(plain)))
            text += f"{plain}. "
        encoded = self._tokenizer.encode(text.strip())
        if len(encoded.ids) > self._longest:
            raise ModelError(
                f"{len(words)} words are {len(encoded.ids)} tokens, {self._name} takes "
                f"{self._longest}: ask in several turns"
            )
        return encoded.ids, [_span(encoded.offsets, place) for place in places]


class _Masks:
    """SAM, asked with boxes."""

    def __init__(self, model: str | Path, options: TorchOptions | None) -> None:
        folder = checked_folder(model, "detector", MASKS, needs=(PICTURES,))
        self._name = folder.name
        self._pictures = load_image_processor(folder)
        self._model = load_weights("SamModel", folder, options, work_mb=_masks_work_mb(folder))
        with foreign(f"{folder.path}: it opens and cannot be asked"):
            self._prepared(_GREY)

    def _prepared(self, image: Frame) -> tuple[Any, Any, Any]:
        """Return the picture's numbers, its size, and the size that it was brought to."""
        found = self._pictures(images=[image], return_tensors="pt")
        pixels = found["pixel_values"].to(self._model.device, self._model.dtype)
        return pixels, found["original_sizes"], found["reshaped_input_sizes"]

    def cut(self, image: Frame, boxes: Sequence[Region]) -> list[NDArray[np.bool_]]:
        import torch

        if not boxes:
            return []
        with foreign(f"{self._name}: cannot be asked"):
            pixels, sizes, resized = self._prepared(image)
        (height, width), (high, wide) = (
            [int(extent) for extent in np.asarray(one)[0]] for one in (sizes, resized)
        )
        scale = np.array([wide / width, high / height] * 2, np.float32)
        place = {"device": self._model.device, "dtype": self._model.dtype}
        asked = torch.from_numpy(np.asarray(boxes, np.float32) * scale)[None]
        with torch.inference_mode(), foreign(f"{self._name}: cannot be asked"):
            out = self._model(
                pixel_values=pixels,
                input_boxes=asked.to(**place),
                multimask_output=False,
            )
        masks = self._pictures.post_process_masks(out.pred_masks.float().cpu(), sizes, resized)
        return [np.asarray(mask[0].numpy(), np.bool_) for mask in masks[0]]


def _boxes_work_mb(folder: CheckedFolder) -> float:
    """Estimate what one picture takes to compute, from the largest size it is brought to.

    Measured with Swin-T at 800 by 1067: 1322 MB, which is 16 numbers per pixel and channel.
    """
    where = folder.path / PICTURES[0]
    size = read_config(where, fix=_BRING)
    short, long = (
        whole_number(where, size, "size", f"{edge}_edge", default=1333)
        for edge in ("shortest", "longest")
    )
    channels = folder.number("backbone_config", "embed_dim", default=96)
    return 16 * channels * short * long / 1e6


def _masks_work_mb(folder: CheckedFolder) -> float:
    """Estimate what one picture takes to compute: two and a half tables of global attention.

    Measured with ViT-B at 1024 by 1024: 1825 MB; one table has 805 MB.
    """
    side, patch, heads = (
        folder.number("vision_config", key, default=default)
        for key, default in (("image_size", 1024), ("patch_size", 16), ("num_attention_heads", 12))
    )
    return 2.5 * 4 * heads * (side // patch) ** 4 / 1e6


def _span(offsets: Sequence[Span], place: Span) -> Span:
    """Return the tokens that lie within these characters; special tokens have none."""
    inside = [
        number
        for number, (begin, end) in enumerate(offsets)
        if end > begin and begin >= place[0] and end <= place[1]
    ]
    return inside[0], inside[-1] + 1


def _corners(centre: NDArray[np.float32], width: int, height: int) -> Region:
    x, y, w, h = (float(value) for value in centre)
    left, right = ((x + sign * w / 2) * width for sign in (-1, 1))
    top, bottom = ((y + sign * h / 2) * height for sign in (-1, 1))
    return (max(left, 0.0), max(top, 0.0), min(right, float(width)), min(bottom, float(height)))
