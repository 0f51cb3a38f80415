"""Processes that are killed."""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

_PATIENCE_S = 240.0


class Child:
    """A process of ours, forked from one that has the libraries; ends with an exit code."""

    def __init__(self, work: Callable[..., None], *given: Any):
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["karma.cli", "karma.bench.engine.run", "llama_cpp"])
        self._said, theirs = context.Pipe(duplex=False)
        self.process = context.Process(target=_begun, args=(theirs, work, given))
        self.process.start()
        theirs.close()

    def kill_after(self, seconds: float, when: Callable[[], bool]) -> bool:
        """Kill it that long after something is so; returns whether it still lived."""
        until = time.monotonic() + _PATIENCE_S
        while self.process.is_alive() and not when() and time.monotonic() < until:
            time.sleep(0.005)
        self.process.join(seconds)
        lived = self.process.is_alive()
        self.process.kill()
        self.process.join()
        return lived


def _begun(said: Any, work: Callable[..., None], given: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (1, 2):
        os.dup2(said.fileno(), number)
    said.close()
    work(*given)


def until_free(folder: Path) -> None:
    """Wait until a killed run's workers are gone, which hold its lock no longer than they live."""
    from karma.errors import KarmaError
    from karma.journal.folder import locked

    until = time.monotonic() + _PATIENCE_S
    while True:
        try:
            with locked(folder):
                return
        except KarmaError:
            assert time.monotonic() < until, "workers outlive their run"
            time.sleep(0.05)
