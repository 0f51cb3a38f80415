"""Decode with one GGUF file: text to tokens, tokens to logits, keys and values kept.

A prompt is always decoded in the same cut, each segment by itself, also when nothing is kept: how a
prompt is cut into calls changes the last bits of the logits, so only then are warm and cold answers
identical bit for bit. What is in the context of the last prompt is used again as far as the next
begins with it, except for recurrent and hybrid models, whose state cannot be cut back. How long the
context is changes no bit, so it is as long as the longest prompt so far has needed.
"""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from karma.errors import ModelError
from karma.files import repair
from karma.models.checks.gguf import check_gguf
from karma.models.checks.memory import Footprint, check_memory
from karma.models.constraint import Logits, llama_tokenizer
from karma.models.llama.answer import TokenTable
from karma.models.llama.opening import (
    LlamaOptions,
    free_mb,
    open_context,
    open_gguf,
    place,
    try_in_own_process,
)
from karma.models.manifest import check_file
from karma.models.thoughts import is_tag
from karma.types.completion import Engine

_TRIAL = "karma.models.llama.chat_template:trial"
_N_BATCH = 512  # tokens per call; measured to change nothing but memory and speed
_PLAIN_TYPES = (0, 1, 7, 32)  # F32, F16, Q8_0, BF16, whose sums over several tokens are cheap
_LEAST_EXPECTED = 3  # tokens that go along in a call; fewer take as long as alone
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
        self.llama: Any = open_gguf(path, keywords)
        self.vocabulary = int(self.llama.n_vocab())  # how many tokens there are
        self.end_token = int(self.llama.token_eos())  # it ends an answer
        self._control = _control_tokens(self.llama)
        self.table = _token_table(self.llama, self._control)
        letter = b"".join(self.table.pieces[one] for one in self._tokenized("a", False))
        self._spaces = letter[:1] == b" "  # the tokens of a text say a space before it
        self._kept: list[tuple[int, ...]] = []  # batches of the prompt in the context
        self._ahead: list[int] = []  # tokens that were decoded behind the last, as a guess
        self._row = -1  # of the last call's logits, those after the last token
        self._can_rewind = not (self.llama._is_recurrent or self.llama._is_hybrid)
        is_plain = metadata.get("general.file_type") in _PLAIN_TYPES
        self._looks_ahead = self._can_rewind and is_plain

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
        self, segments: Sequence[Sequence[int]], *, is_late: Callable[[], bool] = never
    ) -> int:
        """Decode a prompt, each segment by itself; return how many tokens were there already.

        `is_late` is asked before each batch of tokens; what was read until then stays, and the same
        prompt goes on from there.

        Raises:
            ModelError: it does not fit the context, or llama.cpp cannot decode it.
            OutOfTime: it is late.
        """
        self.make_room(sum(map(len, segments)))
        batches = [
            tuple(segment[start : start + self.n_batch])
            for segment in segments
            for start in range(0, len(segment), self.n_batch)
        ]
        most = len(batches) - 1 if self._can_rewind else 0  # the last one's logits are needed
        same = next(
            (n for n in range(min(most, len(self._kept))) if self._kept[n] != batches[n]),
            min(most, len(self._kept)),
        )
        self._kept, self._ahead = self._kept[:same], []
        reused = sum(map(len, self._kept))
        if reused:
            self.llama.n_tokens = reused
        else:
            self.llama.reset()
        for batch in batches[same:]:
            if is_late():
                raise OutOfTime
            self.extend(batch)
            self._kept.append(batch)
        return reused

    def extend(self, tokens: Sequence[int], *, ahead: Sequence[int] = ()) -> None:
        """Decode tokens, a batch at most, behind what was decoded last.

        A guess of what follows goes along in the same call, which is quicker than calls of their
        own; what comes true of it is there when the model is extended by it. Errors as in
        `evaluate`.
        """
        if tokens and self._ahead[: len(tokens)] == list(tokens):
            del self._ahead[: len(tokens)]
            self._row += len(tokens)
            self.llama.n_tokens += len(tokens)
            return
        self._ahead, self._row = [], -1
        try:
            if self._looks_ahead and len(ahead) >= _LEAST_EXPECTED:
                self._decode_ahead(tokens, ahead)
            else:
                self.llama.eval(list(tokens))
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

    def branch(self, start: int, tokens: Sequence[int]) -> Logits:
        """Decode tokens behind the first `start`, in place of others; return a row for each.

        The rows are valid until the next call.

        Raises:
            ModelError: the model's state cannot be taken back, or llama.cpp cannot decode.
        """
        import llama_cpp

        if not self._can_rewind:
            raise ModelError(f"{self.name}: keeps no keys and values, so it cannot branch")
        self.llama.n_tokens = start
        rows = []
        for first in range(0, len(tokens), self.n_batch):
            batch = tokens[first : first + self.n_batch]
            try:
                self._decode_ahead(batch, ())
            except RuntimeError as error:
                raise ModelError(f"{self.name}: llama.cpp cannot decode: {error}") from error
            pointer = llama_cpp.llama_get_logits(self.llama.ctx)
            rows.append(np.ctypeslib.as_array(pointer, (len(batch), self.vocabulary)).copy())
        return np.concatenate(rows)

    def logits(self) -> Logits:
        """Return the logits after the last token, shape (vocabulary,), valid until the next."""
        import llama_cpp

        pointer = llama_cpp.llama_get_logits_ith(self.llama.ctx, self._row)
        return np.ctypeslib.as_array(pointer, shape=(self.vocabulary,))

    @cached_property
    def grammar_tokens(self) -> Any:
        """The vocabulary as `Constraint` takes it; control tokens are in no answer."""
        words = [b"" if token in self._control else p for token, p in enumerate(self.table.pieces)]
        return llama_tokenizer(self.llama, words, sorted(self.table.end_tokens))

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


def _control_tokens(llama: Any) -> frozenset[int]:
    import llama_cpp

    vocab = llama._model.vocab
    tokens = range(llama.n_vocab())
    return frozenset(n for n in tokens if llama_cpp.llama_vocab_is_control(vocab, n))


def _token_table(llama: Any, control: frozenset[int]) -> TokenTable:
    """Return the vocabulary as bytes; control tokens say nothing, except tags of thoughts."""
    import llama_cpp

    vocab = llama._model.vocab
    buffer = ctypes.create_string_buffer(_PIECE_BYTES)

    def piece(token: int) -> bytes:
        if token in control:
            word = llama._model.token_get_text(token)
            return word.encode() if is_tag(word) else b""
        size = llama_cpp.llama_token_to_piece(vocab, token, buffer, _PIECE_BYTES, 0, False)
        if size >= 0:
            return buffer.raw[:size]
        longer = ctypes.create_string_buffer(-size)  # llama.cpp answers with the size it needs
        llama_cpp.llama_token_to_piece(vocab, token, longer, -size, 0, False)
        return longer.raw

    tokens = range(llama.n_vocab())
    ends = [token for token in tokens if llama_cpp.llama_vocab_is_eog(vocab, token)]
    return TokenTable([piece(token) for token in tokens], ends)
