"""Read object states by transformers: Qwen2.5-VL, SmolVLM/Idefics3, LLaVA, our nano.

A model is a folder of safetensors and JSON; nothing is fetched, nothing pickled is opened. Beside
the files that transformers knows there may be `karma.json`, which says how the model is asked.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta

from karma.errors import ModelError
from karma.files import read_json
from karma.models.picture_questions import Profile, question, some_picture, states_told
from karma.plugins.vision.cutting import cut
from karma.plugins.vision.model_folder import CheckedFolder
from karma.plugins.vision.torch_load import (
    checked_folder,
    foreign,
    import_transformers,
    load_weights,
    place_of,
    quiet,
    threads,
)
from karma.types.observation import SeenObject
from karma.types.space import Frame

FAMILIES = {
    "llava": ("LlavaForConditionalGeneration",),
    "qwen2_5_vl": ("Qwen2_5_VLForConditionalGeneration",),
    "smolvlm": ("SmolVLMForConditionalGeneration",),
    "idefics3": ("Idefics3ForConditionalGeneration",),
}
NEEDS = (
    ("tokenizer.json",),
    ("processor_config.json", "preprocessor_config.json"),
    ("chat_template.jinja", "chat_template.json", "tokenizer_config.json"),
)
NANO = "karma-nano-vlm"
OPTIONS_FILE = "karma.json"
Conversation = Sequence[Mapping[str, Any]]
LARGE = 500_000_000  # parameters; from here on what is stored in 16 bits stays so
_PARTS = ["image_processor", "tokenizer"]
_CLASSES = {
    "qwen2_5_vl": "Qwen2_5_VLProcessor",
    "smolvlm": "Idefics3Processor",  # the same placeholders for pictures
    "idefics3": "Idefics3Processor",
    "llava": "LlavaProcessor",
}


class VisionOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a model is asked (`karma.json`); the defaults are the paper's."""

    profile: Profile = "full"
    # side of a square around one object over its box; None: whole frame
    crop: Annotated[float, Meta(gt=0, le=100)] | None = None
    outline: bool = False  # draw the silhouette of the object's box in that square
    max_tokens: Annotated[int, Meta(ge=1, le=100_000)] = 768
    attempts: Annotated[int, Meta(ge=1, le=100)] = 2  # a second one quotes what could not be used
    threads: Annotated[int, Meta(ge=1, le=1024)] | None = None  # None: as torch is set


class TransformersVision:
    """A `VisionModel` that looks at pictures.

    With `crop`, each object of interest is asked about alone, on a square cut out around its box;
    else all at once, on the whole frame. Decoding is greedy. Weights are opened in float32; large
    models that are stored in 16 bits are opened in bfloat16. `model`: a name of the manifest (then
    every file is verified first), or a folder; `options` go before its `karma.json`.

    Raises:
        UnknownNameError: neither.
        ModelError: another architecture, a file missing or damaged, or too little memory; all of
            that before weights are read.
    """

    needs_pictures = True
    computed_on = ""  # device and numbers, as torch calls them
    default = NANO

    def __init__(
        self,
        model: str | Path = NANO,
        *,
        options: VisionOptions | None = None,
        device: str = "auto",
    ) -> None:
        folder = checked_folder(model, "vlm", FAMILIES, needs=NEEDS)
        own = folder.path / OPTIONS_FILE
        self.name = folder.name
        self.options = options or (
            read_json(own, VisionOptions) if own.exists() else VisionOptions()
        )
        self._processor = load_processor(folder)
        stored = folder.config.get("dtype", folder.config.get("torch_dtype"))
        half = folder.parameters >= LARGE and stored in ("bfloat16", "float16")
        kind = "AutoModelForImageTextToText"
        self._model = load_weights(kind, folder, device, half=half)
        self.computed_on = place_of(self._model)
        if folder.parameters < LARGE:  # others take minutes for a picture
            with foreign(f"{folder.path}: it opens and cannot be asked"):
                self.answer(np.full((37, 53, 3), 100, np.uint8), _TRIAL, most=1)

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> state words, () for "none"; ids without a usable answer are left out.

        With `crop` objects without a region cannot be asked about. ModelError where there is no
        picture (uint8, (H, W, 3)).
        """
        if not objects:
            return {}
        image = some_picture(self.name, image)
        found: dict[str, tuple[str, ...]] = {}
        for picture, shown in self._questions(image, objects):
            found.update(self._ask(picture, shown, instruction))
        return found

    def _questions(
        self, image: Frame, objects: Sequence[SeenObject]
    ) -> Iterator[tuple[Frame, Sequence[SeenObject]]]:
        if self.options.crop is None:
            yield image, objects
            return
        for one in objects:
            if one.region is not None:
                corners = one.silhouette if self.options.outline else ()
                yield cut(image, one.region, self.options.crop, corners), [one]

    def _ask(
        self, image: Frame, objects: Sequence[SeenObject], instruction: str
    ) -> Mapping[str, tuple[str, ...]]:
        """Ask about the objects of one picture."""
        options = self.options
        role, text = question(options.profile, instruction, objects)
        system = [_message("system", role)] if role else []
        opening = [*system, _message("user", text, picture=True)]

        def ask(said: Sequence[tuple[str, str]]) -> str:
            return self.answer(image, [*opening, *(_message(role, text) for role, text in said)])

        return states_told(ask, objects, options.attempts)

    def answer(self, image: Frame, messages: Conversation, *, most: int = 0) -> str:
        """Return what the model says to a conversation with one picture, uint8 (H, W, 3).

        `most`: tokens of the answer; 0: as the options say.
        """
        import torch
        from PIL import Image

        text = self._processor.apply_chat_template(messages, add_generation_prompt=True)
        batch = self._processor(images=[Image.fromarray(image)], text=[text], return_tensors="pt")
        # pictures in the model's numbers; tokens stay whole ones
        batch = batch.to(self._model.device, dtype=self._model.dtype)
        with threads(self.options.threads), torch.inference_mode(), quiet():
            (tokens,) = self._model.generate(
                **batch,
                max_new_tokens=most or self.options.max_tokens,
                do_sample=False,
                pad_token_id=self._processor.tokenizer.pad_token_id,
            )
        new = tokens[batch["input_ids"].shape[1] :]
        return str(self._processor.tokenizer.decode(new, skip_special_tokens=True))


def _message(role: str, text: str, *, picture: bool = False) -> dict[str, Any]:
    parts = [{"type": "image"}] if picture else []
    return {"role": role, "content": [*parts, {"type": "text", "text": text}]}


_TRIAL = (_message("user", "What is it?", picture=True),)


def load_processor(folder: CheckedFolder) -> Any:
    """Open a vision model's processor: tokenizer, picture preparation and chat template.

    ModelError where a file of it is missing or damaged, or there is no chat template.
    """
    kind = pictures_only(folder.model_type)
    with quiet(), foreign(f"{folder.path}: its processor does not open"):
        found = kind.from_pretrained(
            folder.path, local_files_only=True, trust_remote_code=False, backend="pil"
        )
    if not (found.chat_template or found.tokenizer.chat_template):
        raise ModelError(
            f"{folder.path}: no chat template (chat_template.jinja, or in "
            "tokenizer_config.json)\n  To fix: bring the instruction-tuned model's whole folder"
        )
    return found


def pictures_only(model_type: str) -> Any:
    """Return a family's processor class without its video part."""
    whole = getattr(import_transformers(), _CLASSES[model_type])

    def get_attributes(cls: type) -> list[str]:
        return _PARTS

    return type(whole.__name__, (whole,), {"get_attributes": classmethod(get_attributes)})
