"""Define the bundle: a plain tar whose first member, MANIFEST, lists all others.

Every byte of the tar follows from the manifest and the members' contents, so whatever else is in it
can be refused by name. Travels in the bundle (karma/bundle/install.py), so: standard library only.
"""

import hashlib
import json
import os
import stat
import tarfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO

from karma.errors import KarmaError

FORMAT = 1
MANIFEST = "MANIFEST"
BLOCK = 512
CHUNK = 1 << 20
END = bytes(2 * BLOCK)
LARGEST_MANIFEST = 64 << 20
LONGEST_PATH = 1000
LONGEST_NAME = 200  # of one file or folder
LARGEST_MEMBER = 1 << 45


class BundleError(KarmaError):
    """A bundle that is refused, or an installation that failed; names the member or the step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """One file of a bundle."""

    path: str
    bytes: int
    sha256: str
    executable: bool = False
    unpacked: int | None = None  # bytes of what is in it; wheels only


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """What a bundle's manifest says, and its own digest, which is the bundle's identity."""

    karma: str
    python: str  # "3.11"
    platform: str  # "linux-x86_64"
    models: tuple[str, ...]
    members: tuple[Member, ...]
    digest: str
    start: int  # offset of the first member after the manifest


def open_bundle(path: Path) -> BufferedReader:
    """Open a regular file; whatever else stands there is not waited for.

    Raises:
        OSError: it cannot be opened.
        BundleError: it is a pipe, a device or a folder.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise BundleError("no file, but a pipe, a device or a folder")
    return os.fdopen(handle, "rb")


def header(path: str, size: int, *, executable: bool = False) -> bytes:
    """Return the one tar header that a member of this path and size may have; GNU's for long paths.

    Raises:
        BundleError: the path is too long for any disk.
    """
    name = path.encode()
    if len(name) > LONGEST_PATH:
        raise BundleError(f"{path}: the path is too long")
    if len(name) <= tarfile.LENGTH_NAME:
        return _block(name, size, executable=executable)
    long = name + b"\0"
    before = _block(b"././@LongLink", len(long), kind=tarfile.GNUTYPE_LONGNAME)
    long = long.ljust(len(long) + padding(len(long)), b"\0")
    return before + long + _block(name, size, executable=executable)


def _block(
    name: bytes, size: int, *, executable: bool = False, kind: bytes = tarfile.REGTYPE
) -> bytes:
    """Return one block of a header, without owner and time; sizes beyond 8 GiB as GNU has them."""
    info = tarfile.TarInfo(name[: tarfile.LENGTH_NAME].decode("utf-8", "surrogateescape"))
    info.size, info.type, info.mode = size, kind, 0o755 if executable else 0o644
    if size < 8**11:
        return info.tobuf(tarfile.USTAR_FORMAT, "utf-8")
    return info.tobuf(tarfile.GNU_FORMAT, "utf-8")


def padding(size: int) -> int:
    """Return how many zero bytes follow a member of this size."""
    return -size % BLOCK


def manifest_bytes(about: dict[str, object], members: Sequence[Member]) -> bytes:
    """Return the text of a manifest; its first line carries the hash of the rest."""
    rows = [
        {
            "path": one.path,
            "bytes": one.bytes,
            "sha256": one.sha256,
            **({"executable": True} if one.executable else {}),
            **({} if one.unpacked is None else {"unpacked": one.unpacked}),
        }
        for one in members
    ]
    body = json.dumps({**about, "members": rows}, indent=1, sort_keys=True).encode() + b"\n"
    return b"karma-bundle %d %s\n" % (FORMAT, hashlib.sha256(body).hexdigest().encode()) + body


def read_contents(file: BinaryIO) -> Contents:
    """Read and check the manifest of an open bundle.

    Raises:
        BundleError: not a bundle, of another version, or damaged.
    """
    block = file.read(BLOCK)
    if block[:9] != MANIFEST.encode() + b"\0":
        raise BundleError("not a bundle: a tar whose first member is MANIFEST is wanted")
    try:
        size = int(block[124:135], 8)
    except ValueError:
        size = -1
    if not 0 <= size <= LARGEST_MANIFEST or block != header(MANIFEST, size):
        raise BundleError(f"{MANIFEST}: its header is damaged")
    data = file.read(size)
    rest = file.read(padding(size))
    if len(data) < size or len(rest) < padding(size):
        raise BundleError(f"{MANIFEST}: the bundle breaks off in it")
    if rest.strip(b"\0"):
        raise BundleError(f"{MANIFEST}: something follows it that is not padding")
    return _contents(data, file.tell())


def _contents(data: bytes, start: int) -> Contents:
    first, _, body = data.partition(b"\n")
    words = first.decode(errors="replace").split(" ")
    if len(words) != 3 or words[0] != "karma-bundle" or not words[1].isdecimal():
        raise BundleError(f"{MANIFEST}: its first line is damaged")
    if words[1] != str(FORMAT):
        raise BundleError(
            f"{MANIFEST}: the bundle has version {words[1][:9]}, and this program reads {FORMAT}\n"
            "  To fix: use the install.pyz that lies in the bundle, or build it again"
        )
    if hashlib.sha256(body).hexdigest() != words[2]:
        raise BundleError(f"{MANIFEST}: its SHA-256 is not the one in its first line")
    try:
        said = json.loads(body)
        members = tuple(_member(row) for row in said["members"])
        found = Contents(
            karma=_plain(said["karma"]),
            python=_plain(said["python"]),
            platform=_plain(said["platform"]),
            models=tuple(_plain(name) for name in said["models"]),
            members=members,
            digest=words[2],
            start=start,
        )
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise BundleError(f"{MANIFEST}: not of the right form: {str(error)[:200]!a}") from error
    _check_paths([member.path for member in members])
    return found


def _plain(word: object) -> str:
    """Return a word of the manifest that a terminal can have."""
    if not isinstance(word, str) or not word.isprintable() or len(word) > LONGEST_PATH:
        raise ValueError("a name is no plain text")
    return word


def _member(row: dict[str, object]) -> Member:
    """Return one row of the manifest, strictly."""
    unknown = set(row) - {"path", "bytes", "sha256", "executable", "unpacked"}
    if unknown:
        raise ValueError(f"unknown key {sorted(unknown)[0]!r}")
    path, digest, unpacked = row["path"], row["sha256"], row.get("unpacked")
    if not isinstance(path, str) or not isinstance(digest, str) or len(digest) != 64:
        raise ValueError(f"member {path!r}")
    return Member(
        path=path,
        bytes=_size(row["bytes"]),
        sha256=digest,
        executable=row.get("executable") is True,
        unpacked=None if unpacked is None else _size(unpacked),
    )


def _size(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= LARGEST_MEMBER:
        raise ValueError("a size of a member is none")
    return value


def _check_paths(paths: Sequence[str]) -> None:
    """Refuse paths that lead elsewhere, meet, or belong to the installation itself."""
    files: set[str] = set()
    folders: set[str] = set()
    for path in paths:
        if reason := unsafe(path):
            raise BundleError(f"{path!r}: refused, its path {reason}")
        parts = path.casefold().split("/")
        if parts[0] in ("venv", "karma", MANIFEST.casefold()) or parts[0].startswith(".karma"):
            raise BundleError(f"{path!r}: refused, that name belongs to the installation")
        above = {"/".join(parts[:n]) for n in range(1, len(parts))}
        whole = "/".join(parts)
        if whole in files or whole in folders or above & files:
            raise BundleError(f"{path!r}: refused, its path stands there twice")
        files.add(whole)
        folders |= above


def unsafe(path: str) -> str:
    """Return why a path must not be unpacked, "" if it may.

    >>> unsafe("models/nano/planner.gguf"), unsafe("../planner.gguf")
    ('', 'leads out of the folder')
    """
    parts = path.split("/")
    if path.startswith(("/", "~")) or "\\" in path or ":" in path:
        return "is absolute or of another system"
    if any(part in ("", ".", "..") for part in parts):
        return "leads out of the folder"
    if not path.isprintable():
        return "has control characters"
    if len(path.encode()) > LONGEST_PATH or max(map(len, parts)) > LONGEST_NAME:
        return "is too long"
    return ""


def places(contents: Contents) -> Iterator[tuple[Member, int]]:
    """Yield each member with the offset of its first byte, behind its header."""
    offset = contents.start
    for member in contents.members:
        offset += len(header(member.path, member.bytes, executable=member.executable))
        yield member, offset
        offset += member.bytes + padding(member.bytes)
