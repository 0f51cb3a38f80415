"""Speed and memory of the world, against references that do the minimum, in the same run.

python scripts/bench_world.py [--steps N] [--frame-count N] [--dumps FILE] [--layouts FILE]

References: a plain dict that moves an agent and has no metadata, and a bare player that answers
AI2-THOR's client at once with one constant frame (scripts/echo_player.py). The rooms are the
middle and the largest of the kitchens imported from a dump; ours without one.
"""

import json
import os
import random
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"  # one core, before numpy is imported

import typer
from measuring import resident_mb, table, taken

from karma.files import to_json
from karma.offline.children import forking, starting
from karma.offline.guard import go_offline
from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.plugins.thor_tools.player import command
from karma.world.core import scene as scenes
from karma.world.core.scene import Scene
from karma.world.sim import EmbeddedWorld

SHARED = Path(os.environ.get("KARMA_SHARED", Path(__file__).parents[2] / "shared")) / "data"
WALK = ("MoveAhead", "MoveAhead", "MoveAhead", "RotateRight", "RotateLeft", "LookDown", "LookUp")
HANDLE = ("PickupObject", "PutObject", "OpenObject", "CloseObject", "ToggleObjectOn", "SliceObject")
IMAGES = {"renderDepthImage": True, "renderInstanceSegmentation": True}
Action = dict[str, Any]
Row = Sequence[object]  # what, measured, unit, of the reference, aim


def walking(steps: int, seed: int = 0) -> list[Action]:
    """Return the steps of somebody who walks and looks around."""
    draw = random.Random(seed)
    return [{"action": draw.choice(WALK)} for _ in range(steps)]


def working(room: Scene, steps: int, seed: int = 0) -> list[Action]:
    """Return the steps of somebody who walks, and handles things every fifth step."""
    draw, ids = random.Random(seed), [thing.id for thing in room.objects]
    return [
        one if draw.random() < 0.8 else
        {"action": draw.choice(HANDLE), "objectId": draw.choice(ids), "forceAction": True}
        for one in walking(steps, seed)
    ]  # fmt: skip


def rate(step: Callable[[Action], object], steps: Sequence[Action]) -> float:
    """Return steps per second."""
    return len(steps) / taken(lambda: [step(one) for one in steps], perf_counter)


def plain_dict() -> Callable[[Action], object]:
    """Return the least that can be called a world: an agent on a grid in a dict, no metadata."""
    agent = {"x": 0.0, "z": 0.0, "yaw": 0.0, "horizon": 0.0}

    def step(given: Action) -> Action:
        action = given["action"]
        if action == "MoveAhead":
            agent["z"] += 0.25
        elif action.startswith("Rotate"):
            agent["yaw"] = (agent["yaw"] + 90) % 360
        elif action.startswith("Look"):
            agent["horizon"] = 30 - agent["horizon"]
        return {"lastAction": action, "lastActionSuccess": True, "agent": dict(agent)}

    return step


def embedded(room: Scene, steps: int) -> Iterator[Row]:
    """Yield steps per second with full metadata and no images, from a fresh world each."""
    reference = rate(plain_dict(), walking(steps))
    yield "plain dict, no metadata", reference, "steps/s", None, ""
    ways = {"walking": walking(steps), "walking and handling": working(room, steps)}
    for name, todo in ways.items():
        world = EmbeddedWorld(room, renderImage=False)
        value = rate(lambda one, world=world: world.step(**one).metadata, todo)
        what = f"embedded, {name}, {room.name}, {len(room.objects)} objects"
        yield what, value, "steps/s", f"{value / reference:.3g} of plain dict", "≥ 5000"


def through_client(room: Scene, steps: int, folder: Path) -> Iterator[Row]:
    """Yield steps per second of a bare echo and of our player, without images."""
    os.environ["HOME"] = str(folder)  # the client keeps logs and locks there
    os.environ.pop("CUDA_VISIBLE_DEVICES", None)
    from ai2thor.controller import Controller

    (folder / f"{room.name}.json").write_bytes(to_json(room))
    metadata = folder / "metadata.txt"
    metadata.write_text(json.dumps(EmbeddedWorld(room).last_event.metadata))
    echo = f"{sys.executable} -P {Path(__file__).with_name('echo_player.py')} {metadata}"
    reference = None
    for name, executable in (("bare echo player", echo), ("player", command(folder))):
        client = Controller(
            local_executable_path=executable, scene=room.name, x_display=":0", server_timeout=30,
            renderImage=False,
        )  # fmt: skip
        try:
            value = rate(lambda one, at=client: at.step(**one).metadata, walking(steps))
        finally:
            client.stop()
        ratio = f"{value / reference:.3f} of bare echo player" if reference else None
        yield f"AI2-THOR's client, {name}, {room.name}", value, "steps/s", ratio, ""
        reference = value


def frames(room: Scene, count: int) -> Iterator[Row]:
    """Yield pictures per second: 300×300, RGB, depth and instance segmentation."""
    for name, todo in (("walking", walking(count)), ("and handling", working(room, count))):
        world = EmbeddedWorld(room, **IMAGES)

        def look(given: Action, world: EmbeddedWorld = world) -> None:
            event = world.step(**given)
            assert event.frame.shape == event.instance_segmentation_frame.shape == (300, 300, 3)
            assert event.depth_frame.shape == (300, 300)

        what = f"RGB + depth + instances, {name}, {room.name}"
        yield what, rate(look, todo), "frames/s", None, "≥ 40"


def resets(room: Scene, folder: Path) -> Iterator[Row]:
    """Yield the time of a reset, from a file and from a scene already read."""
    path = folder / "reset.json"
    path.write_bytes(to_json(room))
    world = EmbeddedWorld()
    for name, source in (("from its file", path), ("from memory", room)):
        worst = max(
            taken(lambda source=source: world.reset(source).metadata["objects"], perf_counter)
            for _ in range(10)
        )
        what = f"reset {room.name} {name}, with metadata"
        yield what, worst * 1e3, "ms, worst of 10", None, "≤ 50"


def grown(room: Scene, pipe: Any) -> None:
    """Send how many MB worlds take that have walked, handled and drawn, the first and each more."""
    assert EmbeddedWorld("bathroom_1", **IMAGES).last_event.instance_masks  # loads the libraries
    worlds, sizes = [], [resident_mb()]
    for number in range(5):
        worlds.append(EmbeddedWorld(room, **IMAGES))
        for index, one in enumerate(working(room, 1500, number)):
            event = worlds[-1].step(**one)
            assert event.metadata
            assert index % 10 or event.frame is not None
        sizes.append(resident_mb())
    pipe.send((sizes[1] - sizes[0], (sizes[-1] - sizes[1]) / (len(sizes) - 2)))


def memories(room: Scene) -> Iterator[Row]:
    """Yield MB of the first world, and of each one more; measured in a process of its own."""
    here, there = forking().Pipe()
    with starting():
        process = forking().Process(target=grown, args=(room, there))
        process.start()
    there.close()
    for name, value in zip(("the first world", "each one more (of 4)"), here.recv(), strict=True):
        yield f"memory above the libraries, {name}", value, "MB", None, "≤ 30"
    process.join()


def rooms(dumps: Path, layouts: Path) -> tuple[Scene, Scene]:
    """Return the kitchens with the middle and the largest number of objects."""
    if dumps.exists():
        found = list(import_dump(dumps, layouts=layouts if layouts.exists() else None))
    else:
        found = [scenes.load(path) for path in scenes.SCENES.glob("*.json")]
    kitchens = [one for one in found if one.room == "Kitchen"]
    kitchens.sort(key=lambda one: (len(one.objects), one.name))
    return kitchens[len(kitchens) // 2], kitchens[-1]


def main(
    steps: int = 5000,
    frame_count: int = 300,
    dumps: Path = SHARED / "thor5/scenes.jsonl.gz",
    layouts: Path = SHARED / "alfred/layouts.json.gz",
) -> None:
    """Print the table."""
    go_offline()
    middle, largest = rooms(dumps, layouts)

    def rows() -> Iterator[Row]:
        with tempfile.TemporaryDirectory() as name:
            yield from embedded(middle, steps)
            yield from embedded(largest, steps)
            yield from through_client(largest, steps, Path(name))
            yield from frames(largest, frame_count)
            yield from resets(largest, Path(name))
            yield from memories(largest)

    table("what | measured | unit | of the reference | aim", rows())


if __name__ == "__main__":
    typer.run(main)
