"""How fast a room is drawn on one core, and what it costs: 300 x 300 colours, depth, instances.

    OMP_NUM_THREADS=1 taskset -c 0 python scripts/bench_render.py [DUMP [LAYOUTS]]

Takes the largest kitchen of an AI2-THOR dump, or of our own scenes without one. The agent walks
at random; every seventh action opens, closes, takes or drops something.
"""

import random
import sys
import time
from pathlib import Path

import numpy as np

from karma.offline import go_offline
from karma.world.core.scene import SCENES, Scene, load
from karma.world.importing.scenes import import_dump
from karma.world.render.colours import colour_table, instance_frame
from karma.world.render.picture import agent_camera, render
from karma.world.sim import EmbeddedWorld

STEPS = 600
WALK = ("MoveAhead", "MoveAhead", "MoveBack", "RotateLeft", "RotateRight", "LookDown", "LookUp")


def main() -> None:
    """Print one line for each figure."""
    scene = _largest(sys.argv[1:])
    draw(EmbeddedWorld(load("bathroom_1")))  # what all worlds share
    before = _megabytes()
    world = EmbeddedWorld(scene)
    start = time.perf_counter()
    draw(world)
    first = time.perf_counter() - start
    rng = random.Random(1)
    steps, pictures = [], []
    for number in range(STEPS):
        start = time.perf_counter()
        _handle(world, rng) if number % 7 == 6 else world.step(rng.choice(WALK))
        middle = time.perf_counter()
        draw(world)
        steps.append(middle - start)
        pictures.append(time.perf_counter() - middle)
    drawn = 1000 * np.array(pictures)
    out = sys.stdout.write
    out(f"scene       {scene.name}, {len(scene.objects)} objects\n")
    out(f"first       {first * 1000:.0f} ms, with all shapes\n")
    out(f"picture     {drawn.mean():.1f} ms (median {np.median(drawn):.1f}, ")
    out(f"p95 {np.quantile(drawn, 0.95):.1f})\n")
    out(f"step        {1000 * np.mean(steps):.2f} ms\n")
    out(f"frames/s    {STEPS / (sum(steps) + sum(pictures)):.1f}, steps included\n")
    out(f"memory      {_megabytes() - before:.1f} MB more than with one small room drawn\n")


def draw(world: EmbeddedWorld) -> None:
    """Draw what an event with colours, depth and instances has."""
    state = world.state
    picture = render(state, agent_camera(state), 300, 300)
    instance_frame(picture.rows, state.objects)
    colour_table(state.objects)


def _handle(world: EmbeddedWorld, rng: random.Random) -> None:
    state = world.state
    if state.held is not None:
        world.step("DropHeldObject", forceAction=True)
        return
    kind = rng.choice(["pickupable", "openable"])
    chosen = rng.choice([i for i, one in state.objects.items() if kind in one.capabilities])
    if kind == "pickupable":
        world.step("PickupObject", objectId=chosen, forceAction=True)
    else:
        action = "CloseObject" if state.objects[chosen].openness else "OpenObject"
        world.step(action, objectId=chosen, forceAction=True)


def _largest(paths: list[str]) -> Scene:
    if paths:
        scenes = list(import_dump(paths[0], layouts=paths[1] if len(paths) > 1 else None))
    else:
        scenes = [load(path.stem) for path in sorted(SCENES.glob("*.json"))]
    kitchens = [scene for scene in scenes if scene.room == "Kitchen"]
    return max(kitchens, key=lambda scene: len(scene.objects))


def _megabytes() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


if __name__ == "__main__":
    go_offline()
    main()
