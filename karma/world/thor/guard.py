"""Stand between AI2-THOR's client and a player, so that the client never hangs.

    python guard.py [--stall SECONDS] EXECUTABLE [ARGUMENT ...]

The client starts the guard in place of the player. The guard starts the player with pipes of its
own, hands whole messages through in both directions, and keeps the client's pipe open. When the
player dies, closes its pipe, sends what is no message, or stops in the middle of one, the guard
kills what is left of it and answers with sequenceId -1: the client raises at once instead of
waiting in open() for ever or spinning at the end of the pipe. The message's `guard` says why.

The player is never orphaned: it and its children go when the client closes its pipe or dies, and
when the guard itself is killed. Signals to the guard go on to the player. Standard library only;
runs as a file under `python -I -S`, a start takes some 40 ms. A player that is asked to speak
HTTP instead of pipes is started without a guard.
"""

import fcntl
import os
import select
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress

ANSWERS = "AI2THOR_FIFO_SERVER_PIPE_PATH"  # the player writes here
ACTIONS = "AI2THOR_FIFO_CLIENT_PIPE_PATH"  # the player reads here
STALL_S = 1.0
TICK_S = 0.1
GRACE_S = 1.0  # between SIGTERM and SIGKILL
LONGEST = 1 << 28  # bytes of one field; more is taken for damage
PIPE_BYTES = 1 << 20
HEADER = struct.Struct("!BI")
END = 255
FROM_PLAYER = frozenset({1, *range(3, 17), END})
FROM_CLIENT = frozenset({2, END})
FORWARDED = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2)
LAST = (signal.SIGTERM, signal.SIGHUP)
# elsewhere a pipe that nobody has opened for writing yet reads as one that has ended
READING = os.O_RDONLY if sys.platform.startswith("linux") else os.O_RDWR


class Messages:
    """Cuts a stream of bytes into whole messages.

    Args:
        kinds: the field types that may come.
    """

    def __init__(self, kinds: frozenset[int]) -> None:
        self.kinds = kinds
        self.bytes = bytearray()
        self.at = 0  # where the next field's header begins
        self.damage = ""  # why nothing more can be read

    @property
    def begun(self) -> bool:
        """Whether there is part of a message."""
        return bool(self.bytes)

    def take(self, data: bytes) -> tuple[bytes, int]:
        """Add bytes; return the messages that are whole now, and how many."""
        self.bytes += data
        end = count = 0
        while not self.damage and len(self.bytes) - self.at >= HEADER.size:
            kind, length = HEADER.unpack_from(self.bytes, self.at)
            if kind not in self.kinds or length > LONGEST or (kind == END and length):
                self.damage = f"sent what is no message (field type {kind}, {length} bytes)"
            elif len(self.bytes) - self.at - HEADER.size < length:
                break
            else:
                self.at += HEADER.size + length
                if kind == END:
                    end, count = self.at, count + 1
        whole = bytes(self.bytes[:end])
        del self.bytes[:end]
        self.at -= end
        return whole, count


class Sender:
    """Writes to a pipe as it takes bytes, and keeps the rest."""

    def __init__(self, pipe: int) -> None:
        self.pipe = pipe
        self.waiting = bytearray()

    def send(self, data: bytes) -> None:
        """Write what goes now; the rest goes with the next call."""
        self.waiting += data
        with suppress(BlockingIOError):
            while self.waiting:
                del self.waiting[: os.write(self.pipe, self.waiting)]


class Guard:
    """One player and the four ends of pipe around it.

    Args:
        command: the player's, with its arguments.
        stall_s: a message that stops half-way for longer is damage.
    """

    def __init__(self, command: list[str], stall_s: float) -> None:
        self.command, self.stall_s = command, stall_s
        self.parent = os.getppid()
        self.player: subprocess.Popen[bytes] | None = None
        self.keeper = _keeper()
        self.bell, ring = os.pipe()
        for end in (self.bell, ring):
            os.set_blocking(end, False)
        signal.set_wakeup_fd(ring, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        for number in FORWARDED:
            signal.signal(number, self._forward)
        answers, actions = os.environ[ANSWERS], os.environ[ACTIONS]
        self.environment = {
            **os.environ,
            ANSWERS: answers + ".player",
            ACTIONS: actions + ".player",
        }
        os.mkfifo(self.environment[ANSWERS])
        os.mkfifo(self.environment[ACTIONS])
        # both ends where writing, so that neither open() nor the other side's end matters
        self.to_client = Sender(_open(answers, os.O_RDWR))
        self.to_player = Sender(_open(self.environment[ACTIONS], os.O_RDWR))
        self.from_client = _open(actions, READING)
        self.from_player = _open(self.environment[ANSWERS], READING)
        self.actions, self.answers = Messages(FROM_CLIENT), Messages(FROM_PLAYER)
        self.heard_s = time.monotonic()
        self.lost = ""  # why there is no player any more
        self.over_s: float | None = None  # when to end, after a last signal
        self.gone = False  # nobody is there to answer

    def run(self) -> int:
        """Serve until the client has gone; return the exit code."""
        self._start()
        while not self._over():
            self._tick()
        self._kill()
        os.write(self.keeper, b"x")
        code = self.player.returncode if self.player is not None else None
        return 127 if code is None else abs(code) + 128 * (code < 0)

    # ------------------------------------------------------------- the player

    def _start(self) -> None:
        prctl = _prctl()
        mine = os.getpid()

        def tie() -> None:
            if prctl is not None:
                prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
            if os.getppid() != mine:
                os._exit(1)

        try:
            self.player = subprocess.Popen(
                self.command,
                env=self.environment,
                preexec_fn=tie,  # noqa: PLW1509  (the guard has one thread)
                start_new_session=True,
            )
        except OSError as error:
            self._lose(f"cannot be started: {error.strerror}: {self.command[0]}")
        else:
            os.write(self.keeper, b"%d\n" % self.player.pid)

    def _kill(self) -> None:
        """Kill the player and whatever it has started; one that the kernel holds is left to it."""
        if self.player is not None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.player.pid, signal.SIGKILL)
            with suppress(subprocess.TimeoutExpired):
                self.player.wait(timeout=GRACE_S)

    def _lose(self, reason: str) -> None:
        if not self.lost:
            self.lost = reason
            self.to_client.send(farewell(reason))
            sys.stderr.write(f"guard: the player {reason}\n")
            self._kill()

    def _forward(self, number: int, _frame: object) -> None:
        if self.player is not None and self.player.returncode is None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.player.pid, number)
        if number in LAST:
            self.over_s = time.monotonic() + GRACE_S

    # ------------------------------------------------------------- the traffic

    def _over(self) -> bool:
        if self.over_s is not None and (self.lost or time.monotonic() > self.over_s):
            return True
        return self.gone or os.getppid() != self.parent

    def _tick(self) -> None:
        sources = [self.bell, self.from_client] + ([] if self.lost else [self.from_player])
        targets = [one.pipe for one in (self.to_client, self.to_player) if one.waiting]
        ready, writable, _ = select.select(sources, targets, [], TICK_S)
        if self.bell in ready:
            os.read(self.bell, 4096)
        if self.from_player in ready:
            self._hear_player()
        if self.from_client in ready:
            self._hear_client()
        for one in (self.to_client, self.to_player):
            if one.pipe in writable:
                one.send(b"")
        if not self.lost:
            self._look()

    def _hear_player(self) -> None:
        """Hand on what is whole; the end of the pipe is the player's end."""
        data = _read(self.from_player)
        if data == b"":
            self._ended()
        elif data:
            self.heard_s = time.monotonic()
            whole, _ = self.answers.take(data)
            self.to_client.send(whole)
            if self.answers.damage:
                self._lose(self.answers.damage)

    def _ended(self) -> None:
        """Wait a moment for the exit code: it says more than the end of a pipe."""
        if self.player is None:
            return
        try:
            self.player.wait(timeout=0.3)
        except subprocess.TimeoutExpired:
            self._lose("closed its pipe")
        else:
            self._lose(_how(self.player.returncode))

    def _hear_client(self) -> None:
        data = _read(self.from_client)
        if data == b"":
            self.gone = True
        elif data:
            whole, count = self.actions.take(data)
            if self.lost:
                self.to_client.send(farewell(self.lost) * count)
            else:
                self.to_player.send(whole)

    def _look(self) -> None:
        """Notice a dead player that never opened its pipe, and half a message."""
        if self.player is not None and self.player.poll() is not None:
            while _waiting(self.from_player) and not self.lost:
                self._hear_player()  # it may have answered before it died
            self._lose(_how(self.player.returncode))
        elif self.answers.begun and time.monotonic() - self.heard_s > self.stall_s:
            self._lose("stopped in the middle of a message")


def farewell(reason: str) -> bytes:
    """Return a message whose sequenceId is -1, which no client waits for.

    >>> farewell("died")[-5:].hex(" ")
    'ff 00 00 00 00'
    """
    text = reason.encode()[:1000]
    body = b"\x83\xa6agents\x90\xaasequenceId\xff\xa5guard\xda" + struct.pack("!H", len(text))
    return HEADER.pack(1, len(body) + len(text)) + body + text + HEADER.pack(END, 0)


def _how(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    names = {int(one): one.name for one in signal.Signals}
    return f"was killed by {names.get(-code, f'signal {-code}')}"


def _open(path: str, mode: int) -> int:
    pipe = os.open(path, mode | os.O_NONBLOCK)
    if hasattr(fcntl, "F_SETPIPE_SZ"):
        with suppress(OSError):  # more than this user may have
            fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
    return pipe


def _read(pipe: int) -> bytes | None:
    """Return what is there; None when nothing is, b"" at the end."""
    try:
        return os.read(pipe, PIPE_BYTES)
    except BlockingIOError:
        return None


def _waiting(pipe: int) -> bool:
    return bool(select.select([pipe], [], [], 0)[0])


def _prctl() -> Callable[[int, int], int] | None:
    """Return Linux's prctl, looked up before the fork; None elsewhere."""
    if not sys.platform.startswith("linux"):
        return None
    import ctypes

    with suppress(OSError, AttributeError):
        found: Callable[[int, int], int] = ctypes.CDLL(None).prctl
        return found
    return None


def _keeper() -> int:
    """Start the process that outlives the guard by a moment; return the pipe that it listens to.

    The client ends a player with SIGKILL, and so it ends the guard. The keeper is told the player's
    process group; when the guard is gone without a goodbye, it kills that group.
    """
    listen, tell = os.pipe()
    if os.fork():
        os.close(listen)
        return tell
    os.close(tell)
    os.setsid()
    told = b""
    while not told.endswith(b"x"):
        part = os.read(listen, 64)
        told += part
        if not part:
            with suppress(ProcessLookupError, PermissionError, ValueError):
                os.killpg(int(told), signal.SIGKILL)
            break
    os._exit(0)


def main(arguments: list[str]) -> int:
    """Run the guard; return the exit code."""
    stall_s = STALL_S
    if arguments[:1] == ["--stall"]:
        stall_s, arguments = float(arguments[1]), arguments[2:]
    if not arguments:
        sys.stderr.write(f"usage: {sys.argv[0]} [--stall SECONDS] EXECUTABLE ...\n")
        return 2
    if ANSWERS not in os.environ or ACTIONS not in os.environ:
        os.execvp(arguments[0], arguments)
    return Guard(arguments, stall_s).run()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
