"""Start a player that never outlives whoever wanted it.

    python guard.py EXECUTABLE [ARGUMENT ...]

AI2-THOR's client starts the guard in place of the player. The player and what it starts are a
session of their own, which is killed when the guard's parent dies, when the guard is told to end,
and when the player itself has ended. Exit code: the player's, 128 + N where signal N killed it, 127
where it cannot be started. Standard library only; runs as a file under `python -I -S`.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress

TICK_S, GRACE_S = 0.1, 1.0
ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def guarded(command: list[str]) -> int:
    """Run a player to its end, or to that of the parent; return the exit code."""
    parent, mine, prctl = os.getppid(), os.getpid(), _prctl()

    def tie() -> None:
        if prctl is not None:
            prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: where the guard itself is killed
        if os.getppid() != mine:
            os._exit(1)

    for number in ENDING:
        signal.signal(number, lambda number, _: sys.exit(128 + number))
    try:
        player = subprocess.Popen(
            command,
            preexec_fn=tie,  # noqa: PLW1509  (the guard has one thread)
            start_new_session=True,
        )
    except OSError as error:
        sys.stderr.write(f"guard: cannot be started: {error.strerror}: {command[0]}\n")
        return 127
    try:
        while os.getppid() == parent:
            with suppress(subprocess.TimeoutExpired):
                code = player.wait(TICK_S)
                return code if code >= 0 else 128 - code
        return 1
    finally:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(player.pid, signal.SIGKILL)
        with suppress(subprocess.TimeoutExpired):  # one that the kernel holds is left to it
            player.wait(GRACE_S)


def _prctl() -> Callable[[int, int], int] | None:
    """Return Linux's prctl, looked up before the fork; None elsewhere."""
    if not sys.platform.startswith("linux"):
        return None
    import ctypes

    with suppress(OSError, AttributeError):
        found: Callable[[int, int], int] = ctypes.CDLL(None).prctl
        return found
    return None


def main(arguments: list[str]) -> int:
    """Run the guard; return the exit code."""
    if not arguments:
        sys.stderr.write(f"usage: {sys.argv[0]} EXECUTABLE ...\n")
        return 2
    return guarded(arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
