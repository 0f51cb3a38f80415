"""Follow one answer: tell of it while it comes, know when its time is up and how sure it is.

The chance of a token is that among all tokens, not only those that a grammar admits: a model that
would rather have said what no program can say is not sure either. It costs one sum per token.
"""

import codecs
from collections.abc import Sequence
from functools import lru_cache
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from karma.contracts import AnswerSpec, Certainty, Heard, Listener, ProgramSpec
from karma.infer.automaton import refusal_lines
from karma.infer.llama.constrain import Logits, TokenTable
from karma.language.whole import cut_off


class UnderWay:
    """One answer from when it was asked for: heard while it comes, late after `max_seconds`."""

    def __init__(self, max_seconds: float | None, listen: Listener | None) -> None:
        self._begun = perf_counter()
        self._most, self._listen = max_seconds, listen
        self._letters = codecs.getincrementaldecoder("utf-8")("replace")
        self._tokens = 0
        self.first_token_s: float | None = None  # None: it has not begun

    @property
    def seconds(self) -> float:
        """Since it was asked for."""
        return perf_counter() - self._begun

    @property
    def is_late(self) -> bool:
        """Whether its time is up."""
        return self._most is not None and self.seconds >= self._most

    @property
    def late(self) -> str:
        """Say that its time was up."""
        return cut_off(seconds=self._most or 0)

    def begins(self) -> None:
        """Note that the first token of the answer is there, a thought before it not counted."""
        if self.first_token_s is None:
            self.first_token_s = self.seconds

    def came(self, piece: bytes, tokens: int = 1) -> None:
        """Note so many tokens, which append so much to the text; half letters wait for the rest."""
        self._tokens += tokens
        if self._listen is not None:
            text = self._letters.decode(piece)
            self._listen(Heard(text=text, tokens=self._tokens, seconds=self.seconds))


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
