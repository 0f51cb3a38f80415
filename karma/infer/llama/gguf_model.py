"""Open one GGUF file under llama.cpp, after a trial in a process of its own, and decode with it.

A prompt is always decoded in the same cut, [stable] then [changing], also when nothing is kept:
how a prompt is cut into calls changes the last bits of the logits, so only then are warm and cold
answers identical bit for bit. What was computed of stable parts is kept, see `room_states`.
"""

import ctypes
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from karma.contracts import Engine, KvState
from karma.errors import ModelError
from karma.infer.checks.gguf import check_gguf
from karma.infer.checks.memory import check_memory, gguf_parts_mb, kept_mb
from karma.infer.llama.constrain import Logits, TokenTable
from karma.infer.llama.kv_state import llama_build, put_back, taken_out
from karma.infer.llama.room_states import RoomStates, StateOptions
from karma.infer.manifest.manifest import check_file, sha256_of

KvType = Literal["f16", "f32"]

_N_BATCH = 512  # tokens per call; measured to change nothing but memory and speed
_PIECE_BYTES = 256
_SMALLER = "take a smaller model (`karma models list`) or a shorter context"

# Loads a file and decodes one token, as `open_gguf` will; sys.argv[1] is the file.
_TRIAL = (
    "import sys, llama_cpp\n"
    "llama_cpp.Llama(sys.argv[1], n_ctx=32, n_threads=1, verbose=False).eval([0])\n"
)


class GgufModel:
    """An opened file: text to tokens, tokens to logits, keys and values kept.

    Args:
        path: the file; any GGUF that llama.cpp can run.
        n_ctx: context in tokens; never more than the model was trained for.
        n_threads: by default two, or one where there is only one core; results do not depend on
            it. More than there are free cores is slower.
        kv: type of the kept keys and values.
        name: by default the file's name.
        sha256: if given, the file is refused unless it has this hash; a file without is first
            tried in a process of its own, which costs a second or two.
        states: where what was computed of stable parts is kept.

    Raises:
        ModelError: missing, of another hash, damaged, or too big for the memory that is free.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        n_ctx: int = 4096,
        n_threads: int | None = None,
        kv: KvType = "f16",
        name: str | None = None,
        sha256: str | None = None,
        states: StateOptions | None = None,
    ) -> None:
        path = Path(path)
        if sha256 is not None:
            check_file(path, sha256)
        elif not path.is_file():
            fix = "`karma models verify` tells which models are there, `make setup` restores them"
            expected = "any (no manifest vouches for this path)"
            raise ModelError(
                f"{path}: no such file\n  Expected SHA-256: {expected}\n  To fix: {fix}"
            )
        metadata = check_gguf(path)
        trained = int(metadata[f"{metadata['general.architecture']}.context_length"])
        self.name = name or path.stem
        self.n_ctx = min(n_ctx, trained)
        self.n_threads = n_threads or min(2, len(os.sched_getaffinity(0)))
        self.n_batch = min(_N_BATCH, self.n_ctx)
        self._kv = kv
        each = 2 if kv == "f16" else 4
        check_memory(
            str(path),
            gguf_parts_mb(path, metadata, context=self.n_ctx, batch=self.n_batch, bytes_each=each),
            parts=f"{path.stat().st_size / 1e6:.0f} MB of file, a context of {self.n_ctx} tokens",
            fix=_SMALLER,
        )
        self._kept_mb = partial(kept_mb, metadata, bytes_each=each)
        if sha256 is None:
            try_in_own_process(path)
        self.llama: Any = open_gguf(path, self.n_ctx, self.n_threads, self.n_batch, kv)
        self.table = _token_table(self.llama)
        self._kept: list[int] = []  # tokens whose keys and values are valid from position 0
        self._keeps = not (self.llama._is_recurrent or self.llama._is_hybrid)
        self._states = self._room_states(path, sha256, states or StateOptions())

    def tokens(self, text: str, *, begins: bool = False, special: bool = False) -> list[int]:
        """Return the tokens of a text.

        Args:
            text: any; half characters are replaced.
            begins: put the model's own first token before it, if it has one and wants it.
            special: let the text name control tokens, as chat templates do.
        """
        found: list[int] = self.llama.tokenize(text.encode("utf-8", "replace"), False, special)
        bos = self.llama.token_bos()
        wanted = begins and bos >= 0 and bool(self.llama._model.add_bos_token())
        return [bos, *found] if wanted and found[:1] != [bos] else found

    @property
    def engine(self) -> Engine:
        """What computes it."""
        return Engine(
            device="CPU", gpu_layers=0, n_ctx=self.n_ctx, threads=self.n_threads,
            batch=self.n_batch, kv=self._kv, flash_attention=False,
        )  # fmt: skip

    @property
    def end_token(self) -> int:
        """The token that ends an answer."""
        return int(self.llama.token_eos())

    @property
    def vocabulary(self) -> int:
        """How many tokens there are."""
        return int(self.llama.n_vocab())

    def evaluate(self, stable: Sequence[int], changing: Sequence[int]) -> KvState:
        """Decode a prompt in its cut; return where the state of its stable part came from.

        Raises:
            ModelError: llama.cpp cannot decode it.
        """
        kept = self._keeps and bool(stable) and self._kept == stable
        self._kept = []  # while decoding, nothing is certain
        if kept:
            self.llama.n_tokens = len(stable)
        source: KvState = "kept" if kept else self._bring(stable)
        self.extend(changing)
        self._kept = list(stable)
        return source

    def _bring(self, stable: Sequence[int]) -> KvState:
        """Have the stable part in an empty cache: put back, or decoded and kept."""
        self.llama.reset()
        states = self._states if stable else None
        if states is not None and (found := states.find(stable)):
            if put_back(self.llama.ctx, found.state):
                self.llama.n_tokens = len(stable)
                return found.source
            states.forget(stable)
        if stable:
            self.extend(stable)
        if states is not None:
            states.keep(stable, taken_out(self.llama.ctx))
        return "evaluated"

    def extend(self, tokens: Sequence[int]) -> None:
        """Decode tokens behind what was decoded last; errors as in `evaluate`."""
        try:
            self.llama.eval(tokens)
        except RuntimeError as error:
            raise ModelError(f"{self.name}: llama.cpp cannot decode: {error}") from error

    def logits(self) -> Logits:
        """Return the logits after the last token, shape (vocabulary,), valid until the next."""
        import llama_cpp

        pointer = llama_cpp.llama_get_logits_ith(self.llama.ctx, -1)
        return np.ctypeslib.as_array(pointer, shape=(self.vocabulary,))

    def _room_states(
        self, path: Path, sha256: str | None, options: StateOptions
    ) -> RoomStates | None:
        """Return where states are kept; None for a model that has none, or if none are wanted.

        Threads and the size of the context change no bit (measured), all else may.
        """
        if not (self._keeps and options.any):
            return None
        weights = "" if options.folder is None else sha256 or sha256_of(path)
        engine = replace(self.engine, n_ctx=0, threads=0)
        return RoomStates(f"{weights} {llama_build()} {engine}", options)

    def sequences(self, count: int, *, cells: int) -> Any:
        """Open a second context over the same weights: one cache for several sequences.

        It is freed with the model at the latest; see `karma.infer.llama.scoring`.

        Args:
            count: of sequences.
            cells: tokens that the cache holds, of all of them together.

        Raises:
            ModelError: the model keeps no keys and values, or there is no memory for more.
        """
        from llama_cpp import _internals, _utils

        if not self._keeps:
            raise ModelError(f"{self.name}: keeps no keys and values, so it cannot branch")
        check_memory(
            self.name, self._kept_mb(cells), parts=f"a second cache, of {cells} tokens",
            fix=_SMALLER,
        )  # fmt: skip
        parameters = type(self.llama.context_params).from_buffer_copy(self.llama.context_params)
        parameters.n_ctx, parameters.n_seq_max, parameters.kv_unified = cells, count, True
        # llama.cpp ends the process where a batch cannot hold a token of each sequence
        parameters.n_batch = parameters.n_ubatch = max(self.n_batch, count)
        try:
            with _utils.suppress_stdout_stderr(disable=False):  # it warns of longer than trained
                return _internals.LlamaContext(
                    model=self.llama._model, params=parameters, verbose=False
                )
        except ValueError as error:
            raise ModelError(f"{self.name}: no memory for a cache of {cells} tokens") from error

    def close(self) -> None:
        """Free the model's memory; it cannot be used afterwards."""
        if self.llama is not None:
            self.llama.close()
            self.llama = None  # what is used after all fails in Python, not in llama.cpp


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


def open_gguf(path: Path, n_ctx: int, threads: int, n_batch: int, kv: KvType) -> Any:
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


def _token_table(llama: Any) -> TokenTable:
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
