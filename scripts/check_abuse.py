"""Attack the stack in every class of tests/support/abuse, and print how often it held.

    python scripts/check_abuse.py [CLASS ...] [--count N] [--seed S]

The same generators as in tests/abuse, with more draws: all of them take some
minutes. Exit code 1 if anything gave way.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.abuse import Case, Tally, attacked
from support.abuse.answers import answers, showing
from support.abuse.egress import PLANTED, egress
from support.abuse.faults import FAULTS, faults
from support.abuse.files import files
from support.abuse.folders import folders
from support.abuse.memories import memories
from support.abuse.names import names
from support.abuse.servers import servers

from karma.offline import go_offline

CLASSES: dict[str, tuple[Callable[[int, int], Iterator[Case]], int, str]] = {
    "answers": (answers, 2000, "planners' answers"),
    "showing": (showing, 500, "texts in terminal, files and page"),
    "names": (names, 1000, "names that become paths"),
    "files": (files, 1000, "files, by kind"),
    "folders": (folders, 200, "folders of brought models, by kind"),
    "memories": (memories, 400, "memories of lived-in homes"),
    "servers": (servers, 200, "servers"),
    "egress": (egress, len(PLANTED), "planted plug-ins"),
    "faults": (faults, 2 * len(FAULTS), "faults, by kind"),
}
BY_KIND = ("files", "folders", "faults")
ELSEWHERE = ("egress", "faults")  # in processes of their own, whose time is not counted
_EVERY_S = 5.0  # between two lines of progress


def main() -> int:
    """Try the classes asked for; 0 when all held."""
    parser = argparse.ArgumentParser(description="Attack the stack; print tried and held.")
    parser.add_argument("classes", nargs="*", choices=[*CLASSES, []], help="default: all")
    parser.add_argument("--count", type=int, help="attacks of each class")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    go_offline()
    bad = False
    print("| class | tried | held | slowest, s of processor |\n|---|---|---|---|", flush=True)
    for name in given.classes or CLASSES:
        bad |= _try(name, given.seed, given.count or CLASSES[name][1])
    return int(bad)


def _try(name: str, seed: int, count: int) -> bool:
    """Try one class and print its lines of the table; returns whether anything gave way."""
    cases, _, title = CLASSES[name]
    tally, kinds, failed, told = Tally(), Counter[str](), Counter[str](), time.monotonic()
    seen: list[str] = []

    def named() -> Iterator[Case]:
        for case in cases(seed, count):
            seen.append(case.name.rpartition(" ")[0].partition(":")[0])
            yield case

    with tempfile.TemporaryDirectory() as folder:
        for tally in attacked(named(), Path(folder)):
            kinds[seen[-1]] += 1
            failed[seen[-1]] += len(tally.gave_way) > sum(failed.values())
            if time.monotonic() - told > _EVERY_S:
                told = time.monotonic()
                print(f"{name}: {tally.tried} of {count}", file=sys.stderr, flush=True)
    held = tally.tried - len(tally.gave_way)
    slowest = f"{tally.slowest_s:.1f} ({tally.slowest[:40]})".replace("|", "/")
    slowest = "–" if name in ELSEWHERE else slowest
    print(f"| **{title}** | {tally.tried} | {held} | {slowest} |", flush=True)
    if name in BY_KIND:
        for kind, tried in kinds.items():
            print(f"| {kind} | {tried} | {tried - failed[kind]} | |", flush=True)
    for what, how in tally.gave_way:
        print(f"gave way: {what}: {how}", file=sys.stderr, flush=True)
    return bool(tally.gave_way)


if __name__ == "__main__":
    sys.exit(main())
