"""A run's folder: the names of its files, its lock, its mark.

The mark, `.karma-run`, says that a run made the folder. It holds the SHA-256 of the header and,
once the run is finished, of what it wrote. A folder without a mark is taken only if it is empty.
Nothing of an earlier run is removed: its folder is set aside under another name. A page or table
is written over another only if that has the line that says that karma made it.
"""

import fcntl
import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TypeVar

import msgspec

from karma.errors import FileError, KarmaError
from karma.files import (
    LARGEST_LOG,
    TEMPORARY,
    check_sealed_file,
    decode_json,
    inside,
    read_bytes,
    sha256_of,
    to_json,
    write_atomic,
)

T = TypeVar("T")
MARK, HEADER = ".karma-run", "header.json"
EPISODES, TIMINGS, NOT_RUN = "episodes.jsonl", "timings.jsonl", "not_run.jsonl"
RESULTS, TABLE, TURNS, CLAIMS = "results.json", "table.md", "turns.json", "claims.md"
STEPS = "steps"  # folder of step logs
SIGN = b"<!-- made by karma -->"  # line of Markdown that a command made
_BESIDE = frozenset({"exchanges.jsonl", "recording.lock"})  # a cassette may lie in the folder
_FIX = "--out another folder"


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


def write_made(path: Path, data: bytes, sign: bytes = SIGN) -> None:
    """Write a page or table, over nothing but an earlier one; `sign` is what all of them hold.

    FileError for a file without it, unless that is equal.
    """
    if path.exists():
        there = read_bytes(path, most=LARGEST_LOG)
        if there != data and sign not in there:
            reason = "there already, and not made by this command"
            raise FileError(path, reason, fix="move it away, or --out another place")
    write_atomic(path, data)


# ----------------------------------------------------------------- the mark


class _Mark(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    header: str = ""  # SHA-256 of the header; "" where it grows with the run
    kind: str = ""  # in marks of earlier versions, as the next
    by: str = ""
    sealed: dict[str, str] = {}  # files that stay as they are once the results are there


def begin(folder: Path, header: bytes = b"") -> None:
    """Mark a folder as a run's, with the header that it keeps to its end."""
    replace_file(folder / MARK, to_json(_Mark(header=_hash(header) if header else "")))


def is_begun(folder: Path) -> bool:
    """Return whether a run has begun in a folder.

    Raises:
        FileError: the folder has no mark and holds files, or its header is not the run's.
    """
    mark = _read_mark(folder)
    if mark is None:
        if stranger := next(_strangers(folder), ""):
            reason = f"holds no run, but {ascii(stranger)[:80]}: no run left its mark ({MARK})"
            raise FileError(folder, reason, fix=f"{_FIX}, or move away what is in this one")
        return False
    header = folder / HEADER
    if mark.header and header.exists() and _hash(read_bytes(header)) != mark.header:
        raise FileError(header, "is not the header that this folder's run wrote", fix=_FIX)
    return True


def seal(folder: Path, names: Iterable[str], results: bytes) -> None:
    """Write the results, the last file; their presence says that what is sealed has to stay."""
    hashes = {name: sha256_of(folder / name) for name in names} | {RESULTS: _hash(results)}
    mark = msgspec.structs.replace(_read_mark(folder) or _Mark(), sealed=hashes)
    replace_file(folder / MARK, to_json(mark))
    replace_file(inside(folder, RESULTS), results)


def check_sealed(folder: Path) -> None:
    """Check that what a finished run has sealed is as it was then; FileError where it is not.

    A step log that is gone is none: that episode is done again.
    """
    mark = _read_mark(folder)
    if mark is None or not (folder / RESULTS).exists():
        return
    check_results(folder)
    fix = "bring it back, or run it again: karma eval FILE --fresh"
    for name, sha256 in mark.sealed.items():
        if not name.startswith(f"{STEPS}/") or (folder / name).exists():
            check_sealed_file(folder / name, sha256, fix=fix)


def check_results(folder: Path) -> None:
    """Check that the results, if there are any, are those that the run sealed; else FileError."""
    mark, path = _read_mark(folder), folder / RESULTS
    if path.exists() and (mark is None or RESULTS not in mark.sealed):
        raise FileError(path, "not written by this folder's run", fix=f"move it away, or {_FIX}")


def sweep(folder: Path) -> None:
    """Remove what a killed run left half written."""
    for left in folder.rglob(f".*{TEMPORARY}"):
        left.unlink(missing_ok=True)


def set_aside(folder: Path) -> Path:
    """Rename a folder to the first of NAME.1, NAME.2, ... that is free; return its new path.

    An empty folder takes its place, to which a link still leads. FileError where that cannot be.
    """
    real = Path(os.path.realpath(folder))
    places = (real.with_name(f"{real.name}.{number}") for number in count(1))
    place = next(one for one in places if not os.path.lexists(one))
    try:
        real.rename(place)
        real.mkdir()
    except OSError as error:
        reason = f"cannot be renamed to {place}: {error.strerror}"
        raise FileError(folder, reason, fix=_FIX) from error
    return place


def _read_mark(folder: Path) -> _Mark | None:
    path = folder / MARK
    if not path.exists():
        return None
    first = read_bytes(path, most=LARGEST_LOG).partition(b"\n")[0]  # once it had more
    return decode_json(first, _Mark, path=path, fix=_FIX)


def _strangers(folder: Path) -> Iterator[str]:
    """Yield what lies in a folder without a mark, but for a cassette and halves of a mark."""
    for entry in sorted(folder.iterdir() if folder.is_dir() else ()):
        ours = entry.name in _BESIDE or entry.name.endswith(TEMPORARY)
        if not ours and not any((entry / one).exists() for one in _BESIDE):
            yield entry.name


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
