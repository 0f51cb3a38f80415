"""What is typed at a terminal: arrow keys bring back what was typed, also the day before."""

import os
import pty
import select
import subprocess
import sys
import time

import pytest
from support.paths import ROOT

pytest.importorskip("readline")
_CODE = """
import sys
from pathlib import Path
from karma.cli.conversation import _typed
for line in _typed(Path(sys.argv[1]) if sys.argv[1] else None):
    print(f"<{line}>", flush=True)
"""
UP, DOWN, LEFT, END_OF_FILE = "\x1b[A", "\x1b[B", "\x1b[D", "\x04"


def typed(home, *keys):
    """What a child takes as typed, key by key; each waits for the prompt."""
    child, terminal = pty.openpty()
    env = {**os.environ, "TERM": "xterm", "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", _CODE, str(home or "")],
        stdin=terminal, stdout=terminal, stderr=terminal, env=env, close_fds=True,
    ) as process:  # fmt: skip
        os.close(terminal)
        shown = ""
        for number, key in enumerate(keys, 1):
            shown = until(child, shown, lambda text, n=number: text.count("> ") >= n)
            os.write(child, key.encode())
        shown = until(child, shown, lambda text: False)
        process.wait(20)
    os.close(child)
    return [line[1:-1] for line in shown.split("\r\n") if line.startswith("<")]


def until(child, shown, holds):
    """What a terminal has shown so far, read until that holds or it ends."""
    end = time.monotonic() + 20
    while not holds(shown) and time.monotonic() < end:
        if select.select([child], [], [], 0.2)[0]:
            try:
                shown += os.read(child, 4096).decode()
            except OSError:  # the child has gone
                break
    return shown


def test_arrow_keys_bring_back_and_mend_what_was_typed(tmp_path):
    keys = ["wash the mug\n", "open it\n", f"{UP}{UP}{DOWN}{UP}\n", f"cup{LEFT * 3}a \n"]
    assert typed(None, *keys, END_OF_FILE) == ["wash the mug", "open it", "wash the mug", "a cup"]


def test_home_keeps_what_was_typed(tmp_path):
    assert typed(tmp_path, "wash the mug\n", "where is it?\n", END_OF_FILE)
    assert typed(tmp_path, f"{UP}{UP}\n", END_OF_FILE) == ["wash the mug"]
    assert (tmp_path / "typed.txt").read_text().count("wash the mug") == 2


def test_full_history_costs_nothing_that_is_typed(tmp_path):
    (tmp_path / "typed.txt").mkdir()
    assert typed(tmp_path, "wash the mug\n", END_OF_FILE) == ["wash the mug"]
