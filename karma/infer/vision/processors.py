"""Open vision models' processors without their video part.

transformers' own want torchvision (Qwen2.5-VL) or num2words (SmolVLM) for videos alone; the
same classes without their video part need neither. Pictures go through Pillow.
"""

from typing import Any

from karma.errors import ModelError
from karma.infer.checks.folder import CheckedFolder
from karma.infer.torch_load import foreign, import_transformers, quiet

_PARTS = ["image_processor", "tokenizer"]
_CLASSES = {
    "qwen2_5_vl": "Qwen2_5_VLProcessor",
    "smolvlm": "Idefics3Processor",  # the same placeholders for pictures
    "idefics3": "Idefics3Processor",
    "llava": "LlavaProcessor",
}


def load_processor(folder: CheckedFolder) -> Any:
    """Open a vision model's processor: tokenizer, picture preparation and chat template.

    Raises:
        ModelError: a file of it is missing or damaged, or there is no chat template.
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
    found.tokenizer.padding_side = "left"
    return found


def pictures_only(model_type: str) -> Any:
    """Return a family's processor class without its video part."""
    whole = getattr(import_transformers(), _CLASSES[model_type])

    def get_attributes(cls: type) -> list[str]:
        return _PARTS

    return type(whole.__name__, (whole,), {"get_attributes": classmethod(get_attributes)})
