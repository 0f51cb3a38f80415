"""Verify a bundle byte by byte, without unpacking any of it.

That finds damage. Against a bundle that somebody has forged only the SHA-256 helps that `karma
bundle build` prints, brought by another way. Standard library only, as it travels in the bundle.
"""

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO

from karma.bundle.contents import (
    CHUNK,
    END,
    BundleError,
    Contents,
    Member,
    header,
    open_bundle,
    padding,
    places,
    read_contents,
    unsafe,
)

LARGEST_RATIO = 200  # unpacked to packed bytes of a wheel; real ones stay below 20
_KINDS = {
    b"1": "a hard link",
    b"2": "a symbolic link",
    b"3": "a device",
    b"4": "a device",
    b"5": "a folder",
    b"6": "a named pipe",
    b"S": "a sparse file",
    b"L": "a long name",
    b"K": "a long link",
    b"x": "an extended header",
    b"g": "an extended header",
}

Say = Callable[[str], None]


def verify(bundle: Path, *, sha256: str = "", say: Say = lambda _: None) -> Contents:
    """Check every byte of a bundle without unpacking any.

    Args:
        bundle: the file.
        sha256: of the whole file, known from elsewhere; "" = not asked for.
        say: is told how far it is.

    Raises:
        BundleError: something is not as it must be; names the first wrong member.
    """
    try:
        with open_bundle(bundle) as file:
            if sha256:
                _check_whole(file, sha256)
            contents = read_contents(file)
            _check_length(os.fstat(file.fileno()).st_size, contents)
            for done, (member, offset) in enumerate(places(contents), start=1):
                _check_member(file, member, offset)
                if member.bytes > 64 * CHUNK or done % 200 == 0:
                    say(f"{done} of {len(contents.members)} members are right: {member.path}")
            if file.read(len(END) + 1) != END:
                raise BundleError("the bundle's end is damaged")
            return contents
    except OSError as error:
        raise BundleError(f"{bundle}: {error.strerror or error}") from error
    except BundleError as error:
        raise BundleError(f"{bundle}: {error}") from error


def _check_whole(file: BufferedReader, sha256: str) -> None:
    found = hashlib.file_digest(file, "sha256").hexdigest()
    if found != sha256.lower():
        raise BundleError(f"its SHA-256 is {found} and not {sha256.lower()}")
    file.seek(0)


def _check_length(found: int, contents: Contents) -> None:
    end = contents.start
    for member, offset in places(contents):
        end = offset + member.bytes + padding(member.bytes)
        if end > found:
            raise BundleError(f"{member.path}: the bundle is truncated, it breaks off here")
    wanted = end + len(END)
    if found != wanted:
        raise BundleError(f"its end: the bundle has {found} bytes instead of {wanted}")


def _check_member(file: BinaryIO, member: Member, offset: int) -> None:
    wanted = header(member.path, member.bytes, executable=member.executable)
    file.seek(offset - len(wanted))
    found = file.read(len(wanted))
    if found != wanted:
        raise BundleError(f"{member.path}: refused, {_difference(found, wanted, member)}")
    digest = hashlib.sha256()
    for part in parts(file, member.bytes):
        digest.update(part)
    if digest.hexdigest() != member.sha256:
        raise BundleError(
            f"{member.path}: its SHA-256 is {digest.hexdigest()} and not {member.sha256}"
        )
    if file.read(padding(member.bytes)).strip(b"\0"):
        raise BundleError(f"{member.path}: something follows it that is not padding")
    if member.path.endswith(".whl"):
        _check_wheel(file, member, offset)
        file.seek(offset + member.bytes + padding(member.bytes))


def _difference(found: bytes, wanted: bytes, member: Member) -> str:
    """Return what is wrong with a header, as exactly as can be said."""
    kind, name = found[156:157], found[:100].rstrip(b"\0").decode(errors="replace")
    if kind != wanted[156:157] and kind in _KINDS:
        return f"it is {_KINDS[kind]} and not a file"
    if found[:100] != wanted[:100]:
        return f"{name!r} stands in its place"
    if found[124:136] != wanted[124:136]:
        return f"its header gives another size than the manifest's {member.bytes} bytes"
    return "its header is damaged"


def parts(file: BinaryIO, size: int) -> Iterator[bytes]:
    """Yield the next `size` bytes of a file, some at a time.

    Raises:
        BundleError: there are fewer.
    """
    while size > 0:
        part = file.read(min(CHUNK, size))
        if not part:
            raise BundleError("the bundle breaks off")
        size -= len(part)
        yield part


def _check_wheel(file: BinaryIO, member: Member, offset: int) -> None:
    """Refuse a wheel that unpacks to more than it should, or to elsewhere."""
    with tempfile.TemporaryFile() as copy:  # zipfile wants a file that ends where the wheel ends
        file.seek(offset)
        for part in parts(file, member.bytes):
            copy.write(part)
        try:
            with zipfile.ZipFile(copy) as wheel:
                entries = wheel.infolist()
        except (zipfile.BadZipFile, ValueError, NotImplementedError, OverflowError) as error:
            raise BundleError(f"{member.path}: not a wheel: {error}") from error
    total = sum(entry.file_size for entry in entries)
    if total != member.unpacked:
        raise BundleError(
            f"{member.path}: refused, it unpacks to {total} bytes and the manifest says "
            f"{member.unpacked}"
        )
    if total > LARGEST_RATIO * member.bytes + CHUNK:
        raise BundleError(f"{member.path}: refused, it unpacks to {total // member.bytes} times")
    for entry in entries:
        if unsafe(entry.filename.rstrip("/")):
            raise BundleError(f"{member.path}: refused, it holds {entry.filename!r}")
