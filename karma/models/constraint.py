"""Hold answers to a grammar by llguidance, and check whole texts against it.

Tokens are chosen by sample-then-check: the best token first, and the whole vocabulary is masked
only if the grammar refuses that. The result equals masking always. Nothing is ever taken back, and
models whose state cannot be rewound can be held to a grammar, too.
"""

import ctypes
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.errors import ModelError

Logits = NDArray[np.float32]


class Constraint:
    """The state of an answer under a grammar; `tokenizer` is an `LLTokenizer` of the model's.

    ModelError if llguidance cannot read the grammar.
    """

    def __init__(self, tokenizer: Any, grammar: str) -> None:
        from llguidance import LLMatcher

        self._matcher = LLMatcher(tokenizer, grammar, log_level=0)
        if self._matcher.is_error():
            raise ModelError(f"the grammar cannot be used: {self._matcher.get_error()}")

    def choose(self, scores: Logits) -> int:
        """Return the best token that the grammar admits, the lowest id of equals.

        ModelError if no token can continue, or no score is a finite number.
        """
        best = best_token(scores)
        if self._matcher.validate_tokens([best]) == 1:
            return best
        bits = np.frombuffer(self._matcher.compute_bitmask(), np.uint8)
        admitted = np.unpackbits(bits, bitorder="little")[: len(scores)].astype(bool)
        best = int(np.argmax(np.where(admitted, scores, -np.inf)))
        if not admitted[best] or not np.isfinite(scores[best]):
            raise ModelError(
                "no token of this model continues the answer (damaged weights or vocabulary)"
            )
        return best

    def take(self, token: int) -> None:
        """Continue by a token that `choose` returned."""
        if not self._matcher.consume_token(token):
            raise ModelError(f"llguidance: {self._matcher.get_error()}")

    @property
    def has_ended(self) -> bool:
        """Whether the answer is whole and nothing may follow."""
        return bool(self._matcher.is_stopped())

    def expected(self) -> list[int]:
        """Return the tokens that have to follow, up to a choice."""
        tokens: list[int] = self._matcher.compute_ff_tokens()
        return tokens


def best_token(scores: Logits) -> int:
    """Return the token of the highest score, the lowest id of equals.

    ModelError where that score is not a finite number.
    """
    top = int(np.argmax(scores))
    if not np.isfinite(scores[top]):
        raise ModelError(f"the best score of a token is {scores[top]}: damaged weights")
    return top


def llama_tokenizer(llama: Any, pieces: Sequence[bytes], end_tokens: Sequence[int]) -> Any:
    """Return a loaded `Llama`'s tokens; those of the piece b"" are never admitted."""
    from llama_cpp.llama_cpp import _lib
    from llguidance import LLTokenizer

    return LLTokenizer.from_llamacpp(  # type: ignore[attr-defined]
        tokens=list(pieces),
        vocab_ptr=llama._model.vocab,
        tokenize_fptr=ctypes.cast(_lib.llama_tokenize, ctypes.c_void_p).value,
        eos_token=list(end_tokens),
    )


# ----------------------------------------------------------------- whole texts


def admits(grammar: str, text: str) -> bool:
    """Return whether a text is an answer of the grammar.

    >>> grammar = 'start: "go(" ("Mug" | "Sink") ")"'
    >>> admits(grammar, "go(Mug)"), admits(grammar, "go(Mu"), admits(grammar, "go(Pan)")
    (True, False, False)
    """
    matcher = _after(grammar, text)
    return matcher is not None and bool(matcher.is_accepting())


def begins(grammar: str, text: str | bytes) -> bool:
    """Return whether an answer of the grammar begins with a text."""
    return _after(grammar, text) is not None


def _after(grammar: str, text: str | bytes) -> Any:
    """Return the matcher behind a text; None if no answer begins with it."""
    from llguidance import LLMatcher

    matcher = LLMatcher(_letters(), grammar, log_level=0)
    if matcher.is_error():
        raise ModelError(f"the grammar cannot be used: {matcher.get_error()}")
    tokens = list(text if isinstance(text, bytes) else text.encode("utf-8", "replace"))
    return matcher if matcher.try_consume_tokens(tokens) == len(tokens) else None


@cache
def _letters() -> Any:
    """Return a tokenizer whose tokens are bytes."""
    from llguidance import LLTokenizer

    return LLTokenizer("byte")
