"""Keep keys and values of a prompt, and of one text behind it, in a context of their own.

llama.cpp's CPU kernels for F32, F16, BF16 and Q8_0 (measured on x86) give a token the same bits in
any batch of two or more, whatever else is decoded with it, as long as its sequence lies in the same
cells; a batch, or a request for logits, of one goes through other kernels. So nothing here is
decoded, or asked for, alone.
"""

from collections.abc import Sequence

import numpy as np

from karma.errors import ModelError
from karma.infer.llama.constrain import Logits
from karma.infer.llama.gguf_model import GgufModel

_TEXT, _SPARE = 0, 1  # sequences; the spare one is for a token that keeps another company


class SequenceCache:
    """One text as tokens at positions, extended or cut back at its end.

    Args:
        model: whose weights are used; its own cache is left alone.

    Raises:
        ModelError: the model keeps no keys and values, or there is no memory for a second cache.
    """

    def __init__(self, model: GgufModel) -> None:
        import llama_cpp

        self.batch = model.n_batch
        self._model = model
        self._open(model.n_ctx)
        self._tokens = llama_cpp.llama_batch_init(max(self.batch, 2), 0, 1)

    def make_room(self, tokens: int) -> bool:
        """Let it hold so many tokens; return whether it was opened anew, and keeps nothing.

        Raises:
            ModelError: there is no memory for it.
        """
        if tokens <= self._size:
            return False
        self._context.close()
        self._open(min(self._model.limit, 1 << (tokens - 1).bit_length()))
        return True

    def _open(self, size: int) -> None:
        import llama_cpp

        self._size = 0
        self._context = self._model.sequences(2, cells=size + 1)  # one more for the spare
        self._size = size
        self._memory = llama_cpp.llama_get_memory(self._context.ctx)

    def extend(self, tokens: Sequence[int], position: int) -> Logits:
        """Decode a text from a position on; return the logits after its last token."""
        for first in range(0, len(tokens), self.batch):
            logits = self.decode(
                tokens[first : first + self.batch], position + first, last_only=True
            )
        last: Logits = logits[-1].copy()
        return last

    def decode(self, tokens: Sequence[int], position: int, *, last_only: bool = False) -> Logits:
        """Decode one batch from a position on; return logits, valid until the next.

        Args:
            tokens: at most `batch`.
            position: of the first.
            last_only: return one row, that after the last token, instead of a row per token.

        Raises:
            ModelError: llama.cpp cannot.
        """
        import llama_cpp

        count = len(tokens)
        alone = count == 1
        for number, token in enumerate(tokens):
            wanted = not last_only or number >= count - 2
            self._set(number, token, position + number, _TEXT, wanted=wanted)
        if alone:
            self._set(1, tokens[0], position, _SPARE, wanted=True)
        self._tokens.n_tokens = max(count, 2)
        code = llama_cpp.llama_decode(self._context.ctx, self._tokens)
        if code != 0:
            raise ModelError(f"{self._model.name}: llama.cpp cannot score (code {code})")
        if alone:
            llama_cpp.llama_memory_seq_rm(self._memory, _SPARE, -1, -1)
        rows = 2 if last_only or alone else count
        pointer = llama_cpp.llama_get_logits(self._context.ctx)
        shape = rows, self._model.vocabulary
        logits = np.asarray(np.ctypeslib.as_array(pointer, shape=shape), np.float32)
        if alone:
            return logits[:1]
        return logits[-1:] if last_only else logits

    def forget(self, position: int) -> None:
        """Keep the text up to a position, and nothing else."""
        import llama_cpp

        llama_cpp.llama_memory_seq_rm(self._memory, _TEXT, position, -1)

    def close(self) -> None:
        """Free it, once."""
        import llama_cpp

        if self._tokens is not None:
            llama_cpp.llama_batch_free(self._tokens)
            self._tokens = None
            self._context.close()
            self._memory = None  # what is used after all fails in Python, not in llama.cpp

    def _set(self, number: int, token: int, position: int, sequence: int, *, wanted: bool) -> None:
        batch = self._tokens
        batch.token[number], batch.pos[number] = token, position
        batch.n_seq_id[number], batch.seq_id[number][0] = 1, sequence
        batch.logits[number] = wanted
