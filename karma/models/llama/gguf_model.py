"""Decode with one GGUF file: text to tokens, tokens to logits, keys and values kept.

A prompt is always decoded in the same cut, [stable] then [changing], also when nothing is kept:
how a prompt is cut into calls changes the last bits of the logits, so only then are warm and cold
answers identical bit for bit. What was computed of stable parts is kept, see `room_states`. How
long the context is changes no bit, so it is as long as the longest prompt so far has needed.
"""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from karma.errors import ModelError
from karma.files import repair
from karma.models.checks.gguf import check_gguf
from karma.models.checks.memory import Footprint, check_memory
from karma.models.llama.answer import Logits, TokenTable
from karma.models.llama.opening import (
    LlamaOptions,
    free_mb,
    open_context,
    open_gguf,
    place,
    try_in_own_process,
)
from karma.models.llama.room_states import RoomStates, put_back, taken_out
from karma.models.manifest import check_file
from karma.types.completion import Engine, KvState

_TRIAL = "karma.models.llama.chat_template:trial"
_N_BATCH = 512  # tokens per call; measured to change nothing but memory and speed
_PLAIN_TYPES = (0, 1, 7, 32)  # F32, F16, Q8_0, BF16, whose sums over several tokens are cheap
_WORTH_GUESSING = (3, 9)  # tokens ahead, of those and of other files: fewer cost as much as alone
_PLANNED = 8192  # tokens that layers on a GPU leave room for, where the context is not said
_PIECE_BYTES = 256
_MARKS = ("\n", "|", "\x01")  # one of them goes together with no text that follows
_SMALLER = "take a smaller model (`karma models list`) or a shorter context"


def never() -> bool:
    """Return False: there is all the time in the world."""
    return False


class OutOfTime(Exception):
    """A prompt's time was up before all of it was read."""


class GgufModel:
    """An opened file: text to tokens, tokens to logits, keys and values kept.

    A file is refused unless it has the SHA-256 that is given (`restore` is the step that brings it
    back); one without is first tried in a process of its own, which costs a second or two, unless
    it was `tried`. `beside_mb` is what
    memory something else will take with it, on the same device.

    Attributes:
        metadata: what the file says of itself; llama-cpp-python drops it all for one bad letter.

    Raises:
        ModelError: missing, of another hash, damaged, too big for the memory that is free, or not
            possible with these options.
    """

    def __init__(
        self,
        path: str | Path,
        options: LlamaOptions | None = None,
        *,
        name: str | None = None,
        sha256: str | None = None,
        restore: str = "",
        beside_mb: float = 0.0,
        tried: bool = False,
    ) -> None:
        path, options = Path(path), options or LlamaOptions()
        _check_there(path, sha256, restore)
        self.metadata = metadata = check_gguf(path)
        trained = int(metadata[f"{metadata['general.architecture']}.context_length"])
        self.name, self.options = name or path.stem, options
        self.limit = options.n_ctx or trained
        self.n_batch = min(_N_BATCH, self.limit)
        self.n_ctx = self.limit if options.n_ctx else self.n_batch
        self.size = Footprint.of(path, metadata, batch=self.n_batch, beside_mb=beside_mb)
        planned = self.limit if options.n_ctx else min(self.limit, _PLANNED)
        self.placement = place(self.name, self.size, options, context=planned)
        off = 1 - min(1.0, self.placement.layers / self.size.blocks)  # what is not on a GPU
        check_memory(
            str(path), off * self.size.layers_mb(self.n_ctx) + self.size.work_mb(self.n_ctx),
            parts=f"{off * self.size.file_mb:.0f} MB of file, a context of {self.n_ctx} tokens",
            fix=_SMALLER,
        )  # fmt: skip
        if sha256 is None and not tried:
            try_in_own_process(_TRIAL, path, cannot="cannot run it")
        keywords: Mapping[str, Any] = {
            "n_ctx": self.n_ctx, "n_batch": self.n_batch, "n_threads": options.threads,
            "n_threads_batch": options.threads, "flash_attn": self._flash,
            **self.placement.keywords,
        }  # fmt: skip
        self.llama: Any
        self.llama, layers = open_gguf(path, keywords)
        if layers != self.placement.layers:
            raise ModelError(
                f"{self.name}: llama.cpp put {layers} layers on {self.placement.name}, not "
                f"{self.placement.layers}\n  To fix: gpu_layers = 0"
            )
        self.vocabulary = int(self.llama.n_vocab())  # how many tokens there are
        self.end_token = int(self.llama.token_eos())  # it ends an answer
        self.table = _token_table(self.llama)
        letter = b"".join(self.table.pieces[one] for one in self._tokenized("a", False))
        self._spaces = letter[:1] == b" "  # the tokens of a text say a space before it
        self._kept: list[int] = []  # tokens whose keys and values are valid from position 0
        self._ahead: list[int] = []  # tokens that were decoded behind the last, as a guess
        self._row = -1  # of the last call's logits, those after the last token
        self._keeps = not (self.llama._is_recurrent or self.llama._is_hybrid)
        self._is_plain = metadata.get("general.file_type") in _PLAIN_TYPES
        self._states = RoomStates() if self._keeps else None

    def tokens(self, text: str, *, begins: bool = False, special: bool = False) -> list[int]:
        """Return the tokens of a text, or of a part of one; half characters are replaced.

        Where it `begins`, nothing stands before it: the model's own first token goes there, if it
        has one and wants it, and SentencePiece's space. A `special` text may name control tokens,
        as chat templates do.
        """
        found = self._tokenized(text, special) if begins or not self._spaces else []
        if text and not found:
            found = self._continued(text, special)
        bos = self.llama.token_bos()
        wanted = begins and bos >= 0 and bool(self.llama._model.add_bos_token())
        return [bos, *found] if wanted and found[:1] != [bos] else found

    def _continued(self, text: str, special: bool) -> list[int]:
        """Return the tokens of a text after another, without a space of SentencePiece's."""
        for mark in _MARKS:  # the space goes before it
            before, both = self._tokenized(mark, False), self._tokenized(mark + text, special)
            if both[: len(before)] == before:
                return both[len(before) :]
        return self._tokenized(text, special)

    def _tokenized(self, text: str, special: bool) -> list[int]:
        found: list[int] = self.llama.tokenize(text.encode("utf-8", "replace"), False, special)
        return found

    @property
    def engine(self) -> Engine:
        """What computes it."""
        return Engine(
            device=self.placement.name, gpu_layers=self.placement.layers, n_ctx=self.n_ctx,
            threads=self.options.threads, batch=self.n_batch, kv="f16",
            flash_attention=self._flash,
        )  # fmt: skip

    def make_room(self, tokens: int) -> None:
        """Let the context hold so many tokens; one that is opened anew keeps nothing.

        ModelError for more than the limit, or where there is no memory for it.
        """
        if tokens <= self.n_ctx:
            return
        if tokens > self.limit:
            why = "as n_ctx says" if self.options.n_ctx == self.limit else "as it was trained for"
            raise ModelError(
                f"{self.name}: {tokens} tokens do not fit its context of {self.limit}, {why}"
            )
        wanted = min(self.limit, 1 << (tokens - 1).bit_length())
        try:
            self._check_more(wanted - self.n_ctx, f"a context of {wanted} tokens")
        except ModelError:
            wanted = tokens  # nothing to spare for the next
            self._check_more(wanted - self.n_ctx, f"a context of {wanted} tokens")
        self._kept, self.n_ctx = [], 0
        self.llama._ctx.close()
        try:
            self.llama._ctx = open_context(self.llama, wanted)
        except ValueError as error:
            raise ModelError(f"{self.name}: no memory for a context of {wanted}") from error
        self.llama.input_ids = np.zeros(wanted, np.intc)
        self.llama._n_ctx = self.n_ctx = wanted

    def evaluate(
        self, stable: Sequence[int], changing: Sequence[int], *, is_late: Callable[[], bool] = never
    ) -> KvState:
        """Decode a prompt in its cut; return where the state of its stable part came from.

        `is_late` is asked before each batch of tokens; what was read until then stays, and the same
        prompt goes on from there.

        Raises:
            ModelError: it does not fit the context, or llama.cpp cannot decode it.
            OutOfTime: it is late.
        """
        self.make_room(len(stable) + len(changing))
        known = self._known(stable)
        self._kept, self._ahead = [], []  # while decoding, nothing is certain
        try:
            if known:
                self.llama.n_tokens = known
            source: KvState = "kept"
            if not stable or known < len(stable):
                source = self._bring(stable, known, is_late)
            self.extend(changing, is_late=is_late)
        except OutOfTime:
            self._kept = list(stable[: self.llama.n_tokens])
            raise
        self._kept = list(stable)
        return source

    def _known(self, stable: Sequence[int]) -> int:
        """Return how many tokens of the stable part are in the cache, in batches as it is read."""
        count = len(self._kept)
        if not self._keeps or self._kept != stable[:count]:
            return 0
        return count if count == len(stable) or count % self.n_batch == 0 else 0

    def _bring(self, stable: Sequence[int], known: int, is_late: Callable[[], bool]) -> KvState:
        """Have the stable part in the cache, of which some is: put back, or decoded and kept."""
        states = self._states if stable else None
        if not known:
            self.llama.reset()
        state = states.find(stable) if states is not None and not known else None
        if states is not None and state is not None:
            if put_back(self.llama.ctx, state):
                self.llama.n_tokens = len(stable)
                return "kept"
            states.forget(stable)
        if stable:
            self.extend(stable[known:], is_late=is_late)
        if states is not None:
            states.keep(stable, taken_out(self.llama.ctx))
        return "evaluated"

    def extend(
        self,
        tokens: Sequence[int],
        *,
        ahead: Sequence[int] = (),
        is_late: Callable[[], bool] = never,
    ) -> None:
        """Decode tokens behind what was decoded last; `is_late` and errors as in `evaluate`.

        A guess of what follows goes along in the same call, which is quicker than calls of their
        own; what comes true of it is there when the model is extended by it.
        """
        if tokens and self._ahead[: len(tokens)] == list(tokens):
            del self._ahead[: len(tokens)]
            self._row += len(tokens)
            self.llama.n_tokens += len(tokens)
            return
        self._ahead, self._row = [], -1
        try:
            if self._keeps and len(ahead) >= _WORTH_GUESSING[0 if self._is_plain else 1]:
                self._decode_ahead(tokens, ahead)
                return
            for start in range(0, len(tokens), self.n_batch):
                if is_late():
                    raise OutOfTime
                self.llama.eval(tokens[start : start + self.n_batch])
        except RuntimeError as error:
            raise ModelError(f"{self.name}: llama.cpp cannot decode: {error}") from error

    def _decode_ahead(self, tokens: Sequence[int], ahead: Sequence[int]) -> None:
        """Decode tokens and a guess in one call, with the logits after each."""
        llama, first = self.llama, self.llama.n_tokens
        both = [*tokens, *ahead][: min(self.n_batch, self.n_ctx - first)]
        llama._ctx.kv_cache_seq_rm(-1, first, -1)
        llama._batch.set_batch(batch=both, n_past=first, logits_all=True)
        llama._ctx.decode(llama._batch)
        llama.n_tokens = first + len(tokens)
        self._ahead, self._row = both[len(tokens) :], len(tokens) - 1

    @property
    def decoded(self) -> int:
        """How many tokens were decoded, the prompt's included."""
        return int(self.llama.n_tokens)

    def rewind(self, tokens: int) -> None:
        """Forget what was decoded behind the first so many tokens; there are no logits then."""
        self.llama.n_tokens, self._ahead = tokens, []

    def logits(self) -> Logits:
        """Return the logits after the last token, shape (vocabulary,), valid until the next."""
        import llama_cpp

        pointer = llama_cpp.llama_get_logits_ith(self.llama.ctx, self._row)
        return np.ctypeslib.as_array(pointer, shape=(self.vocabulary,))

    def sequences(self, count: int, *, cells: int) -> Any:
        """Open a second context over the same weights: `cells` tokens of several sequences.

        It is freed with the model at the latest; see `karma.models.llama.scoring`.

        Raises:
            ModelError: the model keeps no keys and values, or there is no memory for more.
        """
        if not self._keeps:
            raise ModelError(f"{self.name}: keeps no keys and values, so it cannot branch")
        self._check_more(cells, f"a second cache, of {cells} tokens")
        # llama.cpp ends the process where a batch cannot hold a token of each sequence
        batch = max(self.n_batch, count)
        try:
            return open_context(self.llama, cells, sequences=count, batch=batch)
        except ValueError as error:
            raise ModelError(f"{self.name}: no memory for a cache of {cells} tokens") from error

    def close(self) -> None:
        """Free the model's memory; it cannot be used afterwards."""
        if self.llama is not None:
            self.llama.close()
            self.llama = None  # what is used after all fails in Python, not in llama.cpp

    @property
    def _flash(self) -> bool:
        return bool(self.placement.layers)

    def _check_more(self, tokens: int, parts: str) -> None:
        """Refuse so many more tokens where their keys and values do not fit."""
        free = free_mb(self.placement.devices) if self.placement.layers else None
        check_memory(
            self.name, tokens * self.size.token_mb, parts=parts, fix=_SMALLER, free_mb=free
        )


def _check_there(path: Path, sha256: str | None, restore: str) -> None:
    """Refuse a file that is missing or, where a hash is given, another."""
    if sha256 is not None:
        check_file(path, sha256, restore=restore)
    elif not path.is_file():
        fix = f"`karma models verify` tells which models are there, `{repair()}` restores them"
        expected = "any (no manifest vouches for this path)"
        raise ModelError(f"{path}: no such file\n  Expected SHA-256: {expected}\n  To fix: {fix}")


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
