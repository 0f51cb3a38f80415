"""Seconds of the processor that `karma run` takes to its first action, and in all.

    python scripts/bench_start.py [--times 3]

Each time in an empty folder: first the room is not known yet, so that its long-term memory is made,
then it is. Seconds of the processor (user and system) do not depend on what else the machine does
as wall time would. Linux only: the kernel is asked what the process has taken when the first
action shows on its terminal.
"""

import argparse
import os
import pty
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

KARMA = Path(sys.executable).with_name("karma")
ACTING = b"(robot"  # stands in the first action that shows


def seconds_of(pid: int) -> float:
    """Return what a running process has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measured(instruction: str, folder: Path) -> tuple[float, float]:
    """Run once on a terminal of its own; return seconds to the first action, and in all."""
    ours, theirs = pty.openpty()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(
        [KARMA, "run", instruction], cwd=folder, stdin=subprocess.DEVNULL,
        stdout=theirs, stderr=theirs, env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    os.close(theirs)
    shown, first = b"", float("nan")
    while piece := _read(ours):
        shown += piece
        if first != first and ACTING in shown:
            first = seconds_of(process.pid)
    os.close(ours)
    if process.wait() or first != first:
        sys.exit(f"karma run did not do it:\n{shown.decode(errors='replace')}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return first, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # the other side is closed
        return b""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--instruction", default="put the apple in the fridge")
    arguments = parser.parse_args()
    rows: dict[str, list[tuple[float, float]]] = {"room not known": [], "room known": []}
    for _ in range(arguments.times):
        with tempfile.TemporaryDirectory() as folder:
            for found in rows.values():
                found.append(measured(arguments.instruction, Path(folder)))
    print(f"median of {arguments.times}, seconds of the processor: first action, in all")
    for name, found in rows.items():
        first, whole = (statistics.median(column) for column in zip(*found, strict=True))
        print(f"{name:15} {first:6.2f} {whole:6.2f}")


if __name__ == "__main__":
    main()
