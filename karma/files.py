"""Reading strictly and writing atomically: a bad file is named, a written one is never lost.

Files are not trusted before they are read: what is no regular file is not opened for long, what is
too large is not taken into memory, and a name out of somebody's file never leads out of a folder.

Data that ships lies in `models/` and `eval/` at the top of a checkout; a wheel carries copies in
`karma/shipped/`, put there when it is built (setup.py).
"""

import errno
import functools
import gzip
import hashlib
import io
import json
import os
import re
import stat
import tempfile
import zlib
from codecs import BOM_UTF8
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from karma.errors import FileError, KarmaError, UnwritableError, did_you_mean

T = TypeVar("T")
PACKAGE = Path(__file__).parent
_PARENT = PACKAGE.parent  # of a checkout: its top
LARGEST = 1 << 28  # bytes of a file that is read whole, and of what it unpacks to
LARGEST_TOML = 1 << 24  # likewise
LARGEST_LOG = 1 << 32  # bytes of a file of lines that grows with every episode
TEMPORARY = ".karma-part"  # how files end that `write_atomic` has not put in place yet
LONGEST_NAME = 200  # bytes; file systems take 255
_QUOTED = re.compile(rb"\"[^\"\n]*+\"|'[^'\n]*+'")
_CHAIN = re.compile(rb"(?<![\w-])[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++){64}")
_CHUNK = 1 << 22
_MOST_TEXT = 300  # characters of a reason
_SPACE = "free some space there, or choose another folder"
_DESCRIPTORS = "let this process open more files: ulimit -n 1024"


def read_json(path: str | Path, kind: type[T], *, fix: str | None = None) -> T:
    """Read one JSON file into `kind` (a msgspec Struct or dataclass), refusing what does not fit.

    Raises:
        FileError: missing, torn, or of the wrong form; names the place inside the file.
    """
    return decode_json(read_bytes(path, fix=fix), kind, path=path, fix=fix)


def decode_json(data: bytes | str, kind: type[T], *, path: str | Path, fix: str | None = None) -> T:
    """Decode JSON text that came from `path`; errors as in `read_json`."""
    mark: Any = BOM_UTF8 if isinstance(data, bytes) else "\ufeff"  # that some editors begin with
    try:
        return msgspec.json.decode(data.removeprefix(mark), type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise FileError(path, _short(str(error)), fix=fix) from error
    except RecursionError as error:
        raise FileError(path, "nested too deeply", fix=fix) from error


def lines_of(path: str | Path) -> list[bytes]:
    """Return the lines of a text file, without the mark that some editors begin it with."""
    return read_bytes(path).removeprefix(BOM_UTF8).splitlines()


def check_keys(data: bytes) -> None:
    """Refuse JSON text in which a key of an object stands twice: decoders drop the first.

    Raises:
        KarmaError: one does; it is named.
    """

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise KarmaError(f"{twice!r} stands twice")
        return found

    json.loads(data, object_pairs_hook=once)


def read_toml(path: str | Path, kind: type[T], *, fix: str | None = None) -> T:
    """Read one TOML file into `kind`; errors as in `read_json`."""
    data = read_bytes(path, fix=fix, most=LARGEST_TOML).removeprefix(BOM_UTF8)
    if _CHAIN.search(_QUOTED.sub(b"q", data)):  # tomllib takes hours for the longest
        raise FileError(path, "a key of more than 64 parts", fix=fix)
    try:
        return msgspec.toml.decode(data, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, ValueError) as error:
        raise FileError(path, _short(str(error)), fix=fix) from error
    except RecursionError as error:
        raise FileError(path, "nested too deeply", fix=fix) from error


def _short(text: str) -> str:
    return text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]}..."


def read_bytes(path: str | Path, *, fix: str | None = None, most: int = LARGEST) -> bytes:
    """Return a regular file's bytes; pipes and devices, which may never end, are refused.

    Args:
        path: the file, or a link to it.
        fix: what helps, for the message.
        most: bytes that it may have.

    Raises:
        FileError: it cannot be read, or is larger.
    """
    with open_regular(path, fix=fix) as file:
        try:
            data = file.read(most + 1)
        except OSError as error:
            raise FileError(path, error.strerror or str(error), fix=fix) from error
    if len(data) > most:
        raise FileError(path, f"larger than {_size(most)}", fix=fix)
    return data


def open_regular(path: str | Path, *, fix: str | None = None) -> io.BufferedReader:
    """Open a regular file to be read, without waiting for whatever else stands there.

    Raises:
        FileError: there is none, it is no regular file, or it cannot be opened.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        help_ = _DESCRIPTORS if error.errno in (errno.EMFILE, errno.ENFILE) else fix
        raise FileError(path, error.strerror or str(error), fix=help_) from error
    except ValueError as error:  # a null byte, a lone surrogate
        raise FileError(ascii(str(path)), "no name that a file can have", fix=fix) from error
    kind = os.fstat(handle).st_mode
    if not stat.S_ISREG(kind):
        os.close(handle)
        what = "a folder, not a file" if stat.S_ISDIR(kind) else "a pipe or device, not a file"
        raise FileError(path, what, fix=fix)
    return os.fdopen(handle, "rb")


def sha256_of(
    path: Path, *, fix: str | None = None, progress: Callable[[int], None] | None = None
) -> str:
    """Return a file's SHA-256; `progress` is told of every piece read, in bytes.

    Raises:
        FileError: it cannot be read.
    """
    digest = hashlib.sha256()
    with open_regular(path, fix=fix) as file:
        try:
            while piece := file.read(_CHUNK):
                digest.update(piece)
                if progress is not None:
                    progress(len(piece))
        except OSError as error:
            raise FileError(path, error.strerror or str(error), fix=fix) from error
    return digest.hexdigest()


def check_sealed_file(path: Path, sha256: str, *, fix: str) -> None:
    """See that a file is as it was when it was sealed; FileError where it is edited or damaged."""
    if sha256_of(path, fix=fix) != sha256:
        raise FileError(path, f"is not as it was left: its SHA-256 was {sha256}", fix=fix)


def unpack(data: bytes, *, path: str | Path, fix: str | None = None, most: int = LARGEST) -> bytes:
    """Return what gzipped bytes that came from `path` hold.

    Raises:
        FileError: torn, no gzip, or more than `most` bytes come out.
    """
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            found = file.read(most + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise FileError(path, f"torn gzip: {error}", fix=fix) from error
    if len(found) > most:
        raise FileError(path, f"unpacks to more than {_size(most)}", fix=fix)
    return found


def _size(count: int) -> str:
    return f"{count >> 20} MiB" if count >= 1 << 20 else f"{count} bytes"


def below(folder: str | Path, name: str, *, source: str | Path | None = None) -> Path:
    """Return the path of a file in a folder, whose name somebody else has chosen.

    Args:
        folder: the file's.
        name: of the file itself; no path, not hidden, printable.
        source: where the name was read, for the message.

    Raises:
        FileError: the name leads out of the folder, or no file can have it.

    >>> below("runs", "FloorPlan1.json").as_posix()
    'runs/FloorPlan1.json'
    """
    bad = name.startswith(".") or "/" in name or "\\" in name or not name.isprintable()
    if not name or bad or len(name.encode(errors="replace")) > LONGEST_NAME:
        reason = f"{_short(ascii(name))} cannot be the name of a file in {folder}"
        raise FileError(source or folder, reason, fix="use letters, digits, -, _ and spaces in it")
    return Path(folder) / name


def inside(folder: Path, name: str) -> Path:
    """Return the path of a file of a folder; FileError where links lead out of the folder."""
    path = folder / name
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
        raise FileError(path, f"a link leads out of {folder}", fix="remove the link")
    return path


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
    except (OSError, ValueError) as error:
        raise _unwritable(path, error) from error


@functools.cache
def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_atomic(path: str | Path, data: bytes | memoryview) -> None:
    """Replace `path` by `data`, or leave it as it was.

    A link stays, and what it leads to is replaced.

    Raises:
        UnwritableError: the disk is full, or the folder read-only; nothing half-written stays.
    """
    path = Path(path)
    temporary: str | None = None
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise OSError(errno.EINVAL, "a pipe or device, not a file")
        target = path.resolve() if path.is_symlink() else path
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(
            dir=target.parent, prefix=f".{target.name}.", suffix=TEMPORARY
        )
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).chmod(0o666 & ~_umask())
        Path(temporary).replace(target)
        temporary = None
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: links in a circle
        raise _unwritable(path, error) from error
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


def _unwritable(path: Path, error: Exception) -> UnwritableError:
    reason = getattr(error, "strerror", None) or str(error)
    number = getattr(error, "errno", None)
    fix = _DESCRIPTORS if number in (errno.EMFILE, errno.ENFILE) else _SPACE
    if number in (errno.EACCES, errno.EPERM, errno.EROFS):
        fix = "another place that may be written, e.g. --out FOLDER"
    return UnwritableError(path, f"cannot write: {reason}", fix=fix)


def is_checkout() -> bool:
    """Return whether this is the project's own folder and not an installed wheel."""
    return (_PARENT / "pyproject.toml").is_file() and (_PARENT / "setup.py").is_file()


def shipped(name: Literal["models", "eval"]) -> Path:
    """Return a folder of data: the checkout's, else the copy that the wheel carries."""
    return _PARENT / name if is_checkout() else PACKAGE / "shipped" / name


def cache() -> Path:
    """Return $KARMA_CACHE, by default ~/.cache/karma: what was computed or built once."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(os.environ.get("KARMA_CACHE") or f"{home}/karma")


def repair(in_checkout: str = "make setup") -> str:
    """Return the command that brings back what the package itself should have."""
    if is_checkout():
        return in_checkout
    return f"pip install --force-reinstall --no-deps karma-offline=={version('karma-offline')}"


def rebuild_llama(options: str) -> str:
    """Return the command that builds llama.cpp with CMake options; "" is our own."""
    if is_checkout():
        return f'make setup CMAKE_ARGS="{options}"' if options else "make setup CMAKE_ARGS="
    wanted = f"llama-cpp-python=={version('llama-cpp-python')}"
    build = f"pip install --force-reinstall --no-deps --no-binary :all: {wanted}"
    return f'CMAKE_ARGS="{options or "-DLLAVA_BUILD=ON"}" {build}'


def find_experiment(given: Path) -> Path:
    """Return an experiment's file: one that is there, else one that ships, by name or path.

    "demo", "demo.toml" and "eval/demo.toml" are the same from any folder; "table1" finds
    "paper/table1.toml".

    Raises:
        FileError: there is none; names the nearest that ships.
    """
    if given.is_file() or given.is_absolute():
        return given
    folder = shipped("eval")
    known = {path.relative_to(folder).with_suffix("").as_posix(): path
             for path in sorted(folder.rglob("*.toml")) if "results" not in path.parts}  # fmt: skip
    name = given.with_suffix("") if given.suffix == ".toml" else given
    wanted = name.as_posix().removeprefix("eval/")
    short = {key.rpartition("/")[2]: path for key, path in known.items()}
    if found := known.get(wanted) or short.get(wanted):
        return found
    hint = did_you_mean(wanted, [*known, *short]) or f" There is {', '.join(known)}"
    raise FileError(given, f"no such file, and no such experiment.{hint}", fix="karma eval demo")
