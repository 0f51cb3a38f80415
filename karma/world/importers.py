"""AI2-THOR metadata dumps into scenes: what the genuine simulator reported at reset."""

import gzip
import json
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec

from karma.contracts import Vec3
from karma.errors import FileError
from karma.files import read_bytes
from karma.world.boxes import Box, Cell, nearest_to_centre, reachable_cells
from karma.world.scene import (
    AgentPose,
    Capability,
    RoomType,
    Scene,
    SceneObject,
    Temperature,
    check,
)
from karma.world.types import object_types

ORIGIN_M = 0.9  # the agent's origin above the floor
FLAGS: tuple[Capability, ...] = Capability.__args__  # type: ignore[attr-defined]
ROOMS: tuple[RoomType, ...] = ("Kitchen", "LivingRoom", "Bedroom", "Bathroom")  # by hundreds
ROOM_OF_HUNDRED = {0: 0, 2: 1, 3: 2, 4: 3}


class _Vector(msgspec.Struct, frozen=True):
    x: float
    y: float
    z: float

    @property
    def tuple(self) -> Vec3:
        return (self.x, self.y, self.z)


class _Box(msgspec.Struct, frozen=True):
    center: _Vector
    size: _Vector


class _Corners(msgspec.Struct, frozen=True, rename="camel"):
    corner_points: Annotated[tuple[Vec3, ...], msgspec.Meta(min_length=8, max_length=8)]


class _Seen(msgspec.Struct, frozen=True, kw_only=True, rename="camel"):
    """One object of `metadata["objects"]`: the fields that a scene keeps."""

    name: str
    object_id: str
    object_type: str
    asset_id: str = ""
    position: _Vector
    rotation: _Vector
    axis_aligned_bounding_box: _Box
    object_oriented_bounding_box: _Corners | None = None
    receptacle: bool
    receptacle_object_ids: tuple[str, ...] | None = None
    parent_receptacles: tuple[str, ...] | None = None
    pickupable: bool
    is_picked_up: bool = False
    moveable: bool
    mass: float = 0.0
    salient_materials: tuple[str, ...] | None = None
    openable: bool
    openness: float
    is_open: bool
    toggleable: bool
    is_toggled: bool
    controlled_objects: tuple[str, ...] | None = None
    breakable: bool
    is_broken: bool
    can_fill_with_liquid: bool
    is_filled_with_liquid: bool
    fill_liquid: str | None = None
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
        return not (self.pickupable or self.moveable)

    @property
    def box(self) -> Box:
        shape = self.axis_aligned_bounding_box
        return Box.around(shape.center.tuple, shape.size.tuple)


# ----------------------------------------------------------------- a file of dumps


def import_dump(
    path: str | Path,
    *,
    layouts: str | Path | None = None,
    only: Sequence[str] | None = None,
) -> Iterator[Scene]:
    """Read scenes from a dump: lines or one array of {"scene": name, "objects": [...]}.

    Args:
        path: .json or .jsonl, also gzipped; one JSON object alone is one scene.
        layouts: ALFRED's JSON of {scene: {"reachable": [[x, z], ...]}}, also gzipped; scenes
            without an entry get cells computed from the boxes.
        only: names to read; None = all.

    Raises:
        FileError: torn, not JSON, a missing or wrong field, an unknown object type, or a name
            of `only` that is not there; says in which line and object.
    """
    cells = _layouts(layouts) if layouts is not None else {}
    wanted = None if only is None else set(only)
    for place, row in _rows(Path(path)):
        name, objects = _named(row, path, place)
        if wanted is None or name in wanted:
            try:
                yield scene_from_dump(name, objects, reachable=cells.get(name))
            except FileError as error:
                raise FileError(path, f"{place}: {error.reason}") from error
            if wanted is not None:
                wanted.discard(name)
    if wanted:
        raise FileError(path, f"no scene named {sorted(wanted)[0]!r}")


def scene_from_dump(
    scene_name: str,
    objects: Sequence[Mapping[str, Any]],
    *,
    reachable: Sequence[Cell] | None = None,
    agent: AgentPose | None = None,
) -> Scene:
    """Return a scene from AI2-THOR's object metadata at reset.

    Args:
        scene_name: "FloorPlan1" and so on; its number says which room it is.
        objects: `event.metadata["objects"]`.
        reachable: (x, z) cells; computed from the boxes when None.
        agent: its start; the cell nearest to the middle of all when None.

    Raises:
        FileError: a field is missing or wrong, or the objects contradict each other; the path
            is the scene's name.
    """
    seen = [_seen(scene_name, index, row) for index, row in enumerate(objects)]
    if not seen:
        raise FileError(scene_name, "objects: there are none")
    floor_y = _floor_y(seen)
    room = _room_box(seen, floor_y)
    cells = tuple(sorted((float(x), float(z)) for x, z in reachable or ()))
    cells = cells or _free_cells(seen, room)
    if not cells:
        raise FileError(scene_name, "nowhere to stand: every cell is blocked")
    x, z = nearest_to_centre(cells)
    parents = _parents(seen)
    scene = Scene(
        name=scene_name,
        room=_room_type(scene_name),
        source="AI2-THOR metadata at reset",
        floor_y=floor_y,
        agent=agent or AgentPose(position=(x, round(floor_y + ORIGIN_M, 4), z)),
        reachable=cells,
        bounds_center=room.center,
        bounds_size=room.size,
        objects=tuple(_object(one, parents[one.object_id]) for one in seen),
    )
    check(scene, scene_name)
    return scene


# ----------------------------------------------------------------- reading


def _text(path: Path) -> bytes:
    data = read_bytes(path)
    if data[:2] != b"\x1f\x8b" and path.suffix != ".gz":
        return data
    try:
        return gzip.decompress(data)
    except (OSError, EOFError, zlib.error) as error:
        raise FileError(path, f"torn gzip: {error}", fix="copy the file again") from error


def _rows(path: Path) -> Iterator[tuple[str, Any]]:
    """Yield (where, JSON value): one per line, or one per element of a lone array."""
    data = _text(path)
    try:
        whole = json.loads(data)
    except (ValueError, RecursionError):
        lines = data.splitlines()
    else:
        many = whole if isinstance(whole, list) else [whole]
        yield from ((f"scene {number}", row) for number, row in enumerate(many, 1))
        return
    for number, line in enumerate(lines, 1):
        if line.strip():
            yield f"line {number}", _json(line, path, f"line {number}")


def _json(data: bytes, path: Path, place: str) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise FileError(path, f"{place}: not JSON: {error}") from error


def _named(row: Any, path: str | Path, place: str) -> tuple[str, list[Any]]:
    if not isinstance(row, dict):
        raise FileError(path, f"{place}: expected an object with `scene` and `objects`")
    for key, kind in (("scene", str), ("objects", list)):
        if not isinstance(row.get(key), kind):
            word = "missing" if key not in row else f"not a {kind.__name__}"
            raise FileError(path, f"{place}: `{key}` is {word}")
    return row["scene"], row["objects"]


class _Cells(msgspec.Struct, frozen=True):
    reachable: tuple[Cell, ...]


def _layouts(path: str | Path) -> dict[str, tuple[Cell, ...]]:
    data = _text(Path(path))
    try:
        table = msgspec.json.decode(data, type=dict[str, _Cells])
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise FileError(path, str(error)) from error
    return {name: row.reachable for name, row in table.items()}


def _seen(scene_name: str, index: int, row: Mapping[str, Any]) -> _Seen:
    label = row.get("objectId", index) if isinstance(row, Mapping) else index
    try:
        one = msgspec.convert(row, _Seen)
    except msgspec.ValidationError as error:
        raise FileError(scene_name, f"object {label!r}: {error}") from error
    if one.object_type not in object_types():
        reason = f"object {label!r}: unknown objectType {one.object_type!r}"
        raise FileError(scene_name, reason)
    return one


def _room_type(scene_name: str) -> RoomType:
    """Return the room by AI2-THOR's numbers: 1-30 kitchen, 201-, 301-, 401-."""
    found = re.match(r"FloorPlan(\d+)", scene_name)
    hundred = int(found[1]) // 100 if found else -1
    if hundred not in ROOM_OF_HUNDRED:
        raise FileError(scene_name, "scene: the name has no FloorPlan number of a single room")
    return ROOMS[ROOM_OF_HUNDRED[hundred]]


# ----------------------------------------------------------------- geometry


def _floor_y(seen: Sequence[_Seen]) -> float:
    """Return the floor's height: its origin, or the lowest lower side of any object."""
    floors = [one.position.y for one in seen if one.object_type == "Floor"]
    low = floors or [one.box.y0 for one in seen]
    return round(min(low), 4) + 0.0


def _room_box(seen: Sequence[_Seen], floor_y: float) -> Box:
    boxes = [one.box for one in seen]
    return Box(
        min(box.x0 for box in boxes), floor_y, min(box.z0 for box in boxes),
        max(box.x1 for box in boxes), max(floor_y + 2.0, *(box.y1 for box in boxes)),
        max(box.z1 for box in boxes),
    )  # fmt: skip


def _free_cells(seen: Sequence[_Seen], room: Box) -> tuple[Cell, ...]:
    solid = [one.box for one in seen if one.object_type != "Floor" and not one.pickupable]
    return reachable_cells(room, solid)


# ----------------------------------------------------------------- containment


def _parents(seen: Sequence[_Seen]) -> dict[str, tuple[str, ...]]:
    """Return for each id its receptacles, the nearest first.

    The two lists of the dump are joined: an id counts as a parent if either side says so. Then
    goes what a household cannot mean: unknown ids, the object itself, a fixed object in one that
    can be moved, and, of two that contain each other, the larger in the smaller.
    """
    by_id = {one.object_id: one for one in seen}
    pairs = {(one.object_id, parent) for one in seen for parent in one.parent_receptacles or ()}
    pairs |= {(child, one.object_id) for one in seen for child in one.receptacle_object_ids or ()}
    kept = {
        (child, parent)
        for child, parent in pairs
        if child != parent and child in by_id and parent in by_id
        and not (by_id[child].fixed and not by_id[parent].fixed)
        and not ((parent, child) in pairs and not _smaller(by_id[child], by_id[parent]))
    }  # fmt: skip
    parents: dict[str, tuple[str, ...]] = {}
    for one in seen:
        mine = [by_id[parent] for child, parent in kept if child == one.object_id]
        mine.sort(key=lambda parent, child=one: _nearness(child, parent))  # type: ignore[misc]
        parents[one.object_id] = tuple(parent.object_id for parent in mine)
    return _without_loops(parents)


def _smaller(one: _Seen, other: _Seen) -> bool:
    """Return whether one may lie in the other when each claims the other."""
    if one.fixed and other.fixed:
        return False
    return (one.fixed, _volume(one), one.object_id) < (other.fixed, _volume(other), other.object_id)


def _volume(one: _Seen) -> float:
    x, y, z = one.box.size
    return x * y * z


def _nearness(child: _Seen, parent: _Seen) -> tuple[bool, float, float, str]:
    gap = round(parent.box.distance(*child.box.center), 2)
    return parent.object_type == "Floor", gap, _volume(parent), parent.object_id


def _without_loops(parents: dict[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Drop, in the order of ids, every parent that would close a circle."""
    clean: dict[str, tuple[str, ...]] = {one: () for one in parents}

    def above(start: str) -> set[str]:
        found: set[str] = set()
        queue = [start]
        while queue:
            for parent in clean[queue.pop()]:
                if parent not in found:
                    found.add(parent)
                    queue.append(parent)
        return found

    for one in sorted(parents):
        for parent in parents[one]:
            if one not in above(parent):
                clean[one] = (*clean[one], parent)
    return clean


# ----------------------------------------------------------------- records


def _object(one: _Seen, parents: tuple[str, ...]) -> SceneObject:
    oriented = one.object_oriented_bounding_box
    shape = one.axis_aligned_bounding_box
    return SceneObject(
        id=one.object_id,
        type=one.object_type,
        name=one.name,
        asset=one.asset_id,
        position=one.position.tuple,
        rotation=one.rotation.tuple,
        center=shape.center.tuple,
        size=shape.size.tuple,
        corners=oriented.corner_points if oriented else None,
        capabilities=_capabilities(one),
        mass_kg=one.mass,
        materials=one.salient_materials,
        parents=parents,
        controls=one.controlled_objects or (),
        openness=one.openness if one.is_open else 0.0,
        is_toggled=one.is_toggled,
        is_broken=one.is_broken,
        is_filled=one.is_filled_with_liquid,
        liquid=one.fill_liquid,
        is_dirty=one.is_dirty,
        is_used_up=one.is_used_up,
        is_cooked=one.is_cooked,
        is_sliced=one.is_sliced,
        is_picked_up=one.is_picked_up,
        temperature=one.temperature,
    )


def _capabilities(one: _Seen) -> tuple[Capability, ...]:
    flags = {field.encode_name: field.name for field in msgspec.structs.fields(_Seen)}
    return tuple(flag for flag in FLAGS if getattr(one, flags[flag]))
