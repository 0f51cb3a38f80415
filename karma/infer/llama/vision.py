"""Read object states by llama.cpp: a GGUF and its picture projector (mmproj)."""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from karma.contracts import Frame, SeenObject
from karma.errors import ModelError
from karma.files import rebuild_llama, repair
from karma.infer.llama.options import LlamaOptions
from karma.infer.llama.picture_chat import PictureChat
from karma.infer.manifest.picture_pair import resolve_pair
from karma.infer.vision.pictures import picture_url
from karma.infer.vision.text import question, some_picture, states_told

MAX_TOKENS = 768  # of an answer with its four steps
ATTEMPTS = 2


class LlamaVision:
    """A `VisionModel` over two GGUF files; all objects are asked about at once, greedily.

    Role and question are one message of the user's, for several families take no system message.

    Args:
        model: a name of the manifest, or a folder with just the two files.
        llama_options: how they are opened; a picture may take thousands of tokens of `n_ctx`.
        max_tokens: of an answer.

    Raises:
        UnknownNameError: no such name.
        ModelError: llama.cpp was built without pictures, a file is missing or damaged, or there is
            too little memory.
    """

    needs_pictures = True

    def __init__(
        self,
        model: str | Path,
        *,
        llama_options: LlamaOptions | None = None,
        max_tokens: int = MAX_TOKENS,
    ) -> None:
        require_pictures()
        pair = resolve_pair(model)
        self.name = pair.name
        self._max_tokens = max_tokens
        self._chat = PictureChat(pair, llama_options)

    @property
    def computed_on(self) -> str:
        """Device, layers on it and kind of the kept keys and values."""
        engine = self._chat.engine
        layers = f"{engine.gpu_layers} layers, " if engine.gpu_layers else ""
        return f"{engine.device}, {layers}{engine.kv} KV"

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> state words, () for "none"; ids without a usable answer are left out.

        Args:
            image: uint8 (H, W, 3).
            instruction: the task.
            objects: of interest.

        Raises:
            ModelError: there is no picture, or llama.cpp cannot answer, e.g. since the question is
                longer than the context.
        """
        if not objects:
            return {}
        image = some_picture(self.name, image)
        role, text = question("full", instruction, objects)
        picture = {"type": "image_url", "image_url": {"url": picture_url(image)}}
        first = {"role": "user", "content": [picture, _text(f"{role}\n\n{text}")]}

        def ask(said: Sequence[tuple[str, str]]) -> str:
            later = [{"role": role, "content": [_text(text)]} for role, text in said]
            return self._chat.answer([first, *later], max_tokens=self._max_tokens)

        return states_told(ask, objects, ATTEMPTS)[0]

    def close(self) -> None:
        """Free the model's memory; it cannot be used afterwards."""
        self._chat.close()


def _text(text: str) -> dict[str, Any]:
    return {"type": "text", "text": text}


def has_pictures() -> bool:
    """Return whether the installed llama-cpp-python was built with its picture library."""
    spec = find_spec("llama_cpp")
    places = spec.submodule_search_locations if spec is not None else None
    return any(
        path.name.startswith(("libmtmd.", "mtmd."))
        for path in Path((places or [""])[0]).glob("lib/*")
    )


def require_pictures() -> None:
    """Refuse where llama.cpp cannot look at pictures.

    Raises:
        ModelError: the package is missing, or was built without them; says how to build it.
    """
    if has_pictures():
        return
    if find_spec("llama_cpp") is None:
        raise ModelError(f"llama-cpp-python is not installed\n  To fix: {repair()}")
    raise ModelError(
        "llama-cpp-python was built without pictures (no libmtmd in its lib folder)\n"
        f"  To fix: {rebuild_llama('')} (our own options, which have them)\n"
        '  Or use a folder of safetensors: vision = "transformers:NAME"'
    )
