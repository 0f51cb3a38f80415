"""Start processes of ours: none executes what lies in the current folder, all have the guard.

Python itself would look there first: for `-c` and `-m`, and for what `multiprocessing` starts.
"""

import multiprocessing
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.context import ForkServerContext
from pathlib import Path

from karma.offline.guard import SAFE_PATH

_CHILD = "karma.offline.child"


@dataclass(frozen=True, slots=True, kw_only=True)
class ChildEnd:
    """What became of a child."""

    code: int | None  # negative: a signal's; None: it had not ended in time
    said: str  # the last line of its complaints


def child_command(call: str, *arguments: str) -> list[str]:
    """Return the command of a child that calls a function of ours, named "module:function"."""
    child = str(Path(__file__).with_name("child.py"))
    return [sys.executable, "-E", "-P", child, call, *arguments]


def run_child(
    call: str, *arguments: str, given: str = "", limit_s: float | None = None
) -> ChildEnd:
    """Call a function of ours, "module:function", where it may kill nothing but its process.

    It gets the arguments as texts, and `given` as its standard input.
    """
    try:
        done = subprocess.run(
            child_command(call, *arguments), input=given.encode(errors="replace"),
            capture_output=True, check=False, timeout=limit_s,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return ChildEnd(code=None, said="")
    said = done.stderr.decode(errors="replace").strip().splitlines() or ["no message"]
    return ChildEnd(code=done.returncode, said=said[-1])


def forking(*imports: str) -> ForkServerContext:
    """Return how processes are forked from one that has the guard and has imported these modules.

    They are started inside of `starting()`.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([_CHILD, *imports])
    return context


@contextmanager
def starting(**environment: str) -> Iterator[None]:
    """Let processes that are started in here look for nothing in the current folder.

    `environment`: what else they find in theirs.
    """
    wanted = {**SAFE_PATH, **environment}
    before, path = {name: os.environ.get(name) for name in wanted}, sys.path[:]
    os.environ.update(wanted)
    sys.path[:] = filter(None, path)  # "" is this folder; it would be handed on
    try:
        yield
    finally:
        sys.path[:] = path
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value
