"""Same steps, same bytes: in two processes with different hash seeds, in eight rooms."""

import os
import subprocess
import sys

import pytest
from support.paths import ROOT

from karma.world.core import scene

SCRIPT = ROOT / "tests" / "support" / "random_steps.py"
ROOMS = sorted(path.stem for path in scene.SCENES.glob("*[12].json"))
STEPS = 250


def run(hash_seed, names):
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, SCRIPT, str(STEPS), *names],
        check=False, capture_output=True, text=True, env=environment, timeout=500,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return dict(line.split(" ", 1) for line in done.stdout.splitlines())


@pytest.mark.parametrize("part", range(2))
def test_random_steps_give_the_same_bytes_in_two_processes(part):
    names = ROOMS[part::2]
    first, second = run("1", names), run("2", names)
    assert list(first) == names
    assert first == second
    for figures in first.values():
        assert STEPS * 0.3 < int(figures.split()[1]) < STEPS * 0.7  # about half fail
