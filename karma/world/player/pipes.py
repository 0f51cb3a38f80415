"""Open the two pipes of AI2-THOR's client without waiting for one that is dead.

The client makes both, starts the player, and reads before it writes. A plain `open` would wait for
ever if the client died in between, and leave the player behind as an orphan.
"""

import contextlib
import errno
import fcntl
import os
import select
import time
from pathlib import Path
from typing import BinaryIO

from karma.errors import KarmaError

_PAUSE_S = 0.002
_PATIENCE_S = 60.0  # the client opens its end as soon as it has started us
_PIPE_BYTES = 1 << 20  # room for a message with pictures; Linux allows this much to everybody
_SET_PIPE_SIZE = getattr(fcntl, "F_SETPIPE_SZ", None)


class ClientGoneError(KarmaError):
    """The client ended before it had opened both pipes."""


def open_sink(path: str | Path, parent: int) -> BinaryIO:
    """Open the pipe that the client reads, as soon as it does.

    Args:
        path: of the pipe.
        parent: the process that started this one; without it there is no point in waiting.

    Raises:
        ClientGoneError: the parent ended first, or the client does not come.
        OSError: there is no such pipe.
    """
    deadline = time.monotonic() + _PATIENCE_S
    while True:
        try:
            handle = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
            break
        except OSError as error:
            if error.errno != errno.ENXIO:  # no reader yet
                raise
        if os.getppid() != parent or time.monotonic() > deadline:
            raise ClientGoneError("nobody reads the server pipe: the client is gone")
        time.sleep(_PAUSE_S)
    os.set_blocking(handle, True)
    if _SET_PIPE_SIZE is not None:
        with contextlib.suppress(OSError):  # only makes it faster
            fcntl.fcntl(handle, _SET_PIPE_SIZE, _PIPE_BYTES)
    return os.fdopen(handle, "wb")


def open_source(path: str | Path) -> BinaryIO:
    """Open the pipe that the client writes; `await_client` before the first read.

    Raises:
        OSError: there is no such pipe.
    """
    return os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb")


def await_client(source: BinaryIO, sink: BinaryIO) -> None:
    """Wait until the client has written, or has closed what it opened.

    Raises:
        ClientGoneError: it closed the pipe it reads before it opened the one it writes.
    """
    poll = select.poll()
    poll.register(source.fileno(), select.POLLIN)
    poll.register(sink.fileno(), 0)  # errors only
    ready = dict(poll.poll())
    if source.fileno() not in ready:
        raise ClientGoneError("the client ended before it opened the client pipe")
    os.set_blocking(source.fileno(), True)
