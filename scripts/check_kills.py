"""Kill a run again and again, and see that it ends in the bytes of a run that nobody disturbed.

    python scripts/check_kills.py                      # 100 episodes, 20 kills; 1 and 2 workers
    python scripts/check_kills.py --ray 127.0.0.1:6379 # also on a cluster that is there
    python scripts/check_kills.py --tasks 6 --kills 5 --workers 1

The experiment is cheap: the shipped nano planner and the expert on tasks of `eval/alfred_l`. The
process is killed by SIGKILL at an instant drawn by lot, early enough for all kills to meet a living
run, and the same command is given again. Times differ from run to run; of
`timings.jsonl` only the episodes and their order are compared.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from karma.seeds import stream

KARMA = (sys.executable, "-P", "-c", "from karma.cli import app; app()", "eval")
TASKS = Path("eval/alfred_l/tasks.jsonl")
EXPERIMENT = """
name = "kills"
tasks = "{tasks}"
only = {only}
seeds = [0, 1]

[[rows]]
name = "KARMA (K = 3)"
options = {{ attempts = 1 }}

[[rows]]
name = "expert"
method = "expert"
"""
TIMINGS = "timings.jsonl"
ORPHANS_S = 60.0  # that workers of a killed run have to end
_EARLY = 0.2  # share of kills that come while models are loaded
_LOADING_S, _EPISODE_S = 5.0, 0.5  # about what they take


def main() -> int:
    """Run the check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--tasks", type=int, default=25, help="four episodes each")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--ray", default="", help="HOST:PORT of a cluster")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kills-") as name:
        folder = Path(name)
        path = write_experiment(folder / "kills.toml", chosen.tasks)
        begun = time.monotonic()
        finish(path, folder / "whole", ("--workers", "1"))
        whole_s = time.monotonic() - begun
        print(f"undisturbed: {chosen.tasks * 4} episodes in {whole_s:.0f} s", flush=True)
        ways = [("--workers", str(count)) for count in chosen.workers]
        ways += [("--ray", chosen.ray)] if chosen.ray else []
        return int(any([check(path, folder, way, chosen) for way in ways]))


def write_experiment(path: Path, tasks: int) -> Path:
    """Write the experiment with that many tasks."""
    lines = TASKS.read_text().splitlines()
    only = [json.loads(line)["id"] for line in lines][:tasks]
    path.write_text(EXPERIMENT.format(tasks=TASKS.resolve(), only=json.dumps(only)))
    return path


def check(path: Path, folder: Path, way: Sequence[str], chosen: argparse.Namespace) -> bool:
    """Kill runs of one way, finish, compare; returns whether anything differs."""
    there, begun = folder / "killed", time.monotonic()
    shutil.rmtree(there, ignore_errors=True)
    rng = stream(chosen.seed, "kills", *way)
    hits = 0
    for number in range(chosen.kills):
        left = chosen.tasks * 4 - len(episodes(there))
        hits += kill(path, there, way, rng, most=2 * left // (chosen.kills - number + 1))
    left = len(episodes(there))
    finish(path, there, way)
    wrong = differing(folder / "whole", there)
    print(
        f"{' '.join(way)}: {hits} of {chosen.kills} kills met a living run; {left} episodes were "
        f"done before the last start; {len(wrong)} of {len(contents(there))} files differ "
        f"{wrong[:5] or ''} ({time.monotonic() - begun:.0f} s)",
        flush=True,
    )
    return bool(wrong)


def kill(
    path: Path, folder: Path, way: Sequence[str], rng: np.random.Generator, *, most: int
) -> bool:
    """Start the run and kill it; returns whether it still lived.

    One kill in five comes while models are loaded, the others after up to `most` more episodes.
    """
    early = rng.random() < _EARLY
    wanted = len(episodes(folder)) + (0 if early else int(rng.integers(0, most + 1)))
    process = start(path, folder, way)
    while process.poll() is None and len(episodes(folder)) < wanted:
        time.sleep(0.002)
    try:
        process.wait(float(rng.uniform(0, _LOADING_S if early else _EPISODE_S)))
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        _see_orphans_off(process.pid)
        return True
    return False


def _see_orphans_off(group: int) -> None:
    """Wait until the workers of a killed run have ended by themselves.

    Raises:
        RuntimeError: they have not.
    """
    until = time.monotonic() + ORPHANS_S
    while time.monotonic() < until:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    os.killpg(group, signal.SIGKILL)
    raise RuntimeError(f"workers outlived their run by {ORPHANS_S:.0f} s")


def finish(path: Path, folder: Path, way: Sequence[str]) -> None:
    """Let the run come to its end.

    Raises:
        RuntimeError: it fails.
    """
    process = start(path, folder, way)
    said, _ = process.communicate()
    if process.returncode != 0:
        raise RuntimeError(said)


def start(path: Path, folder: Path, way: Sequence[str]) -> subprocess.Popen[str]:
    """Start `karma eval` in a process group of its own."""
    command = [*KARMA, str(path), "--out", str(folder), *way]
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def episodes(folder: Path) -> list[bytes]:
    """Return the whole lines of the records."""
    path = folder / "episodes.jsonl"
    return path.read_bytes().split(b"\n")[:-1] if path.exists() else []


def differing(one: Path, other: Path) -> list[str]:
    """Return the files that are not the same in two run folders."""
    found = [contents(folder) for folder in (one, other)]
    return sorted(
        name for name in {*found[0], *found[1]} if found[0].get(name) != found[1].get(name)
    )


def contents(folder: Path) -> dict[str, object]:
    """Return path -> content; of the timings, the episodes only."""
    found: dict[str, object] = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }
    lines = map(json.loads, (folder / TIMINGS).read_bytes().splitlines())
    found[TIMINGS] = [(line["row"], line["task"], line["seed"]) for line in lines]
    return found


if __name__ == "__main__":
    sys.exit(main())
