"""A folder that one run owns: its mark names each file that was written, and no other is touched.

The mark is `.karma-run`: a line that says what kind of run made the folder and the SHA-256 of its
header, then a line for each file, which is there before the file is. Whatever lies in a folder
without a mark, or beside what the mark names, is somebody's: it is neither replaced nor removed.
"""

import fcntl
import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal, TypeVar

import msgspec

from karma.errors import FileError, KarmaError
from karma.files import (
    LARGEST_LOG,
    TEMPORARY,
    append_line,
    check_sealed_file,
    decode_json,
    read_bytes,
    read_json,
    sha256_of,
    to_json,
    write_atomic,
)

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


# ----------------------------------------------------------------- the mark

MARK, MADE = ".karma-run", ".karma-made"
HEADER = "header.json"
STEPS = "steps"  # folder of step logs
Kind = Literal["run", "sweep", "benchmark", "figure", "talk"]  # sweeps: of version 0.3.0
_CALLED: Mapping[Kind, str] = {
    "run": "a run", "sweep": "a sweep", "benchmark": "a run of a benchmark",
    "figure": "a figure", "talk": "a conversation",
}  # fmt: skip
_BESIDE = frozenset({"exchanges.jsonl", "recording.lock"})  # a cassette may lie in the folder
_FIX = "--out another folder"
_MOVE = "move it away, or --out another place"
_AGAIN = "bring it back, or karma eval FILE --fresh"
_TALK_AGAIN = "bring it back; karma chat --out another folder begins a conversation"


class _Mark(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The first line of a mark."""

    kind: Kind
    header: str = ""  # SHA-256 of `HEADER`; "" where it grows with the run
    sealed: dict[str, str] = {}  # files that are as they stay once `by` is there: name -> SHA-256
    by: str = ""  # the file that is written last


class OwnedFolder:
    """The files of one run."""

    def __init__(self, path: Path, kind: Kind) -> None:
        self.path = path
        self._begun = _Mark(kind=kind)
        self.names: frozenset[str] = frozenset()  # below the folder, that were written or may be

    def look(self) -> bool:
        """Return whether the folder is such a run's, or free; FileError for somebody else's."""
        begun, self.names = read_mark(self.path)
        if begun is None:
            if there := next(_strangers(self.path), ""):
                reason = f"holds no run, but {ascii(there)[:80]}: no run left its mark ({MARK})"
                raise FileError(self.path, reason, fix=f"{_FIX}, or move away what is in this one")
            return False
        if begun.kind != self._begun.kind:
            held, wanted = (_CALLED[one.kind] for one in (begun, self._begun))
            raise FileError(self.path, f"this folder holds {held}, not {wanted}", fix=_FIX)
        self._begun = begun
        for name in self.names:
            self._keep_inside(name)
        header = self.path / HEADER
        if begun.header and header.exists() and _hash(read_bytes(header)) != begun.header:
            raise FileError(header, "is not the one that this folder's run wrote", fix=_FIX)
        return True

    def begin(self, names: Iterable[str], header: bytes = b"") -> None:
        """Make the folder the run's; FileError where somebody's file has one of the names.

        Of `names` it writes all or some; `header` is the content of `HEADER`, where that never
        changes.
        """
        names = frozenset(names)
        for name in names - self.names:
            self._take(name)
        self._write_mark(names | self.names, header)

    def own(self, name: str) -> Path:
        """Return the path of a file to be written; FileError where somebody's file stands there."""
        if name not in self.names:
            self._take(name)
            append_line(self.path / MARK, b"\n" + to_json(name))  # the last line may be torn
            self.names |= {name}
        return self.path / name

    def write(self, name: str, data: bytes) -> None:
        """Write a file, unless that is what it holds; errors as `own` and `write_atomic`."""
        replace_file(self.own(name), data)

    def sweep(self) -> None:
        """Take away what a killed run left half written among its own files, and nothing else."""
        for folder in {(self.path / name).parent for name in (*self.names, MARK)}:
            for left in folder.glob(f".*{TEMPORARY}"):
                target = left.name[1:].removesuffix(TEMPORARY).rpartition(".")[0]
                name = (folder / target).relative_to(self.path).as_posix()
                if name in self.names or name == MARK:
                    left.unlink(missing_ok=True)

    def seal(self, sealed: Iterable[str], by: str, data: bytes) -> None:
        """Write the last file, and be done: whoever reads sees that what is sealed stayed so.

        The mark's lines are put in order, so equal runs leave equal files.

        The presence of `by`, the last file, says that the seal holds.
        """
        last = self.own(by)
        hashes = {name: sha256_of(self.path / name) for name in sealed} | {by: _hash(data)}
        self._begun = msgspec.structs.replace(self._begun, sealed=hashes, by=by)
        replace_file(self.path / MARK, self._mark())
        replace_file(last, data)

    def clear(self) -> None:
        """Remove what the run has written, and nothing else."""
        self.sweep()
        for name in sorted(self.names):
            self._keep_inside(name)
            with suppress(IsADirectoryError, NotADirectoryError):
                (self.path / name).unlink(missing_ok=True)
            self.fold(name)
        self.names = frozenset()
        self._write_mark(self.names, b"")

    def fold(self, name: str) -> None:
        """Remove the folders that a file was in and that are empty now."""
        for folder in list((self.path / name).parents)[: len(Path(name).parts) - 1]:
            with suppress(OSError):
                folder.rmdir()

    # ------------------------------------------------------------- parts

    def _take(self, name: str) -> None:
        self._keep_inside(name)
        if os.path.lexists(self.path / name):
            reason = "is there, and this run did not write it"
            raise FileError(self.path / name, reason, fix=f"move it away, or {_FIX}")

    def _keep_inside(self, name: str) -> None:
        """Raise FileError where a link is on the way to a file."""
        place = self.path
        for part in Path(name).parts:
            _refuse_link(place := place / part)

    def _write_mark(self, names: frozenset[str], header: bytes) -> None:
        self.names = names
        self._begun = _Mark(kind=self._begun.kind, header=_hash(header) if header else "")
        replace_file(self.path / MARK, self._mark())

    def _mark(self) -> bytes:
        return b"".join(map(to_json, (self._begun, *sorted(self.names))))


def read_mark(folder: Path) -> tuple[_Mark | None, frozenset[str]]:
    """Return what a folder's mark says, or None, and the files it names; FileError for no mark."""
    path = folder / MARK
    if not os.path.lexists(path):
        return None, frozenset()
    _refuse_link(path)
    first, *lines = read_bytes(path, most=LARGEST_LOG).split(b"\n")[:-1] or [b""]
    begun = decode_json(first, _Mark, path=path, fix=_FIX)
    return begun, frozenset(name for line in lines if (name := _name_in(line)))


def _refuse_link(path: Path) -> None:
    if path.is_symlink():
        raise FileError(path, "is a link, and a run keeps to its own folder", fix=_FIX)


class _Headed(msgspec.Struct, frozen=True):
    """What headers of some kinds alone have."""

    benchmark: str = ""
    figure: str = ""


def kind_in(folder: Path) -> Kind | None:
    """Return what kind of run a folder holds, None for none; FileError where its mark is damaged.

    Its mark says so; of a folder without one, its header.
    """
    begun, _ = read_mark(folder)
    if begun is not None:
        return begun.kind
    if not (folder / HEADER).exists():
        return None
    try:
        said = read_json(folder / HEADER, _Headed)
    except FileError:
        return "run"  # whoever reads it says what is wrong
    return "benchmark" if said.benchmark else "figure" if said.figure else "run"


def benchmark_in(folder: Path) -> str:
    """Return the benchmark that a folder holds a run of; FileError where its header is torn."""
    return read_json(folder / HEADER, _Headed).benchmark


def check_sealed(folder: Path) -> None:
    """See that what a finished run has sealed is as it was then; FileError where it is not.

    A step log that is gone is none: that episode is done again.
    """
    begun, _ = read_mark(folder)
    if begun is None or not begun.sealed or not (folder / begun.by).exists():
        return
    fix = _TALK_AGAIN if begun.kind == "talk" else _AGAIN
    for name, sha256 in begun.sealed.items():
        if name.startswith(f"{STEPS}/") and not (folder / name).exists():
            continue
        check_sealed_file(folder / name, sha256, fix=fix)


def _name_in(line: bytes) -> str:
    """Return the name of a file below the folder; "" where a line is torn or names none."""
    try:
        name = msgspec.json.decode(line, type=str)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return ""
    out = "\0" in name or Path(name).is_absolute() or ".." in Path(name).parts
    return "" if out else name


def write_beside(folder: Path, name: str, data: bytes) -> Path:
    """Write what a command makes of a run under a name of ours; FileError for another file there.

    `.karma-made` beside it keeps the SHA-256 of what was written: such a file, and one that the
    folder's run has written, is replaced.
    """
    path, list_ = folder / name, folder / MADE
    made = read_json(list_, dict[str, str], fix=_MOVE) if list_.exists() else {}
    ours = not os.path.lexists(path) or name in read_mark(folder)[1]
    if not ours and made.get(name) != _hash(read_bytes(path)):
        raise FileError(path, "is there, and no such command has written it", fix=_MOVE)
    write_atomic(path, data)
    replace_file(list_, to_json({**made, name: _hash(data)}, indent=2))
    return path


def _strangers(path: Path) -> Iterator[str]:
    """Yield what lies in a folder without a mark, but for a cassette and halves of a mark."""
    found = sorted(entry.name for entry in os.scandir(path)) if path.is_dir() else []
    for name in found:
        ours = name in _BESIDE or (name.startswith(f".{MARK}.") and name.endswith(TEMPORARY))
        if not ours and not any((path / name / one).exists() for one in _BESIDE):
            yield name


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
