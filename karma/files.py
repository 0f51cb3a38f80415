"""Reading strictly and writing atomically: a bad file is named, a written one is never lost."""

import os
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from karma.errors import FileError, UnwritableError

T = TypeVar("T")


def read_json(path: str | Path, kind: type[T], *, fix: str | None = None) -> T:
    """Read one JSON file into `kind` (a msgspec Struct or dataclass), refusing what does not fit.

    Raises:
        FileError: missing, torn, or of the wrong form; names the place inside the file.
    """
    return decode_json(read_bytes(path, fix=fix), kind, path=path, fix=fix)


def decode_json(data: bytes | str, kind: type[T], *, path: str | Path, fix: str | None = None) -> T:
    """Decode JSON text that came from `path`; errors as in `read_json`."""
    try:
        return msgspec.json.decode(data, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise FileError(path, str(error), fix=fix) from error


def read_toml(path: str | Path, kind: type[T], *, fix: str | None = None) -> T:
    """Read one TOML file into `kind`; errors as in `read_json`."""
    try:
        return msgspec.toml.decode(read_bytes(path, fix=fix), type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, ValueError) as error:
        raise FileError(path, str(error), fix=fix) from error


def read_bytes(path: str | Path, *, fix: str | None = None) -> bytes:
    """Return a file's bytes.

    Raises:
        FileError: it cannot be read.
    """
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise FileError(path, error.strerror or str(error), fix=fix) from error


def to_json(value: Any, *, indent: int = 0) -> bytes:
    """Encode with sorted keys, so that equal values give equal bytes; ends in a newline."""
    data = msgspec.json.encode(value, order="sorted")
    return (msgspec.json.format(data, indent=indent) if indent else data) + b"\n"


def append_line(path: str | Path, data: bytes, *, sync: bool = True) -> None:
    """Add one line to a file and, unless told otherwise, see it to the disk before returning.

    Raises:
        UnwritableError: it cannot be written; a torn last line is for the reader to drop.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab") as file:
            file.write(data)
            file.flush()
            if sync:
                os.fsync(file.fileno())
    except OSError as error:
        fix = "free some space there, or choose another folder"
        raise UnwritableError(path, f"cannot write: {error.strerror or error}", fix=fix) from error


@cache
def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_atomic(path: str | Path, data: bytes | memoryview) -> None:
    """Replace `path` by `data`, or leave it as it was.

    Raises:
        UnwritableError: the disk is full, or the folder read-only; nothing half-written stays.
    """
    path = Path(path)
    temporary: str | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o666 & ~_umask())
        Path(temporary).replace(path)
        temporary = None
    except OSError as error:
        fix = "free some space there, or choose another folder"
        raise UnwritableError(path, f"cannot write: {error.strerror or error}", fix=fix) from error
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
