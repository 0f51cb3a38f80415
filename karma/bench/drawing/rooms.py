"""Rooms to draw training examples from: generated ones and imported floor plans."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from karma.bench.drawing.memories import KnownRoom
from karma.contracts import SeenObject
from karma.household.pieces import base_type
from karma.household.places import ROOMS
from karma.memory.scene_graph import SceneGraph
from karma.seeds import stream
from karma.world.core.scene import Scene
from karma.world.generation.generate import build_scene
from karma.world.importing.scenes import import_dump

KITCHEN_SHARE = 3  # kitchens per room of another kind, as most requests are about kitchens
AUTHORS_PLANS = frozenset({1, 11, 14, 16, 19, 22, 23, 27, 28, 201, 203, 207, 224, 314, 417, 422})


def room_of(scene: Scene, name: str, *, keep: float = 0.93, seed: int = 0) -> KnownRoom:
    """Return what an agent that explored the scene knows of it, a few things overlooked.

    Args:
        scene: the room.
        name: of the result; names the random stream.
        keep: chance that an immovable thing was noticed.
        seed: of the run.
    """
    rng = stream(seed, "rooms", name)
    graph = SceneGraph.over(scene.reachable, height_m=scene.floor_y, cell_m=scene.grid_m)
    graph.observe(
        SeenObject(
            object_id=thing.id,
            object_type=thing.type,
            position_m=thing.position,
            box_center_m=thing.center,
            box_size_m=thing.size,
            pickupable=False,
        )
        for thing in scene.objects
        if "pickupable" not in thing.capabilities and rng.random() < keep
    )
    movables = Counter(
        base_type(thing.type) for thing in scene.objects if "pickupable" in thing.capabilities
    )
    return KnownRoom(
        name=name,
        areas=graph.areas(),
        movables=tuple(sorted(movables)),
        several=tuple(sorted(kind for kind, count in movables.items() if count > 1)),
    )


def generated_rooms(count: int, seed: int) -> Iterator[KnownRoom]:
    """Yield rooms of the generator, none of them a shipped scene (their seeds differ)."""
    order = [ROOMS[0]] * KITCHEN_SHARE + list(ROOMS[1:])
    for number in range(count):
        kind = order[number % len(order)]
        scene = build_scene(kind, 1000 + number, seed)
        yield room_of(scene, f"generated/{seed}/{number}", seed=seed)


def imported_rooms(dumps: Path, layouts: Path | None, seed: int) -> Iterator[KnownRoom]:
    """Yield AI2-THOR's floor plans, without those of the authors' tasks."""
    for scene in import_dump(dumps, layouts=layouts):
        if not is_authors_plan(scene.name):
            yield room_of(scene, scene.name, seed=seed)


def is_authors_plan(name: str) -> bool:
    """Return whether a floor plan is one of the authors' tasks, which no training sees."""
    return int(name.removeprefix("FloorPlan").split("_")[0]) in AUTHORS_PLANS
