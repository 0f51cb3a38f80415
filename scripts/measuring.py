"""Helpers of measurements: clocks, tables, shares with intervals."""

import re
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))  # what tests start, we start

Clock = Callable[[], float]


def taken(work: Callable[[], object], clock: Clock = time.process_time) -> float:
    """Return the seconds that some work takes; of the processor, unless a clock is given."""
    begun = clock()
    work()
    return clock() - begun


def table(head: str, rows: Iterable[Sequence[object]]) -> None:
    """Print a table as Markdown, each row when it is known; numbers with three digits."""
    print(f"| {head} |\n{'|---' * len(head.split(' | '))}|", flush=True)
    for row in rows:
        print(f"| {' | '.join(map(cell, row))} |", flush=True)


def cell(value: object) -> str:
    """Return a value as a table cell; "–" if not measured."""
    if not isinstance(value, float):
        return "–" if value is None else str(value)
    return f"{value:,.0f}" if abs(value) >= 100 else re.sub(r"\.0+$", "", f"{value:.3g}")


def counted(name: str, each: Sequence[bool]) -> str:
    """Return a count with its share and 95 % interval."""
    from karma.bench.figures.statistics import interval_text, rate

    return f"{name}: {sum(each)} of {len(each)} {interval_text(rate([[float(x)] for x in each]))}"


def resident_mb() -> float:
    """Return the resident memory of this process, mapped files included."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(re.findall(r"VmRSS:\s+(\d+)", status)[0]) * 1024 / 1e6
