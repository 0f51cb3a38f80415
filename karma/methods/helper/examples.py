"""HELPER's example memory: instructions with programs, found again by the instruction's vector."""

from collections.abc import Sequence
from copy import copy
from pathlib import Path

import msgspec
import numpy as np

from karma.agent.program import parse_program
from karma.contracts import Embedder, WorkedExample
from karma.errors import FileError, ProgramError
from karma.files import read_toml

TABLE = Path(__file__).parent / "examples.toml"


class _ExampleRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    instruction: str
    program: str


class _ExampleTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    examples: tuple[_ExampleRow, ...]
    errors: tuple[_ExampleRow, ...]


class ExampleMemory:
    """Finds worked examples by their instructions; examples are added, never removed.

    Args:
        embedder: of instructions.
        seeds: what it begins with.
    """

    def __init__(self, embedder: Embedder, seeds: Sequence[WorkedExample]) -> None:
        self._embedder, self._examples = embedder, list(seeds)
        self._vectors = embedder.embed([example.instruction for example in seeds])

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


def seed_examples() -> tuple[tuple[WorkedExample, ...], tuple[WorkedExample, ...]]:
    """Return the examples to begin with, and the error examples.

    Raises:
        FileError: the table is damaged, or a program in it does not parse.
    """
    table = read_toml(TABLE, _ExampleTable)
    return _examples(table.examples), _examples(table.errors)


def _examples(rows: Sequence[_ExampleRow]) -> tuple[WorkedExample, ...]:
    for row in rows:
        try:
            parse_program(row.program)
        except ProgramError as error:
            raise FileError(TABLE, f"example {row.instruction!r}: {error}") from error
    return tuple(
        WorkedExample(instruction=row.instruction, program=row.program.strip()) for row in rows
    )
