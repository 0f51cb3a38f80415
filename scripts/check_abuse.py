"""Attack the stack in every class of tests/support/abuse, and print how often it held.

    python scripts/check_abuse.py [CLASS ...] [--count N] [--seed S]

The same generators as in tests/abuse, with more draws. Exit code 1 if anything gave way.
"""

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.abuse import Tally, attacked
from support.abuse.answers import answers, showing
from support.abuse.egress import egress
from support.abuse.files import files
from support.abuse.servers import servers

from karma.offline import go_offline

CLASSES = {
    "answers": (answers, 5000),
    "showing": (showing, 1000),
    "files": (files, 3000),
    "servers": (servers, 400),
    "egress": (egress, 100),
}


def main() -> int:
    """Try the classes asked for; 0 when all held."""
    parser = argparse.ArgumentParser(description="Attack the stack; print tried and held.")
    parser.add_argument("classes", nargs="*", choices=[*CLASSES, []], help="default: all")
    parser.add_argument("--count", type=int, help="attacks of each class")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    go_offline()
    bad = False
    for name in given.classes or CLASSES:
        cases, usual = CLASSES[name]
        tally = Tally()
        with tempfile.TemporaryDirectory() as folder:
            for tally in attacked(cases(given.seed, given.count or usual), Path(folder)):
                if sys.stderr.isatty() and tally.tried % 20 == 0:
                    sys.stderr.write(f"\r{name}: {tally.tried}")
        held = tally.tried - len(tally.gave_way)
        print(
            f"\r{name}: tried {tally.tried}, held {held}; "
            f"slowest {tally.slowest_s:.1f} s of processor: {tally.slowest}"
        )
        for what, how in tally.gave_way:
            print(f"  gave way: {what}: {how}")
        bad |= bool(tally.gave_way)
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
