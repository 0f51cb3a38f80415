"""Write the sixteen rooms that ship with the package; equal seeds give equal bytes.

python scripts/make_scenes.py --seed 29 --out karma/world/scenes
"""

import argparse
from pathlib import Path

from karma.files import to_json, write_atomic
from karma.offline import go_offline
from karma.world.core.scene import SCENES, check
from karma.world.generation.generate import build_scene
from karma.world.generation.rooms import rooms


def main() -> None:
    """Draw the rooms and write one JSON file each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=29)
    parser.add_argument("--out", type=Path, default=SCENES)
    parser.add_argument("--each", type=int, default=4, help="rooms of each kind")
    arguments = parser.parse_args()
    for kind in rooms().kinds:
        for number in range(1, arguments.each + 1):
            scene = build_scene(kind, number, arguments.seed)
            path = arguments.out / f"{scene.name}.json"
            check(scene, path)
            write_atomic(path, to_json(scene))
            print(f"{path}: {len(scene.objects)} objects, {len(scene.reachable)} cells")


if __name__ == "__main__":
    go_offline()
    main()
