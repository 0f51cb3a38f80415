"""Read ALFRED's demonstrations, and what people said of them."""

import gzip
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

import msgspec

from karma.errors import FileError
from karma.files import open_regular
from karma.plugins.alfred.replay.trial import Annotation

T = TypeVar("T")
_LONGEST_LINE = 1 << 24  # bytes of a record


class _Described(msgspec.Struct, frozen=True, kw_only=True):
    turk_annotations: tuple[Annotation, ...]


def plain(sentence: str) -> str:
    """Return a sentence as it is compared with others: lower case, letters and digits only.

    >>> plain("Please, wash an apple.")
    'please wash an apple'
    """
    return " ".join(re.findall(r"[a-z0-9]+", sentence.lower()))


def sentences_in(path: Path) -> frozenset[str]:
    """Return all that people said in a file, of goals and of single steps, as `plain` has it."""
    return frozenset(
        plain(text)
        for record in read_demonstrations(path, _Described)
        for said in record.turk_annotations
        for text in (said.task_desc, *said.high_descs)
    )


def read_demonstrations(path: Path, kind: type[T]) -> Iterator[T]:
    """Yield the records of a file, in order, as a type that has the fields that are wanted.

    Raises:
        FileError: the file is missing or torn, or a record lacks a field.
    """
    decoder, number = msgspec.json.Decoder(kind), 0
    try:
        with (
            open_regular(path, fix="give ALFRED's *.jsonl.gz") as packed,
            gzip.GzipFile(fileobj=packed) as lines,
        ):
            while line := lines.readline(_LONGEST_LINE):
                number += 1
                yield decoder.decode(line)
    except (OSError, EOFError, zlib.error, msgspec.DecodeError, RecursionError) as error:
        text = f"not ALFRED demonstrations, near line {number}: {error}"
        raise FileError(path, text, fix="give ALFRED's records as *.jsonl.gz") from error
