"""What all runs' folders share: one run at a time, lines that outlive a kill, named differences."""

import fcntl
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from karma.errors import FileError, KarmaError
from karma.files import LARGEST_LOG, decode_json, read_bytes, write_atomic

T = TypeVar("T")


@contextmanager
def locked(path: Path, fix: str = "wait for it, or --out another folder") -> Iterator[None]:
    """Keep every other run out of a folder, which is made; a run that dies gives it free.

    FileError where it cannot be a folder, KarmaError where another run is at work in it.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDONLY)
    except OSError as error:
        raise FileError(path, f"cannot be used as a folder: {error.strerror}", fix=fix) from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not path.exists() or not os.path.samestat(os.fstat(handle), path.stat()):
            raise BlockingIOError  # it went while this waited
    except BlockingIOError as error:
        os.close(handle)
        raise KarmaError(
            f"{path}: another run is at work in this folder\n  To fix: {fix}"
        ) from error
    try:
        yield
    finally:
        os.close(handle)


def read_lines(path: Path, kind: type[T]) -> list[T]:
    """Read JSON lines; a torn last one, of a killed run, is none; one damaged before is named."""
    if not path.exists():
        return []
    found = []
    for number, line in enumerate(read_bytes(path, most=LARGEST_LOG).split(b"\n")[:-1], start=1):
        try:
            found.append(decode_json(line, kind, path=path))
        except FileError as error:
            fix = (
                f"take line {number} out; the same karma eval then does that episode again "
                "(--fresh does all of them)"
            )
            raise FileError(path, f"line {number}: {error.reason}", fix=fix) from error
    return found


def replace_file(path: Path, data: bytes) -> None:
    """Write a file unless that is what it holds."""
    if not path.exists() or read_bytes(path, most=LARGEST_LOG) != data:
        write_atomic(path, data)


def changed(what: str, before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return what tells two sets of named texts, such as hashes, apart, in words.

    >>> changed("models", {"planner": "a"}, {"planner": "b", "vision": "c"})
    ['models: planner: a became b', 'models: vision: none became c']
    """
    return [
        f"{what}: {name}: {brief(before.get(name))} became {brief(after.get(name))}"
        for name in sorted({*before, *after})
        if before.get(name) != after.get(name)
    ]


def brief(text: str | None) -> str:
    """Return a name with a hash short enough to be read."""
    return "none" if text is None else re.sub(r"\b([0-9a-f]{12})[0-9a-f]{52}\b", r"\1", text)


def refuse_other(path: Path, differences: list[str], *, fix: str) -> None:
    """Raise FileError where a folder's header, at `path`, is not this run's."""
    if differences:
        reason = "this folder holds a run of something else:\n  " + "\n  ".join(differences)
        raise FileError(path, reason, fix=fix)
