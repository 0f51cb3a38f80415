"""Count where our generator puts things, for the baselines that know what lies where.

`python scripts/make_likely_places.py --seed 501 --each 60 --out FILE`, where FILE is
karma/methods/capeam/likely_places.toml.
"""

import argparse
from collections import Counter
from pathlib import Path

from karma.files import write_atomic
from karma.methods.capeam.prior import count_places, to_toml
from karma.offline import go_offline
from karma.world.generation.generate import build_scene
from karma.world.generation.rooms import rooms


def main() -> None:
    """Draw rooms that are in no task, and write the shares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=501)
    parser.add_argument("--each", type=int, default=60, help="rooms of each kind")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    counts: dict[str, Counter[str]] = {}
    for kind in rooms().kinds:
        for number in range(1, arguments.each + 1):
            count_places(build_scene(kind, 1000 + number, arguments.seed), counts)
    write_atomic(arguments.out, to_toml(counts).encode())
    print(f"{arguments.out}: places of {len(counts)} types")


if __name__ == "__main__":
    go_offline()
    main()
