"""Worked examples, found by their instruction's vector: HELPER's memory, any planner's bank."""

from collections.abc import Sequence
from copy import copy

import numpy as np

from karma.contracts import Embedder, Vectors, WorkedExample


class ExampleMemory:
    """Finds worked examples by their instructions; examples are added, never removed.

    `vectors` of the seeds' instructions, shape (n, dimension), where they are known.
    """

    def __init__(
        self, embedder: Embedder, seeds: Sequence[WorkedExample], vectors: Vectors | None = None
    ) -> None:
        self._embedder, self._examples = embedder, list(seeds)
        if vectors is None:
            vectors = embedder.embed([example.instruction for example in seeds])
        self._vectors = vectors

    def __len__(self) -> int:
        return len(self._examples)

    def copy(self) -> "ExampleMemory":
        """Return an independent memory with the same examples."""
        twin = copy(self)
        twin._examples = list(self._examples)
        return twin

    def add(self, example: WorkedExample) -> None:
        """Remember one more example."""
        vector = self._embedder.embed([example.instruction])
        self._examples.append(example)
        self._vectors = np.concatenate([self._vectors, vector])

    def nearest(self, text: str, k: int) -> tuple[WorkedExample, ...]:
        """Return the k examples whose instructions are nearest to a text, the nearest first.

        By L2 distance, which orders vectors of length 1 as the cosine does; equals by age.
        """
        query = self._embedder.embed([text])[0]
        gaps = np.round(((self._vectors - query) ** 2).sum(axis=1), 6)
        order = sorted(range(len(self)), key=lambda row: (gaps[row], row))
        return tuple(self._examples[row] for row in order[:k])
