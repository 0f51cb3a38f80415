"""Write the sixteen rooms that ship with the package; equal seeds give equal bytes.

python scripts/make_scenes.py --seed 29 --out karma/world/scenes
"""

from pathlib import Path

import typer

from karma.files import to_json, write_atomic
from karma.offline.guard import go_offline
from karma.plugins.rooms.generate import build_scene
from karma.plugins.rooms.rooms import rooms
from karma.world.core.scene import SCENES, check


def main(seed: int = 29, out: Path = SCENES, each: int = 4) -> None:
    """Draw so many rooms of each kind and write one JSON file each."""
    go_offline()
    for kind in rooms().kinds:
        for number in range(1, each + 1):
            scene = build_scene(kind, number, seed)
            path = out / f"{scene.name}.json"
            check(scene, path)
            write_atomic(path, to_json(scene))
            print(f"{path}: {len(scene.objects)} objects, {len(scene.reachable)} cells")


if __name__ == "__main__":
    typer.run(main)
