"""Read a room from a file: objects with boxes, containment and states, and cells to stand on.

A scene file is one JSON object of `Scene`; the running world keeps the same records and replaces
them (they are frozen), so a snapshot of the world is a scene again.
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter
from itertools import chain
from pathlib import Path
from typing import Literal

import msgspec

from karma.errors import FileError, did_you_mean
from karma.files import read_json
from karma.household.types import Capability, RoomType, RuleSet, object_types
from karma.types.space import Vec3

Temperature = Literal["RoomTemp", "Hot", "Cold"]

FARTHEST_M = 1000.0  # of anything, from the origin; houses are a hundredth of that
LARGEST_M = 200.0  # a room's or a thing's side
GRIDS_M = (0.01, 5.0)
MOST_OBJECTS, MOST_CELLS, MOST_NESTED = 5_000, 100_000, 50  # a room of 5.0.0's has 100, 500 and 4


class SceneObject(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
):
    """One object: identity, geometry (metres, degrees), what it can do and the state it is in."""

    id: str  # `Type|x|y|z` of the initial position; never changes
    type: str
    name: str  # unique in the scene
    asset: str = ""
    position: Vec3
    rotation: Vec3 = (0.0, 0.0, 0.0)
    center: Vec3  # of the axis-aligned box
    size: Vec3
    corners: tuple[Vec3, ...] | None = None  # 8 of the oriented box; None = the axis-aligned one
    capabilities: tuple[Capability, ...] = ()
    mass_kg: float = 0.0
    materials: tuple[str, ...] | None = None
    parents: tuple[str, ...] = ()  # ids of receptacles, several possible, the nearest first
    controls: tuple[str, ...] = ()  # a StoveKnob's burner, a LightSwitch's lamps
    openness: float = 0.0  # in [0, 1]; open when > 0
    is_toggled: bool = False
    is_broken: bool = False
    is_filled: bool = False
    liquid: str | None = None
    is_dirty: bool = False
    is_used_up: bool = False
    is_cooked: bool = False
    is_sliced: bool = False
    is_picked_up: bool = False
    temperature: Temperature = "RoomTemp"
    heat_left_s: float = 0.0  # until Hot or Cold returns to RoomTemp
    is_falling: bool = False  # it has slipped through its basin
    inferred: bool = False  # no record of the room shows it; another object's id tells of it


class AgentPose(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The agent's start: position is its origin (about 0.9 m above the floor)."""

    position: Vec3
    yaw: float = 0.0
    horizon: float = 0.0


class SceneRoom(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One room of a scene that has several."""

    name: str  # "kitchen_1"
    room: RoomType
    corners: tuple[tuple[float, float], ...]  # (x, z) of its floor, in order


class Wall(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A box that hides what is behind it; doorways are gaps between walls."""

    low: Vec3
    high: Vec3


class Scene(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One room at reset, or a home of several."""

    version: Literal[1] = 1
    name: str
    room: RoomType
    source: str  # where it comes from, e.g. "scripts/make_scenes.py seed 7"
    rules: RuleSet | msgspec.UnsetType = msgspec.UNSET  # say what goes into what; unset = 5.0.0's
    floor_y: float = 0.0
    grid_m: float = 0.25
    agent: AgentPose
    reachable: tuple[tuple[float, float], ...]  # (x, z) cells, sorted
    bounds_center: Vec3
    bounds_size: Vec3
    objects: tuple[SceneObject, ...]
    rooms: tuple[SceneRoom, ...] | msgspec.UnsetType = msgspec.UNSET  # unset: it is one room
    walls: tuple[Wall, ...] | msgspec.UnsetType = msgspec.UNSET  # between rooms


SCENES = Path(__file__).parents[1] / "scenes"


def find(name: str | Path) -> Path:
    """Return the path of a scene given by name (ours) or by path.

    Raises:
        FileError: there is no such scene.
    """
    for path in (Path(name), SCENES / f"{name}.json"):
        with suppress(OSError, ValueError):  # too long for a path, or no path at all
            if path.suffix == ".json" and path.exists():
                return path
    hint = did_you_mean(str(name), (path.stem for path in SCENES.glob("*.json")))
    reason = f"no scene named {str(name)!r}, and no file *.json of a scene.{hint}"
    raise FileError(name, reason, fix="karma world list")


def load(name: str | Path) -> Scene:
    """Read and check one scene.

    Raises:
        FileError: missing, torn, or inconsistent; names the object and the rule it breaks.
    """
    path = find(name)
    scene = read_json(path, Scene, fix="write it again: karma world import, or make_scenes.py")
    check(scene, path)
    return scene


def check(scene: Scene, path: str | Path) -> None:
    """Raise FileError unless sizes make sense, types exist, names are unique, parents no loops."""
    if reason := _senseless(scene):
        raise FileError(path, reason)
    by_id: dict[str, SceneObject] = {}
    for thing in scene.objects:
        if thing.type not in object_types():
            raise FileError(path, f"{thing.id!r}: unknown object type {thing.type!r}")
        if thing.id in by_id:
            raise FileError(path, f"object id {thing.id!r} stands twice")
        by_id[thing.id] = thing
    if len({thing.name for thing in scene.objects}) != len(scene.objects):
        raise FileError(path, "object names are not unique")
    for thing in scene.objects:
        for parent in thing.parents:
            if parent not in by_id:
                raise FileError(path, f"{thing.id!r} lies in {parent!r}, which is not in the scene")
    _refuse_loops(by_id, path)


def _senseless(scene: Scene) -> str:
    """Return which number is none that a room has, before anything is computed from it."""
    for what, count, most in (
        ("objects", len(scene.objects), MOST_OBJECTS),
        ("reachable cells", len(scene.reachable), MOST_CELLS),
    ):
        if count > most:
            return f"{count} {what} are too many; {most} at most"
    if not GRIDS_M[0] <= scene.grid_m <= GRIDS_M[1]:
        return f"grid_m: {scene.grid_m:g} is not within {GRIDS_M[0]:g} and {GRIDS_M[1]:g} m"
    for where, values, most_m in _lengths(scene):
        if not all(-most_m <= value <= most_m for value in values):
            return f"{where}: farther or larger than {most_m:g} m"
    sizes = {"bounds_size": scene.bounds_size, **{one.id: one.size for one in scene.objects}}
    if shrunk := next((where for where, size in sizes.items() if min(size) < 0), ""):
        return f"{shrunk}: a size below 0"
    return ""


def _lengths(scene: Scene) -> Iterator[tuple[str, Iterable[float], float]]:
    """Yield all lengths of a scene: where they stand, what they are, how much they may be."""
    yield "agent", scene.agent.position, FARTHEST_M
    yield "floor_y", (scene.floor_y,), FARTHEST_M
    yield "reachable", chain.from_iterable(scene.reachable), FARTHEST_M
    yield "bounds_center", scene.bounds_center, FARTHEST_M
    yield "bounds_size", scene.bounds_size, LARGEST_M
    for thing in scene.objects:
        yield f"{thing.id!r}", (*thing.position, *thing.center), FARTHEST_M
        yield f"{thing.id!r}", thing.size, LARGEST_M
        yield f"{thing.id!r}", chain.from_iterable(thing.corners or ()), FARTHEST_M


def _refuse_loops(by_id: dict[str, SceneObject], path: str | Path) -> None:
    """Raise FileError if something lies in itself, or too deep, through however many others."""
    sorter = TopologicalSorter({thing.id: thing.parents for thing in by_id.values()})
    depth: dict[str, int] = {}
    try:
        for one in sorter.static_order():  # what holds others comes first
            depth[one] = 1 + max((depth[parent] for parent in by_id[one].parents), default=0)
            if depth[one] > MOST_NESTED:
                raise FileError(path, f"{one!r}: more than {MOST_NESTED} lie in one another")
    except CycleError as error:
        first, second = error.args[1][:2]
        raise FileError(path, f"{first!r} and {second!r} contain each other") from error
