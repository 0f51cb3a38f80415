"""Read a room from a file: objects with boxes, containment and states, and cells to stand on.

A scene file is one JSON object of `Scene`; the running world keeps the same records and replaces
them (they are frozen), so a snapshot of the world is a scene again.
"""

from contextlib import suppress
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from karma.errors import FileError, did_you_mean
from karma.files import read_json
from karma.household.types import Capability, RoomType, RuleSet, object_types
from karma.types.space import Vec3

Temperature = Literal["RoomTemp", "Hot", "Cold"]

FARTHEST_M = 1000.0  # of anything, from the origin; houses are a hundredth of that
LARGEST_M = 200.0  # a room's or a thing's side
Coordinate = Annotated[float, msgspec.Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
Side = Annotated[float, msgspec.Meta(ge=0.0, le=LARGEST_M)]
Position = tuple[Coordinate, Coordinate, Coordinate]
Size = tuple[Side, Side, Side]


class SceneObject(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
):
    """One object: identity, geometry (metres, degrees), what it can do and the state it is in."""

    id: str  # `Type|x|y|z` of the initial position; never changes
    type: str
    name: str  # unique in the scene
    asset: str = ""
    position: Position
    rotation: Vec3 = (0.0, 0.0, 0.0)
    center: Position  # of the axis-aligned box
    size: Size
    corners: tuple[Position, ...] | None = (
        None  # 8 of the oriented box; None = the axis-aligned one
    )
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

    position: Position
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
    floor_y: Coordinate = 0.0
    grid_m: Annotated[float, msgspec.Meta(ge=0.01, le=5.0)] = 0.25
    agent: AgentPose
    reachable: tuple[tuple[Coordinate, Coordinate], ...]  # (x, z) cells, sorted
    bounds_center: Position
    bounds_size: Size
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
    """Raise FileError unless types exist, ids and names are unique, and parents are no loops."""
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
    try:
        TopologicalSorter({thing.id: thing.parents for thing in scene.objects}).prepare()
    except CycleError as error:
        first, second = error.args[1][:2]
        raise FileError(path, f"{first!r} and {second!r} contain each other") from error
