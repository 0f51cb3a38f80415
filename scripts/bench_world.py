"""Speed and memory of the world, against references that do the minimum, in the same run.

python scripts/bench_world.py [--steps N] [--dumps FILE] [--layouts FILE] [--json OUT]

References: a plain dict that moves an agent and has no metadata, and a bare player that answers
AI2-THOR's client at once with one constant frame (scripts/echo_player.py). The rooms are the
middle and the largest of the kitchens imported from a dump; ours without one.
"""

import argparse
import json
import os
import random
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"  # one core, before numpy is imported

from rich.console import Console
from rich.table import Table

from karma.children import forking, starting
from karma.files import to_json, write_atomic
from karma.offline import go_offline
from karma.world.core import scene as scenes
from karma.world.core.scene import Scene
from karma.world.importing.scenes import import_dump
from karma.world.sim import EmbeddedWorld

SHARED = Path(os.environ.get("KARMA_SHARED", Path(__file__).parents[2] / "shared")) / "data"
WALK = ("MoveAhead", "MoveAhead", "MoveAhead", "RotateRight", "RotateLeft", "LookDown", "LookUp")
HANDLE = ("PickupObject", "PutObject", "OpenObject", "CloseObject", "ToggleObjectOn", "SliceObject")
IMAGES = {"renderDepthImage": True, "renderInstanceSegmentation": True}
Step = Callable[[dict[str, Any]], Any]


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One line of the table."""

    what: str
    value: float
    unit: str
    against: str = ""  # the reference that `ratio` compares with
    ratio: float | None = None
    aim: str = ""


# ----------------------------------------------------------------- what is done


def walking(draw: random.Random) -> dict[str, Any]:
    """Return a step of somebody who walks and looks around."""
    return {"action": draw.choice(WALK)}


def working(draw: random.Random, ids: list[str]) -> dict[str, Any]:
    """Return a step of somebody who walks, and handles things every fifth step."""
    if draw.random() < 0.8:
        return walking(draw)
    return {"action": draw.choice(HANDLE), "objectId": draw.choice(ids), "forceAction": True}


def rate(step: Step, steps: list[dict[str, Any]]) -> float:
    """Return steps per second."""
    start = perf_counter()
    for action in steps:
        step(action)
    return len(steps) / (perf_counter() - start)


class PlainWorld:
    """The least that can be called a world: an agent on a grid in a dict, no metadata."""

    def __init__(self) -> None:
        self.agent = {"x": 0.0, "z": 0.0, "yaw": 0.0, "horizon": 0.0}

    def step(self, action: str, **arguments: Any) -> dict[str, Any]:
        """Do one step."""
        agent = self.agent
        if action == "MoveAhead":
            agent["z"] += 0.25
        elif action.startswith("Rotate"):
            agent["yaw"] = (agent["yaw"] + 90) % 360
        elif action.startswith("Look"):
            agent["horizon"] = 30 - agent["horizon"]
        return {"lastAction": action, "lastActionSuccess": True, "agent": dict(agent)}


# ----------------------------------------------------------------- in process


def embedded(room: Scene, steps: int, seed: int) -> Iterator[Figure]:
    """Yield steps per second with full metadata and no images, from a fresh world each."""
    draw = random.Random(seed)
    plain = PlainWorld()
    walk = [walking(draw) for _ in range(steps)]
    reference = rate(lambda given: plain.step(**given), walk)
    yield Figure(what="plain dict, no metadata", value=reference, unit="steps/s")
    ids = [thing.id for thing in room.objects]
    work = [working(draw, ids) for _ in range(steps)]
    for name, todo in (("walking", walk), ("walking and handling", work)):
        world = EmbeddedWorld(room, renderImage=False)
        value = rate(lambda given, world=world: world.step(**given).metadata, todo)  # type: ignore[misc]
        yield Figure(
            what=f"embedded, {name}, {room.name}, {len(room.objects)} objects",
            value=value,
            unit="steps/s",
            against="plain dict",
            ratio=value / reference,
            aim="≥ 5000",
        )


def frames(room: Scene, count: int, seed: int) -> Iterator[Figure]:
    """Yield pictures per second: 300×300, RGB, depth and instance segmentation."""
    for name in ("walking", "walking and handling"):
        draw = random.Random(seed)
        world = EmbeddedWorld(room, **IMAGES)
        ids = [thing.id for thing in room.objects]

        def look(given: dict[str, Any], world: EmbeddedWorld = world) -> None:
            event = world.step(**given)
            assert event.frame.shape == event.instance_segmentation_frame.shape == (300, 300, 3)
            assert event.depth_frame.shape == (300, 300)

        todo = [walking(draw) if name == "walking" else working(draw, ids) for _ in range(count)]
        value = rate(look, todo)
        yield Figure(
            what=f"RGB + depth + instances, {name}, {room.name}",
            value=value,
            unit="frames/s",
            aim="≥ 40",
        )


def resets(room: Scene) -> Iterator[Figure]:
    """Yield the time of a reset, from a file and from a scene already read."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{room.name}.json"
        path.write_bytes(to_json(room))
        world = EmbeddedWorld()
        for name, source in (("from its file", path), ("from memory", room)):
            times = []
            for _ in range(10):
                start = perf_counter()
                assert world.reset(source).metadata["objects"]
                times.append(perf_counter() - start)
            what = f"reset {room.name} {name}, with metadata"
            yield Figure(what=what, value=max(times) * 1e3, unit="ms, worst of 10", aim="≤ 50")


def memory(room: Scene, pipe: Any) -> None:
    """Send how many MB worlds take that have walked, handled and drawn (in a process of its own).

    A small room has been drawn before, so that the libraries are loaded and their buffers there.
    """
    assert EmbeddedWorld("bathroom_1", **IMAGES).last_event.instance_masks
    worlds: list[EmbeddedWorld] = []
    ids = [thing.id for thing in room.objects]
    sizes = [_resident_mb()]
    for number in range(5):
        draw = random.Random(number)
        world = EmbeddedWorld(room, **IMAGES)
        for index in range(1500):
            event = world.step(**working(draw, ids))
            assert event.metadata
            if index % 10 == 0:
                assert event.frame is not None
        worlds.append(world)
        sizes.append(_resident_mb())
    pipe.send((sizes[1] - sizes[0], (sizes[-1] - sizes[1]) / (len(sizes) - 2)))


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def memories(room: Scene) -> Iterator[Figure]:
    """Yield MB of the first world, and of each one more."""
    context = forking()
    here, there = context.Pipe()
    process = context.Process(target=memory, args=(room, there))
    with starting():
        process.start()
    there.close()
    names = ("the first world", "each one more (of 4)")
    for name, value in zip(names, here.recv(), strict=True):
        yield Figure(what=f"memory above the libraries, {name}", value=value, unit="MB", aim="≤ 30")
    process.join()


# ----------------------------------------------------------------- through AI2-THOR's client


@contextmanager
def client(command: str, room: str, folder: Path) -> Iterator[Any]:
    """Yield AI2-THOR's Controller driving an executable."""
    os.environ["HOME"] = str(folder)  # the client keeps logs and locks there
    os.environ.pop("CUDA_VISIBLE_DEVICES", None)
    from ai2thor.controller import Controller

    controller = Controller(
        local_executable_path=command, scene=room, x_display=":0", server_timeout=30,
        renderImage=False,
    )  # fmt: skip
    try:
        yield controller
    finally:
        controller.stop()


def through_client(room: Scene, steps: int, seed: int, folder: Path) -> Iterator[Figure]:
    """Yield steps per second of a bare echo and of our player, without images."""
    from karma.world.player.launch import command

    (folder / f"{room.name}.json").write_bytes(to_json(room))
    metadata = folder / "metadata.txt"
    metadata.write_text(json.dumps(EmbeddedWorld(room).last_event.metadata))
    draw = random.Random(seed)
    walk = [walking(draw) for _ in range(steps)]
    echo = f"{sys.executable} {Path(__file__).with_name('echo_player.py')} {metadata}"
    reference = 0.0
    for name, text in (("bare echo player", echo), ("player", command(folder))):
        with client(text, room.name, folder) as controller:
            value = rate(lambda given, at=controller: at.step(**given).metadata, walk)  # type: ignore[misc]
        yield Figure(
            what=f"AI2-THOR's client, {name}, {room.name}",
            value=value,
            unit="steps/s",
            against="bare echo player" if reference else "",
            ratio=value / reference if reference else None,
        )
        reference = reference or value


# ----------------------------------------------------------------- the table


def rooms(dumps: Path, layouts: Path) -> tuple[Scene, Scene]:
    """Return the kitchens with the middle and the largest number of objects."""
    if dumps.exists():
        cells = layouts if layouts.exists() else None
        found = [one for one in import_dump(dumps, layouts=cells) if one.room == "Kitchen"]
    else:
        paths = sorted(scenes.SCENES.glob("kitchen_*.json"))
        found = [scenes.load(path) for path in paths]
    found.sort(key=lambda one: (len(one.objects), one.name))
    return found[len(found) // 2], found[-1]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dumps", type=Path, default=SHARED / "thor5/scenes.jsonl.gz")
    parser.add_argument("--layouts", type=Path, default=SHARED / "alfred/layouts.json.gz")
    parser.add_argument("--json", type=Path, default=None)
    options = parser.parse_args()
    middle, largest = rooms(options.dumps, options.layouts)
    figures: list[Figure] = []
    console = Console(width=None if sys.stdout.isatty() else 120)
    with console.status("measuring ..."), tempfile.TemporaryDirectory() as folder:
        for room in (middle, largest):
            figures += embedded(room, options.steps, options.seed)
        figures += through_client(largest, options.steps, options.seed, Path(folder))
        figures += frames(largest, options.frames, options.seed)
        figures += resets(largest)
        figures += memories(largest)
    table = Table("what", "measured", "unit", "of the reference", "aim")
    for one in figures:
        ratio = "–" if one.ratio is None else f"{one.ratio:.3f} of {one.against}"
        table.add_row(one.what, f"{one.value:,.1f}", one.unit, ratio, one.aim)
    console.print(table)
    if options.json is not None:
        write_atomic(options.json, to_json(figures, indent=2))


if __name__ == "__main__":
    go_offline()
    main()
