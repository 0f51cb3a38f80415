"""How sure a model is of what it says, from the scores that its answer is chosen by.

The chance of a token is that among all tokens, not only those that a grammar admits: a model that
would rather have said what no program can say is not sure either. It costs one sum per token.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from karma.contracts import AnswerSpec, Certainty, ProgramSpec
from karma.infer.llama.constrain import Logits, TokenTable
from karma.infer.programs.automaton import refusal_lines

_DIGITS = 6  # of a chance or logarithm: what lies behind differs between processors


class CertaintyLog:
    """Collects the chances of an answer's tokens as they are chosen."""

    def __init__(self, table: TokenTable, spec: AnswerSpec | None) -> None:
        self._refusals = refusal_lines(spec) if isinstance(spec, ProgramSpec) else ()
        self._table = table
        self._logprobs: list[float] = []
        self._refusing: float | None = None

    def add(self, logits: Logits, token: int) -> None:
        """Take in one step: the scores of all tokens, and the token that was chosen."""
        top = float(logits.max())
        whole = float(np.exp(logits - np.float32(top)).sum(dtype=np.float64))
        if not self._logprobs and self._refusals:
            begin = _beginning(self._table, self._refusals[0].partition("(")[0].encode())
            part = np.exp(logits[begin] - np.float32(top)).sum(dtype=np.float64)
            self._refusing = round(float(part) / whole, _DIGITS)
        self._logprobs.append(float(logits[token]) - top - float(np.log(whole)))

    def replace(self, kept: int, logprobs: Sequence[float]) -> None:
        """Put other tokens' logarithms in place of all but the first so many."""
        self._logprobs[kept:] = logprobs

    def certainty(self) -> Certainty | None:
        """Return how sure the answer was; None where nothing was said."""
        if not self._logprobs:
            return None
        return Certainty(
            mean_logprob=round(float(np.mean(self._logprobs)), _DIGITS),
            least_logprob=round(min(self._logprobs), _DIGITS),
            refusing=self._refusing,
        )


@lru_cache(maxsize=8)
def _beginning(table: TokenTable, word: bytes) -> NDArray[np.intp]:
    """Return the tokens that a text which begins with a word may begin with."""
    return np.array(
        [
            number
            for number, piece in enumerate(table.pieces)
            if piece and number not in table.end_tokens
            if piece.startswith(word) or word.startswith(piece)
        ],
        np.intp,
    )
