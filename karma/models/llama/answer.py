"""Follow an answer while it comes: sampling, deadline, listener, and how sure the model was.

The chance of a token is that among all tokens, not only those that a grammar admits: a model that
would rather have said what no program can say is not sure either. It costs one sum per token.
"""

import codecs
from collections.abc import Sequence
from functools import lru_cache
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from karma.models.completeness import cut_off
from karma.models.constraint import Logits
from karma.types.completion import Certainty, Heard, Listener


class TokenTable:
    """A vocabulary as bytes: what each token id appends to the text, b"" for control tokens."""

    def __init__(self, pieces: Sequence[bytes], end_tokens: Sequence[int]) -> None:
        self.pieces = tuple(pieces)
        self.end_tokens = frozenset(end_tokens)


def gumbel(logits: Logits, temperature: float, generator: np.random.Generator) -> Logits:
    """Return scores whose best index is a sample of softmax(logits / temperature).

    The best index among any subset is a sample of the distribution renormalised over it, so
    checking after the noise is exact.
    """
    noise = generator.standard_exponential(len(logits), dtype=np.float32)
    noise = np.maximum(noise, np.finfo(np.float32).tiny)
    return np.asarray(logits / np.float32(temperature) - np.log(noise), np.float32)


class StreamingAnswer:
    """Track an answer from when it was asked for, and its deadline after `max_seconds`."""

    def __init__(self, max_seconds: float | None, listen: Listener | None) -> None:
        self._begun = perf_counter()
        self._most, self._listen = max_seconds, listen
        self._letters = codecs.getincrementaldecoder("utf-8")("replace")
        self._tokens = 0
        self.first_token_s: float | None = None  # None: it has not begun

    @property
    def seconds(self) -> float:
        """Seconds since it was asked for."""
        return perf_counter() - self._begun

    @property
    def is_late(self) -> bool:
        """Whether its time is up."""
        return self._most is not None and self.seconds >= self._most

    @property
    def late(self) -> str:
        """The fault of an answer whose time was up."""
        return cut_off(seconds=self._most or 0)

    def begins(self) -> None:
        """Note that the first token of the answer is there, a thought before it not counted."""
        if self.first_token_s is None:
            self.first_token_s = self.seconds

    def came(self, piece: bytes) -> None:
        """Note a token, which appends a piece to the text; half letters wait for the rest."""
        self._tokens += 1
        if self._listen is not None:
            text = self._letters.decode(piece)
            self._listen(Heard(text=text, tokens=self._tokens, seconds=self.seconds))


_DIGITS = 6  # of a chance or logarithm: what lies behind differs between processors
_REFUSAL = b"refuse"  # what a refusal begins with


class CertaintyLog:
    """Collects the chances of an answer's tokens as they are chosen."""

    def __init__(self, table: TokenTable, *, may_refuse: bool) -> None:
        self._table, self._may_refuse = table, may_refuse
        self._logprobs: list[float] = []
        self._refusing: float | None = None

    def add(self, logits: Logits, token: int) -> None:
        """Add a step: the scores of all tokens, and the token that was chosen."""
        top = float(logits.max())
        whole = float(np.exp(logits - np.float32(top)).sum(dtype=np.float64))
        if not self._logprobs and self._may_refuse:
            part = np.exp(logits[_beginning(self._table)] - np.float32(top)).sum(dtype=np.float64)
            self._refusing = round(float(part) / whole, _DIGITS)
        self._logprobs.append(float(logits[token]) - top - float(np.log(whole)))

    def certainty(self) -> Certainty | None:
        """Return how sure the answer was, or None for an empty answer."""
        if not self._logprobs:
            return None
        return Certainty(
            mean_logprob=round(float(np.mean(self._logprobs)), _DIGITS),
            least_logprob=round(min(self._logprobs), _DIGITS),
            refusing=self._refusing,
        )


@lru_cache(maxsize=8)
def _beginning(table: TokenTable) -> NDArray[np.intp]:
    """Return the tokens that a refusal may begin with."""
    return np.array(
        [
            number
            for number, piece in enumerate(table.pieces)
            if piece and number not in table.end_tokens
            if piece.startswith(_REFUSAL) or _REFUSAL.startswith(piece)
        ],
        np.intp,
    )
