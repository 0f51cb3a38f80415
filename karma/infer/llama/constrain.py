"""Choose tokens so that only programs come out: see `karma.infer.automaton`.

Tokens are chosen by sample-then-check: the best token first, and only if it is refused the next
best, in exact order. The result equals masking the whole vocabulary, at the price of one check.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.errors import ModelError
from karma.infer.automaton import ProgramAutomaton, State

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
