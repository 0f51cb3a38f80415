"""Distinct texts with their vectors, and what a question is looked up by."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.contracts import Embedder, HomeQuestion, Vectors
from karma.household.types import in_words

_FIRST = 256  # rows to begin with


class TextVectors:
    """Texts numbered as they come, each embedded once; exact search over all of them."""

    def __init__(self, embedder: Embedder) -> None:
        self._embedder = embedder
        self._numbers: dict[str, int] = {}
        self._vectors = np.zeros((_FIRST, embedder.dimension), dtype=np.float32)

    def __len__(self) -> int:
        return len(self._numbers)

    def number(self, text: str) -> int:
        """Return the number of a text; a new one gets the next."""
        found = self._numbers.get(text)
        if found is None:
            found = self._numbers[text] = len(self._numbers)
            if found == len(self._vectors):
                self._vectors = np.concatenate([self._vectors, np.zeros_like(self._vectors)])
            self._vectors[found] = self._embedder.embed([text])[0]
        return found

    def similarities(self, question: HomeQuestion) -> NDArray[np.float32]:
        """Return each text's cosine with the question, shape (texts,)."""
        asked: Vectors = self._embedder.embed([query_text(question)])
        found: NDArray[np.float32] = self._vectors[: len(self)] @ asked[0]
        return found


def query_text(question: HomeQuestion) -> str:
    """Return what a design looks up: the noun phrase, and the names of the nearest types.

    All designs get the same, so that none loses for not knowing a word.
    """
    said = question.thing
    names = [in_words(meaning.name) for meaning in said.types[:2]]
    return ", ".join(dict.fromkeys([said.phrase or question.text, *names]))


def best_first(scores: Sequence[float] | NDArray[np.floating[Any]], k: int) -> NDArray[np.intp]:
    """Return the numbers of the k best scores, the earlier of equals first."""
    values = np.asarray(scores)
    order: NDArray[np.intp] = np.argsort(-values, kind="stable")[:k]
    return order
