"""Read object states by llama.cpp: a GGUF and its picture projector (mmproj).

llama-cpp-python can do this when its library mtmd was built. Our own build leaves it out
(`LLAVA_BUILD=OFF` in scripts/setup.sh: it doubles the time to build); then opening such a model
says so and how to build it. Nothing of this stands in for it.
"""

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from karma.contracts import Frame, SeenObject
from karma.errors import ModelError
from karma.infer.checks.gguf import LANGUAGE, PROJECTOR, check_gguf
from karma.infer.checks.memory import check_memory, gguf_parts_mb
from karma.infer.vision.pictures import picture_url
from karma.infer.vision.text import question, read_answer, some_picture

BUILD = (
    'CMAKE_ARGS="-DLLAVA_BUILD=ON" pip install --force-reinstall --no-deps --no-binary '
    "llama-cpp-python llama-cpp-python=={version}"
)
_CLASSES = {  # Qwen's by the file's own template: Qwen25VLChatHandler loses its last line break
    "qwen2.5-vl": "MTMDChatHandler", "llava-1.5": "Llava15ChatHandler",
    "llava-1.6": "Llava16ChatHandler", "minicpm-v-2.6": "MiniCPMv26ChatHandler",
    "moondream2": "MoondreamChatHandler",
}  # fmt: skip
HANDLERS = tuple(_CLASSES)
_BATCH = 512


class LlamaVision:
    """A `VisionModel` over two GGUF files; all objects are asked about at once, greedily.

    Args:
        model: the language part.
        projector: the picture part, usually named mmproj-*.gguf.
        family: one of `HANDLERS`.
        n_ctx: context in tokens; a picture takes several hundred.
        max_tokens: of an answer with its four steps.

    Raises:
        ModelError: llama.cpp was built without pictures, a file is missing or damaged, or there is
            too little memory.
    """

    needs_pictures = True

    def __init__(
        self,
        model: str | Path,
        projector: str | Path,
        *,
        family: str = "qwen2.5-vl",
        n_ctx: int = 4096,
        max_tokens: int = 768,
    ) -> None:
        if family not in HANDLERS:
            raise ModelError(f"no family {family!r}; there are {', '.join(HANDLERS)}")
        require_pictures()
        needed = 0.0
        for path, sizes in ((Path(model), LANGUAGE), (Path(projector), PROJECTOR)):
            metadata = check_gguf(path, sizes=sizes)
            needed += gguf_parts_mb(path, metadata, context=n_ctx, batch=_BATCH)
        check_memory(
            str(model), needed, parts="both files, the context and a batch",
            fix="take a smaller model, or give a smaller n_ctx",
        )  # fmt: skip
        self.name = Path(model).stem
        self._max_tokens = max_tokens
        self._llama = _open(Path(model), Path(projector), family, n_ctx)

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
        messages = [
            {"role": "system", "content": role},
            {"role": "user", "content": [picture, {"type": "text", "text": text}]},
        ]
        try:
            answer = self._llama.create_chat_completion(
                messages=messages, temperature=0.0, max_tokens=self._max_tokens
            )
        except (ValueError, RuntimeError) as error:
            raise ModelError(f"{self.name}: llama.cpp cannot answer: {error}") from error
        said = answer["choices"][0]["message"]["content"] or ""
        return read_answer(said, objects).states


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
    from importlib.metadata import PackageNotFoundError, version

    try:
        installed = version("llama-cpp-python")
    except PackageNotFoundError as error:
        raise ModelError("llama-cpp-python is not installed\n  To fix: make setup") from error
    raise ModelError(
        f"llama-cpp-python {installed} was built without pictures (no libmtmd in its lib folder)\n"
        f"  To fix, where there is a compiler: {BUILD.format(version=installed)}\n"
        '  Or use a folder of safetensors: vision = "transformers:NAME"'
    )


def _open(model: Path, projector: Path, family: str, n_ctx: int) -> Any:
    import llama_cpp
    from llama_cpp import llama_chat_format

    try:
        handler = getattr(llama_chat_format, _CLASSES[family])(
            clip_model_path=str(projector), verbose=False
        )
        return llama_cpp.Llama(
            model_path=str(model), chat_handler=handler, n_ctx=n_ctx, n_batch=_BATCH, verbose=False
        )
    except (ValueError, OSError) as error:
        raise ModelError(f"{model}: llama.cpp does not open it: {error}") from error
