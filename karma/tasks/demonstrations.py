"""ALFRED's demonstrations: one JSON record a line, gzipped."""

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

import msgspec

from karma.errors import FileError

T = TypeVar("T")


def read_demonstrations(path: Path, kind: type[T]) -> Iterator[T]:
    """Yield the records of a file, in order, as a type that has the fields that are wanted.

    Raises:
        FileError: the file is missing or torn, or a record lacks a field.
    """
    decoder, number = msgspec.json.Decoder(kind), 0
    try:
        with gzip.open(path, "rb") as lines:
            for line in lines:
                number += 1
                yield decoder.decode(line)
    except FileNotFoundError as error:
        raise FileError(path, "no such file", fix="give ALFRED's *.jsonl.gz") from error
    except (OSError, EOFError, zlib.error, msgspec.DecodeError) as error:
        text = f"not ALFRED demonstrations, near line {number}: {error}"
        raise FileError(path, text, fix="give ALFRED's records as *.jsonl.gz") from error
