"""Read a room from a file: objects with boxes, containment and states, and cells to stand on.

A scene file is one JSON object of `Scene`; the running world keeps the same records and replaces
them (they are frozen), so a snapshot of the world is a scene again.
"""

from contextlib import suppress
from pathlib import Path
from typing import Literal

import msgspec

from karma.contracts import Vec3
from karma.errors import FileError
from karma.files import read_json
from karma.household.types import Capability, RoomType, RuleSet, object_types

Temperature = Literal["RoomTemp", "Hot", "Cold"]


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
    inferred: bool = False  # no record of the room shows it; another object's id tells of it


class AgentPose(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The agent's start: position is its origin (about 0.9 m above the floor)."""

    position: Vec3
    yaw: float = 0.0
    horizon: float = 0.0


class Scene(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One room at reset."""

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
    reason = f"no scene named {str(name)!r}, and no file *.json of a scene"
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
    """Raise FileError unless types exist, ids and names are unique, and parents without loops."""
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


def _refuse_loops(by_id: dict[str, SceneObject], path: str | Path) -> None:
    """Raise FileError if something lies in itself, through however many others."""
    safe: set[str] = set()
    for start in by_id:
        chain, stack = {start}, [iter(by_id[start].parents)]
        order = [start]
        while stack:
            parent = next(stack[-1], None)
            if parent is None:
                stack.pop()
                done = order.pop()
                chain.discard(done)
                safe.add(done)
            elif parent in chain:
                raise FileError(path, f"{start!r} and {parent!r} contain each other")
            elif parent not in safe:
                chain.add(parent)
                order.append(parent)
                stack.append(iter(by_id[parent].parents))
