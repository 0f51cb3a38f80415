"""Read and write AI2-THOR's pipe format: fields of type, length and body, then an end mark.

A field is one byte of type, four bytes of length (big endian) and the body; the end mark is a field
of type 255 and length 0. Covered: writing and strict reading of messages, over pipes that give a
message in pieces. Not covered: what the bodies mean.
"""

import struct
from collections.abc import Iterable
from enum import IntEnum
from typing import BinaryIO, NamedTuple

import msgspec

from karma.errors import KarmaError

_HEADER = struct.Struct("!BI")
LONGEST_BODY = 1 << 28  # bytes; more is taken for damage


class FieldType(IntEnum):
    """The field types of AI2-THOR 5.0.0."""

    METADATA = 1
    ACTION = 2
    ACTION_RESULT = 3
    RGB = 4
    DEPTH = 5
    NORMALS = 6
    FLOWS = 7
    CLASSES = 8
    IDS = 9
    THIRD_PARTY_RGB = 10
    METADATA_PATCH = 11
    THIRD_PARTY_DEPTH = 12
    THIRD_PARTY_NORMALS = 13
    THIRD_PARTY_IDS = 14
    THIRD_PARTY_CLASSES = 15
    THIRD_PARTY_FLOWS = 16
    END = 255


class Field(NamedTuple):
    """One part of a message."""

    kind: FieldType
    body: bytes


class WireError(KarmaError):
    """What came through the pipe is not a message; nothing after it can be trusted."""


END_MARK = _HEADER.pack(FieldType.END, 0)


def encode(fields: Iterable[Field]) -> bytes:
    """Return one message.

    >>> encode([Field(FieldType.ACTION, b"{}")]).hex(" ")
    '02 00 00 00 02 7b 7d ff 00 00 00 00'
    """
    parts: list[bytes] = []
    for kind, body in fields:
        parts += (_HEADER.pack(kind, len(body)), body)
    parts.append(END_MARK)
    return b"".join(parts)


def farewell(reason: str) -> bytes:
    """Return the message that makes the client raise an error which quotes the reason.

    The client compares the sequence id with its own before anything else, and says both.
    """
    body = msgspec.msgpack.encode({"agents": [], "sequenceId": reason})
    return encode([Field(FieldType.METADATA, body)])


def read_message(source: BinaryIO) -> list[Field] | None:
    """Read one message; None when the source ended before it began.

    Raises:
        WireError: the source ended within the message, or the bytes are not one; says which field.
    """
    fields: list[Field] = []
    while True:
        place = f"field {len(fields) + 1}"
        header = _exactly(source, _HEADER.size, f"{place}, header")
        if not header and not fields:
            return None
        if len(header) < _HEADER.size:
            raise WireError(f"{place}, header: the pipe ended before it")
        number, length = _HEADER.unpack(header)
        kind = _kind(number, length, place)
        if kind is FieldType.END:
            return fields
        body = _exactly(source, length, f"{place} ({kind.name})")
        if len(body) < length:
            raise WireError(f"{place} ({kind.name}): the pipe ended before its {length} bytes")
        fields.append(Field(kind, body))


def _kind(number: int, length: int, place: str) -> FieldType:
    try:
        kind = FieldType(number)
    except ValueError:
        raise WireError(f"{place}: no field type has the number {number}") from None
    if kind is FieldType.END and length:
        raise WireError(f"{place}: an end mark has no body, this one has {length} bytes")
    if length > LONGEST_BODY:
        raise WireError(f"{place} ({kind.name}): {length} bytes are more than {LONGEST_BODY}")
    return kind


def _exactly(source: BinaryIO, size: int, place: str) -> bytes:
    """Return `size` bytes, or none at all when the source is at its end.

    Raises:
        WireError: the source ended in between.
    """
    parts, got = list[bytes](), 0
    while got < size and (data := source.read(size - got)):
        parts.append(data)
        got += len(data)
    if 0 < got < size:
        raise WireError(f"{place}: the pipe ended after {got} of {size} bytes")
    return b"".join(parts)
