"""The file of a recording: one process claims it, others join, and all append lines in turns.

`recording.lock` beside the file names the recording by a token. Its first byte is locked as long as
the process lives that claimed it, its second by whoever appends. A process that a killed run left
behind has the token of that run, and so cannot write into the next one.
"""

import fcntl
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from karma.errors import FileError
from karma.files import LARGEST_LOG, read_bytes

LOCK = "recording.lock"
_CLAIM, _TURN = 0, 1  # bytes of the lock file


class Recording:
    """One process's hold on a file of lines; a token joins another's recording, "" claims the file.

    Raises:
        FileError: it cannot be written, or another process records there.
    """

    def __init__(self, path: Path, token: str = "") -> None:
        self._path, self._seen = path, 0
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = path.with_name(LOCK).open("a+b", buffering=0)
        except OSError as error:
            raise FileError(path, f"cannot write: {error.strerror}") from error
        self.token = token or self._claimed()

    @contextmanager
    def turn(self) -> Iterator[None]:
        """Keep all other processes from the file, whose lines are whole meanwhile.

        FileError where another recording has begun since.
        """
        fcntl.lockf(self._lock, fcntl.LOCK_EX, 1, _TURN)
        try:
            if os.pread(self._lock.fileno(), 99, 0) != self.token.encode():
                raise FileError(self._path, "another recording has begun here since")
            self._mend()
            yield
        finally:
            fcntl.lockf(self._lock, fcntl.LOCK_UN, 1, _TURN)

    def news(self) -> list[bytes]:
        """Return the lines since the last look, whoever wrote them; for use in a turn."""
        if not self._path.exists():
            return []
        with self._path.open("rb") as file:
            file.seek(self._seen)
            data = file.read()
        self._seen += len(data)
        return data.splitlines()

    def _claimed(self) -> str:
        """Return the token of a new recording."""
        try:
            fcntl.lockf(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _CLAIM)
        except OSError as error:
            self._lock.close()
            fix = "give --cassette another DIR"
            raise FileError(self._path, "another process records here", fix=fix) from error
        token = secrets.token_hex(8)
        fcntl.lockf(self._lock, fcntl.LOCK_EX, 1, _TURN)
        self._lock.truncate(0)
        self._lock.write(token.encode())
        fcntl.lockf(self._lock, fcntl.LOCK_UN, 1, _TURN)
        return token

    def _mend(self) -> None:
        """Drop a torn last line, which a killed process or a full disk has left."""
        if not self._path.exists():
            return
        with self._path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            if not size or os.pread(file.fileno(), 1, size - 1) == b"\n":
                return
        whole = read_bytes(self._path, most=LARGEST_LOG).rfind(b"\n") + 1
        os.truncate(self._path, whole)
