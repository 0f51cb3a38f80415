"""Opening a GGUF with llama.cpp: looked at, tried in a process of its own, then loaded."""

import ctypes
import subprocess
import sys
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from karma.errors import ModelError
from karma.infer.llama.constrain import TokenTable
from karma.infer.manifest.memory_check import check_memory, gguf_parts_mb

_PIECE_BYTES = 256

# Loads a file and decodes one token, as `open_gguf` will; sys.argv[1] is the file.
_TRIAL = (
    "import sys, llama_cpp\n"
    "llama_cpp.Llama(sys.argv[1], n_ctx=32, n_threads=1, verbose=False).eval([0])\n"
)


def try_in_own_process(path: Path) -> None:
    """Try a file that nobody vouches for where it may kill nothing but the trial.

    llama.cpp aborts on some damaged files whose header looks right.

    Raises:
        ModelError: the trial failed.
    """
    result = subprocess.run(
        [sys.executable, "-c", _TRIAL, str(path)], capture_output=True, check=False
    )
    if result.returncode != 0:
        said = result.stderr.decode(errors="replace").strip().splitlines() or ["no message"]
        code = result.returncode
        raise ModelError(f"{path}: llama.cpp cannot run it (code {code}): {said[-1]}")


def check_room(
    path: Path, metadata: Mapping[str, Any], *, n_ctx: int, n_batch: int, bytes_each: int
) -> None:
    """Refuse a file that would not fit into memory, before llama.cpp sees it.

    Args:
        path: the file.
        metadata: of its header.
        n_ctx: context in tokens.
        n_batch: tokens per call.
        bytes_each: of a number in the kept keys and values.

    Raises:
        ModelError: it would not.
    """
    needed = gguf_parts_mb(path, metadata, context=n_ctx, batch=n_batch, bytes_each=bytes_each)
    parts = f"{path.stat().st_size / 1e6:.0f} MB of file, and a context of {n_ctx} tokens"
    fix = "take a smaller model (`karma models list`) or a shorter context"
    check_memory(str(path), needed, parts=parts, fix=fix)


def open_gguf(path: Path, n_ctx: int, threads: int, n_batch: int, kv: str) -> Any:
    """Load the file, turning llama.cpp's failures into one that names it.

    Raises:
        ModelError: it cannot be loaded.
    """
    import llama_cpp

    kind = {"f16": llama_cpp.GGML_TYPE_F16, "f32": llama_cpp.GGML_TYPE_F32}[kv]
    try:
        return llama_cpp.Llama(
            str(path),
            n_ctx=n_ctx,
            n_threads=threads,
            n_threads_batch=threads,
            n_batch=n_batch,
            n_gpu_layers=0,
            type_k=kind,
            type_v=kind,
            verbose=False,
        )
    except Exception as error:  # ValueError, RuntimeError, Jinja's: all mean an unusable file
        raise ModelError(f"{path}: llama.cpp cannot load it: {error}") from error


def token_table(llama: Any) -> TokenTable:
    """Return the vocabulary as bytes; control tokens and the unused say nothing."""
    import llama_cpp

    vocab = llama._model.vocab
    buffer = ctypes.create_string_buffer(_PIECE_BYTES)

    def piece(token: int) -> bytes:
        size = llama_cpp.llama_token_to_piece(vocab, token, buffer, _PIECE_BYTES, 0, False)
        if size >= 0:
            return buffer.raw[:size]
        longer = ctypes.create_string_buffer(-size)  # llama.cpp answers with the size it needs
        llama_cpp.llama_token_to_piece(vocab, token, longer, -size, 0, False)
        return longer.raw

    tokens = range(llama.n_vocab())
    ends = [token for token in tokens if llama_cpp.llama_vocab_is_eog(vocab, token)]
    return TokenTable([piece(token) for token in tokens], ends)


def chat_renderer(llama: Any, path: Path) -> Any:
    """Return the renderer of the GGUF's chat template; its date never changes.

    Raises:
        ModelError: there is no template.
    """
    from llama_cpp.llama_chat_format import Jinja2ChatFormatter

    text = llama.metadata.get("tokenizer.chat_template")
    if text is None:
        raise ModelError(f"{path}: has no chat template; open it with chat=False")

    class Formatter(Jinja2ChatFormatter):  # type: ignore[misc]
        @staticmethod
        def strftime_now(form: str) -> str:
            return datetime(2025, 1, 1).strftime(form)

    word = llama._model.token_get_text
    bos, eos = llama.token_bos(), llama.token_eos()
    return Formatter(
        template=text,
        bos_token=word(bos) if bos >= 0 else "",
        eos_token=word(eos) if eos >= 0 else "",
    )
