"""Read object states by llama.cpp: a GGUF and its picture projector (mmproj), by its library mtmd.

The generic handler of llama-cpp-python is used, which renders the file's own chat template: the one
it has for Qwen2.5-VL loses the last line break of the prompt.
"""

import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from karma.errors import ModelError
from karma.files import rebuild_llama, repair
from karma.models.checks.gguf import TEMPLATE, check_projector
from karma.models.checks.memory import projector_mb
from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.opening import LlamaOptions, try_in_own_process
from karma.models.manifest import PicturePair, resolve_pair
from karma.models.picture_questions import picture_url, question, some_picture, states_told
from karma.types.completion import Engine
from karma.types.observation import SeenObject
from karma.types.space import Frame

MAX_TOKENS = 768  # of an answer with its four steps
ATTEMPTS = 2
CONTEXT = 8192  # tokens, where n_ctx is not said: a picture may take thousands
Message = Mapping[str, Any]


class LlamaVision:
    """A `VisionModel` over two GGUF files; all objects are asked about at once, greedily.

    Role and question are one message of the user's, for several families take no system message.
    `model`: a name of the manifest, a folder with just the two files, or these; where nobody
    vouches for them, they are first tried in another process.

    Raises:
        UnknownNameError: no such name.
        ModelError: llama.cpp was built without pictures, a file is missing, damaged or without a
            chat template, the two do not belong together, or there is too little memory.
    """

    needs_pictures = True

    def __init__(
        self, model: str | Path | PicturePair, *, llama_options: LlamaOptions | None = None
    ) -> None:
        require_pictures()
        pair = model if isinstance(model, PicturePair) else resolve_pair(model)
        options = llama_options or LlamaOptions()
        check_projector(pair.projector)
        self.name = pair.name
        # as llama.cpp rounds it: the handler compares with that
        tokens = -(-(options.n_ctx or CONTEXT) // 256) * 256
        self._model = GgufModel(
            pair.model, replace(options, n_ctx=tokens), name=pair.name, sha256=pair.sha256,
            beside_mb=projector_mb(pair.projector),
        )  # fmt: skip
        if TEMPLATE not in self._model.metadata:
            raise ModelError(
                f"{pair.model}: has no chat template, and a picture needs one\n"
                "  To fix: gguf-new-metadata --chat-template-file TEMPLATE IN.gguf OUT.gguf"
            )
        if pair.sha256 is None:
            try_pair(pair)
        # freed as late as Python's own end, llama-cpp-python complains of a closed terminal
        weakref.finalize(self, self._model.close)
        self._handler = _handler(pair.projector, use_gpu=self._model.placement.layers > 0)

    @property
    def engine(self) -> Engine:
        """What computes it."""
        return self._model.engine

    @property
    def computed_on(self) -> str:
        """Device, layers on it and kind of the kept keys and values."""
        layers = f"{self.engine.gpu_layers} layers, " if self.engine.gpu_layers else ""
        return f"{self.engine.device}, {layers}{self.engine.kv} KV"

    def read_states(
        self, image: Frame | None, instruction: str, objects: Sequence[SeenObject]
    ) -> Mapping[str, tuple[str, ...]]:
        """Return object id -> state words, () for "none"; ids without a usable answer are left out.

        ModelError where there is no picture (uint8, (H, W, 3)), or llama.cpp cannot answer, e.g.
        since the question is longer than the context.
        """
        if not objects:
            return {}
        image = some_picture(self.name, image)
        role, text = question("full", instruction, objects)
        picture = {"type": "image_url", "image_url": {"url": picture_url(image)}}
        first = {"role": "user", "content": [picture, _text(f"{role}\n\n{text}")]}

        def ask(said: Sequence[tuple[str, str]]) -> str:
            later = [{"role": role, "content": [_text(text)]} for role, text in said]
            return self.answer([first, *later], max_tokens=MAX_TOKENS)

        return states_told(ask, objects, ATTEMPTS)

    def answer(self, messages: Sequence[Message], *, max_tokens: int) -> str:
        """Return what the model says, greedily; messages as OpenAI's, all contents lists of parts.

        ModelError where a picture is no data URI, or llama.cpp cannot answer.
        """
        parts = [part for message in messages for part in message["content"]]
        addresses = [str(part["image_url"]["url"]) for part in parts if part.get("image_url")]
        if not all(address.startswith("data:") for address in addresses):
            raise ModelError(f"{self.name}: a picture is given as a data URI, never as an address")
        try:
            found = self._handler(
                llama=self._model.llama, messages=list(messages), temperature=0.0,
                max_tokens=max_tokens, repeat_penalty=1.0,
            )  # fmt: skip
        except Exception as error:  # ValueError, RuntimeError, Jinja's
            raise ModelError(f"{self.name}: llama.cpp cannot answer: {error}") from error
        return str(found["choices"][0]["message"]["content"] or "")

    def close(self) -> None:
        """Free the memory of both; they cannot be used afterwards."""
        self._model.close()


def _text(text: str) -> dict[str, Any]:
    return {"type": "text", "text": text}


def has_pictures() -> bool:
    """Return whether the installed llama-cpp-python was built with its picture library."""
    spec = find_spec("llama_cpp")
    place = Path(((spec and spec.submodule_search_locations) or [""])[0])
    return any(path.name.startswith(("libmtmd.", "mtmd.")) for path in place.glob("lib/*"))


def require_pictures() -> None:
    """Refuse where llama.cpp cannot look at pictures; ModelError says how to build it."""
    if has_pictures():
        return
    if find_spec("llama_cpp") is None:
        raise ModelError(f"llama-cpp-python is not installed\n  To fix: {repair()}")
    raise ModelError(
        "llama-cpp-python was built without pictures (no libmtmd in its lib folder)\n"
        f"  To fix: {rebuild_llama('')} (our own options, which have them)\n"
        '  Or use a folder of safetensors: vision = "transformers:NAME"'
    )


def trial(model: str, projector: str) -> None:
    """Load both files and look at a picture, where it may kill nothing but this process."""
    import llama_cpp

    llama = llama_cpp.Llama(model, n_ctx=2048, n_threads=1, n_gpu_layers=0, verbose=False)
    content = [
        {"type": "image_url", "image_url": {"url": picture_url(np.full((8, 8, 3), 128, np.uint8))}},
        {"type": "text", "text": "What is this?"},
    ]
    messages = [{"role": "user", "content": content}]
    _handler(Path(projector), use_gpu=False)(llama=llama, messages=messages, max_tokens=1)


def try_pair(pair: PicturePair) -> None:
    """Try two files that nobody vouches for; see `try_in_own_process`."""
    cannot = f"cannot look at a picture by it and {pair.model.name}"
    try_in_own_process(f"{__name__}:trial", pair.model, pair.projector, cannot=cannot)


def _handler(projector: Path, *, use_gpu: bool) -> Any:
    """Return llama-cpp-python's handler, and let its library speak of errors only."""
    from llama_cpp import _logger, llama_chat_format, mtmd_cpp

    mtmd_cpp.mtmd_log_set(_logger.llama_log_callback, None)
    mtmd_cpp.mtmd_helper_log_set(_logger.llama_log_callback, None)
    return llama_chat_format.MTMDChatHandler(
        clip_model_path=str(projector), verbose=False, use_gpu=use_gpu
    )
