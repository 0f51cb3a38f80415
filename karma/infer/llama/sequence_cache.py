"""Keys and values of a prompt, and of what may follow it, in a llama.cpp context of their own.

llama.cpp's CPU kernels for F32, F16, BF16 and Q8_0 (measured on x86) give a token the same bits in
any batch of two or more, whatever else is decoded with it, as long as its sequence lies in the same
cells; a batch, or a request for logits, of one goes through other kernels. So nothing here is
decoded, or asked for, alone.
"""

from collections.abc import Sequence

import numpy as np

from karma.errors import ModelError
from karma.infer.llama.model import LlamaModel
from karma.infer.llama.token_trie import Logits

SEQUENCES = 255  # in one cache; number 0 holds the prompt
_SPARE = 255  # one more, for a token that keeps another company
_CELLS = 1024  # besides the prompt's


class SequenceCache:
    """The prompt is sequence 0; what follows it is there too, or in the others.

    Args:
        model: whose weights are used; its own cache is left alone.

    Raises:
        ModelError: the model keeps no keys and values, or there is no memory for a second cache.
    """

    def __init__(self, model: LlamaModel) -> None:
        import llama_cpp

        self.cells = model.n_ctx + _CELLS
        self.batch = model.n_batch
        self._model = model
        self._context = model.sequences(_SPARE + 1, cells=self.cells + 1)
        self._memory = llama_cpp.llama_get_memory(self._context.ctx)
        self._tokens = llama_cpp.llama_batch_init(max(self.batch, 2), 0, SEQUENCES)
        self._branched = False

    def extend(self, tokens: Sequence[int], position: int) -> Logits:
        """Decode a part of the prompt; return the logits after its last token."""
        for first in range(0, len(tokens), self.batch):
            part = tokens[first : first + self.batch]
            places = range(position + first, position + first + len(part))
            logits = self.decode(part, places, [[0]] * len(part), last_only=True)
        last: Logits = logits[-1].copy()
        return last

    def decode(
        self,
        tokens: Sequence[int],
        positions: Sequence[int],
        sequences: Sequence[Sequence[int]],
        *,
        last_only: bool = False,
    ) -> Logits:
        """Decode one batch; return logits, a row per token (or one), valid until the next.

        Raises:
            ModelError: llama.cpp cannot.
        """
        import llama_cpp

        count = len(tokens)
        alone = count == 1
        for number in range(count):
            wanted = not last_only or number >= count - 2
            self._set(number, tokens[number], positions[number], sequences[number], wanted=wanted)
        if alone:
            self._set(1, tokens[0], positions[0], [_SPARE], wanted=True)
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

    def copy(self, source: int, target: int, end: int) -> None:
        """Let one sequence begin as another does, up to a position."""
        import llama_cpp

        llama_cpp.llama_memory_seq_cp(self._memory, source, target, 0, end)
        self._branched = True

    def forget(self, position: int) -> None:
        """Keep sequence 0 up to a position, and nothing else."""
        import llama_cpp

        if self._branched:
            llama_cpp.llama_memory_seq_keep(self._memory, 0)
            self._branched = False
        llama_cpp.llama_memory_seq_rm(self._memory, 0, position, -1)

    def close(self) -> None:
        """Free it, once."""
        import llama_cpp

        if self._tokens is not None:
            llama_cpp.llama_batch_free(self._tokens)
            self._tokens = None
            self._context.close()
            self._memory = None  # what is used after all fails in Python, not in llama.cpp

    def _set(
        self, number: int, token: int, position: int, sequences: Sequence[int], *, wanted: bool
    ) -> None:
        batch = self._tokens
        batch.token[number], batch.pos[number] = token, position
        batch.n_seq_id[number] = len(sequences)
        for place, sequence in enumerate(sequences):
            batch.seq_id[number][place] = sequence
        batch.logits[number] = wanted
