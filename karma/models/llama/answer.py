"""Choose an answer's tokens, so that only programs come out, and follow it while it comes.

Tokens are chosen by sample-then-check (see `karma.models.automaton`): the best token first, and
only if it is refused the next best, in exact order. The result equals masking the whole vocabulary,
at the price of one check.

An answer is told of while it comes, and it is known when its time is up and how sure it is. The
chance of a token is that among all tokens, not only those that a grammar admits: a model that
would rather have said what no program can say is not sure either. It costs one sum per token.
"""

import codecs
from collections.abc import Iterator, Sequence
from functools import lru_cache
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.errors import ModelError
from karma.models.automaton import ProgramAutomaton, State, refusal_lines
from karma.models.completeness import cut_off
from karma.types.completion import Certainty, Heard, Listener
from karma.types.planning import AnswerSpec, ProgramSpec

Logits = NDArray[np.float32]

_CHUNK = 64


class TokenTable:
    """A vocabulary as bytes: what each token id appends to the text, b"" for control tokens."""

    def __init__(self, pieces: Sequence[bytes], end_tokens: Sequence[int]) -> None:
        self.pieces = tuple(pieces)
        self.end_tokens = frozenset(end_tokens)
        self._first = np.array([piece[0] if piece else 256 for piece in pieces], np.int16)
        self._is_end = np.zeros(len(pieces), bool)
        self._is_end[list(end_tokens)] = True

    def beginning(self, first_bytes: Sequence[int], *, end: bool) -> NDArray[np.intp]:
        """Return the ids that begin with one of the bytes, and the end tokens if `end`."""
        wanted = np.zeros(257, bool)
        wanted[list(first_bytes)] = True
        chosen = wanted[self._first] & ~self._is_end
        return np.flatnonzero(chosen | self._is_end if end else chosen)


class ChosenToken(NamedTuple):
    """A token, and the state it leads to; None after an end token."""

    token: int
    state: State | None


def best_token(scores: Logits) -> int:
    """Return the token of the highest score, the lowest id of equals.

    ModelError where that score is not a finite number.
    """
    top = int(np.argmax(scores))
    if not np.isfinite(scores[top]):
        raise ModelError(f"the best score of a token is {scores[top]}: damaged weights")
    return top


def choose_token(
    scores: Logits, automaton: ProgramAutomaton, state: State, table: TokenTable
) -> ChosenToken:
    """Return the best token that keeps the program alive, lowest id first among equals.

    `scores` are one per token, e.g. logits, or logits with `gumbel` noise to sample. End tokens are
    admitted where the automaton accepts; the state must not be dead.

    Raises:
        ModelError: no token can continue, or no score is a finite number.
    """
    ends = automaton.accepts(state)

    def admitted(token: int) -> ChosenToken | None:
        if token in table.end_tokens:
            return ChosenToken(token, None) if ends else None
        piece = table.pieces[token]
        after = automaton.advance(state, piece, closing=True) if piece else None
        return None if after is None else ChosenToken(token, after)

    best = admitted(best_token(scores))
    if best is not None:
        return best
    ids = table.beginning(automaton.next_bytes(state), end=ends)
    for rank in descending(scores[ids]):
        choice = admitted(int(ids[rank]))
        if choice is not None:
            return choice
    raise ModelError("no token of this model continues the program (damaged weights or vocabulary)")


def descending(scores: Logits) -> Iterator[int]:
    """Yield the indices of finite scores from high to low, equal ones by index, sorting lazily."""
    count, size, upper = len(scores), _CHUNK, np.float32(np.inf)
    while True:
        rest = size >= count
        lower = np.float32(-np.inf) if rest else np.partition(scores, count - size)[count - size]
        inside = (scores > lower) if rest else (scores >= lower)
        ids = np.flatnonzero(inside & (scores < upper))
        yield from ids[np.argsort(-scores[ids], kind="stable")].tolist()
        if rest:
            return
        size, upper = size * 8, lower


def gumbel(logits: Logits, temperature: float, generator: np.random.Generator) -> Logits:
    """Return scores whose best index is a sample of softmax(logits / temperature).

    The best index among any subset is a sample of the distribution renormalised over it, so
    checking after the noise is exact.
    """
    noise = generator.standard_exponential(len(logits), dtype=np.float32)
    noise = np.maximum(noise, np.finfo(np.float32).tiny)
    return np.asarray(logits / np.float32(temperature) - np.log(noise), np.float32)


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
