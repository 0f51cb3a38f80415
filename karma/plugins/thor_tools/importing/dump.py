"""Decode AI2-THOR metadata from files strictly; errors name the place."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec

from karma.errors import FileError
from karma.files import read_bytes, unpack
from karma.household.types import object_types
from karma.types.space import Vec3
from karma.world.core.boxes import Box
from karma.world.core.ground import Cell
from karma.world.core.scene import FARTHEST_M, AgentPose, Temperature

COPY = "copy the file again"
EXPORT = (
    "scripts/export_thor_scenes.py writes such files; ALFRED's trials: --alfred when importing, "
    "no --events when replaying"
)


Coordinate = Annotated[float, msgspec.Meta(ge=-FARTHEST_M, le=FARTHEST_M)]  # never NaN


class Xyz(msgspec.Struct, frozen=True):
    """A point, metres, or angles, degrees."""

    x: Coordinate
    y: Coordinate
    z: Coordinate

    @property
    def tuple(self) -> Vec3:
        """The three numbers."""
        return (self.x, self.y, self.z)


class _Box(msgspec.Struct, frozen=True):
    center: Xyz
    size: Xyz


class _Corners(msgspec.Struct, frozen=True, rename="camel"):
    corner_points: Annotated[tuple[Vec3, ...], msgspec.Meta(min_length=8, max_length=8)]


_ELSEWHERE = {  # fields that AI2-THOR has other words for
    "id": "objectId",
    "type": "objectType",
    "asset": "assetId",
    "mass_kg": "mass",
    "materials": "salientMaterials",
    "is_filled": "isFilledWithLiquid",
    "liquid": "fillLiquid",
}


def _camel(name: str) -> str:
    first, *words = name.split("_")
    return first + "".join(map(str.title, words))


class Seen(
    msgspec.Struct, frozen=True, kw_only=True, rename=lambda n: _ELSEWHERE.get(n, _camel(n))
):
    """One object of `metadata["objects"]`: the fields that a scene keeps, named as there."""

    name: str
    id: str
    type: str
    asset: str = ""
    position: Xyz
    rotation: Xyz
    distance: float | None = None  # from the agent's origin to the object's
    axis_aligned_bounding_box: _Box
    object_oriented_bounding_box: _Corners | None = None
    receptacle: bool
    receptacle_object_ids: tuple[str, ...] | None = None
    parent_receptacles: tuple[str, ...] | None = None
    pickupable: bool
    is_picked_up: bool = False
    moveable: bool
    mass_kg: float = 0.0
    materials: tuple[str, ...] | None = None
    openable: bool
    openness: float
    is_open: bool
    toggleable: bool
    is_toggled: bool
    controlled_objects: tuple[str, ...] | None = None
    breakable: bool
    is_broken: bool
    can_fill_with_liquid: bool
    is_filled: bool
    liquid: str | None = None
    dirtyable: bool
    is_dirty: bool
    can_be_used_up: bool
    is_used_up: bool
    cookable: bool
    is_cooked: bool
    temperature: Temperature
    is_heat_source: bool
    is_cold_source: bool
    sliceable: bool
    is_sliced: bool

    @property
    def fixed(self) -> bool:
        """Whether it can neither be carried nor pushed."""
        return not (self.pickupable or self.moveable)

    @property
    def box(self) -> Box:
        """Its axis-aligned box."""
        shape = self.axis_aligned_bounding_box
        return Box.around(shape.center.tuple, shape.size.tuple)


def read_unzipped(path: str | Path) -> bytes:
    """Return a file's bytes, unpacked where it is gzipped.

    Raises:
        FileError: missing, or torn.
    """
    data = read_bytes(path, fix=f"ls {Path(path).parent}")
    if data[:2] != b"\x1f\x8b" and Path(path).suffix != ".gz":
        return data
    return unpack(data, path=path, fix=COPY)


def rows(path: Path) -> Iterator[tuple[str, Any]]:
    """Yield (where, JSON value): one per line, or one per element of a lone array.

    Metadata of an event comes in the form of an export; after GetReachablePositions with its cells.

    Raises:
        FileError: unreadable, torn, not JSON, or nothing in it.
    """
    data = read_unzipped(path)
    if data.strip() in (b"", b"[]"):
        raise FileError(path, "line 1: the file is empty", fix=COPY)
    try:
        whole = json.loads(data)
    except (ValueError, RecursionError):
        lines = data.splitlines()
    else:
        many = whole if isinstance(whole, list) else [whole]
        if all(isinstance(one, dict) and "objectId" in one for one in many):
            reason = "objects alone: the scene's name and its cells are missing"
            raise FileError(path, reason, fix=EXPORT)
        yield from ((f"scene {number}", _as_export(row)) for number, row in enumerate(many, 1))
        return
    for number, line in enumerate(lines, 1):
        if line.strip():
            try:
                row = json.loads(line)
            except (ValueError, RecursionError) as error:
                raise FileError(path, f"line {number}: not JSON: {error}", fix=COPY) from error
            yield f"line {number}", _as_export(row)


def _as_export(row: Any) -> Any:
    """Return a row in an export's form, where it is metadata of an event as AI2-THOR has it."""
    alone = isinstance(row, dict) and row.keys() == {"metadata"}  # recordings have an action, too
    row = row["metadata"] if alone else row
    if not isinstance(row, dict) or "scene" in row or "sceneName" not in row:
        return row
    name = str(row["sceneName"]).removesuffix("_physics")
    cells = row.get("actionReturn") if row.get("lastAction") == "GetReachablePositions" else None
    kept = {key: row[key] for key in ("objects", "agent") if key in row}
    return {**kept, "scene": name, **({"reachable": cells} if cells else {})}


def named(row: Any, path: str | Path, place: str) -> tuple[str, list[Any]]:
    """Return a row's scene name and objects, or raise FileError with the place and the key."""
    if not isinstance(row, dict):
        reason = f"{place}: expected an object with `scene` and `objects`"
        raise FileError(path, reason, fix=EXPORT)
    for key, kind in (("scene", str), ("objects", list)):
        if not isinstance(row.get(key), kind):
            word = "missing" if key not in row else f"not a {kind.__name__}"
            raise FileError(path, f"{place}: `{key}` is {word}", fix=EXPORT)
    return row["scene"], row["objects"]


class AgentStance(msgspec.Struct, frozen=True, rename="camel"):
    """The agent of an event's metadata."""

    position: Xyz
    rotation: Xyz
    camera_horizon: float
    is_standing: bool | None = None


class _Stance(msgspec.Struct, frozen=True):
    """What an export of ours tells besides the objects."""

    agent: AgentStance | None = None
    reachable: tuple[Xyz, ...] = ()


def stance(row: Any, path: str | Path, place: str) -> tuple[AgentPose | None, tuple[Cell, ...]]:
    """Return a row's agent and the cells it can reach, where it has them.

    Raises:
        FileError: they have another form than AI2-THOR's; says where.
    """
    try:
        found = msgspec.convert(row, _Stance)
    except msgspec.ValidationError as error:
        raise FileError(path, f"{place}: {error}", fix=EXPORT) from error
    cells = tuple(sorted((cell.x, cell.z) for cell in found.reachable))
    if found.agent is None:
        return None, cells
    one = found.agent
    yaw, horizon = one.rotation.y % 360, one.camera_horizon + 0.0
    return AgentPose(position=one.position.tuple, yaw=yaw, horizon=horizon), cells


class _Cells(msgspec.Struct, frozen=True):
    reachable: tuple[Cell, ...]


def read_layouts(path: str | Path) -> dict[str, tuple[Cell, ...]]:
    """Read ALFRED's cells by scene name.

    Raises:
        FileError: torn or of the wrong form.
    """
    data = read_unzipped(path)
    try:
        table = msgspec.json.decode(data, type=dict[str, _Cells])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileError(path, str(error), fix="--layouts none goes without") from error
    return {name: row.reachable for name, row in table.items()}


def seen_object(scene_name: str, index: int, row: Mapping[str, Any]) -> Seen:
    """Decode one object.

    Raises:
        FileError: a field is missing or wrong, or the type unknown; names object and field.
    """
    label = row.get("objectId", index) if isinstance(row, Mapping) else index
    try:
        one = msgspec.convert(row, Seen)
    except msgspec.ValidationError as error:
        raise FileError(scene_name, f"object {label!r}: {error}", fix=EXPORT) from error
    if one.type not in object_types():
        reason = f"object {label!r}: unknown objectType {one.type!r}"
        raise FileError(scene_name, reason)
    if min(one.axis_aligned_bounding_box.size.tuple) < 0:
        raise FileError(scene_name, f"object {label!r}: its box has a size below 0")
    return one
