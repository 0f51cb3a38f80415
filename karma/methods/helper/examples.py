"""What HELPER's example memory begins with: instructions with programs, and errors with theirs."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from karma.agent.program import parse_program
from karma.contracts import WorkedExample
from karma.errors import FileError, ProgramError
from karma.files import read_toml

TABLE = Path(__file__).parent / "examples.toml"


class _ExampleRow(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    instruction: str
    program: str


class _ExampleTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    examples: tuple[_ExampleRow, ...]
    errors: tuple[_ExampleRow, ...]


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
