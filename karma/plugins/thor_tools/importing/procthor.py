"""Make scenes from houses of ProcTHOR's form: rooms, walls, doors, and objects in one another.

Doors between rooms are passages, shut ones too. Boxes come from a database of assets where one is
given, else from the table of types. Nothing is known of an asset's parts: a sink without a
`SinkBasin` among its children has none.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from karma.errors import FileError
from karma.files import read_json
from karma.household.types import RoomType
from karma.plugins.thor_tools.importing.dump import Xyz, rows
from karma.plugins.thor_tools.importing.house_floor import HouseShell
from karma.plugins.thor_tools.importing.house_record import FIX, HouseRecord, read_record
from karma.plugins.thor_tools.importing.house_things import HouseAsset, HouseThings, obstacles
from karma.world.core.boxes import Box, rounded
from karma.world.core.ground import GRID_M, Cell, Key, inside, nearest_to_centre, parts
from karma.world.core.scene import AgentPose, Scene, SceneRoom, check

ORIGIN_M = 0.9  # the agent's origin above the floor
ROOM_WORDS: Mapping[RoomType, str] = {
    "Kitchen": "kitchen", "LivingRoom": "living", "Bedroom": "bedroom", "Bathroom": "bathroom",
}  # fmt: skip
_HORIZONS_DEG = (-30.0, 60.0)
_KEYS = ("rooms", "walls", "doors")  # by which a house is told from other files


def holds_houses(path: str | Path) -> bool:
    """Return whether a file's first JSON value is a house.

    Raises:
        FileError: unreadable, torn or empty.
    """
    _, first = next(iter(rows(Path(path))), ("", None))
    return isinstance(first, Mapping) and all(key in first for key in _KEYS)


def import_houses(
    path: str | Path,
    *,
    assets: str | Path | None = None,
    only: Sequence[str] | None = None,
) -> Iterator[Scene]:
    """Read houses from a file, also gzipped: one, an array, or one a line.

    A scene's name is the file's; of several houses in a file, with "_1", "_2" and so on. Boxes come
    from `assets`, as `read_assets` reads them; of the names only `only`.

    Raises:
        FileError: torn, no house, or a name of `only` that is not there; says where.
    """
    known = {} if assets is None else read_assets(assets)
    stem = Path(path).name.partition(".")[0]
    there: list[str] = []
    houses = list(rows(Path(path)))
    for number, (place, row) in enumerate(houses, 1):
        name = stem if len(houses) == 1 else f"{stem}_{number}"
        there.append(name)
        if only is not None and name not in only:
            continue
        prefix = "" if len(houses) == 1 else f"{place}: "
        if not isinstance(row, Mapping):
            raise FileError(path, f"{prefix}no JSON object", fix=FIX)
        try:
            yield house_scene(row, name=name, assets=known)
        except FileError as error:
            raise FileError(path, f"{prefix}{error.reason}", fix=error.fix) from error
    if missing := sorted(set(only or ()) - set(there)):
        reason = f"no house named {missing[0]!r} among {len(there)}, such as {there[0]}"
        raise FileError(path, reason, fix="leave --only out, or give it other names")


def read_assets(path: str | Path) -> dict[str, HouseAsset]:
    """Read boxes by asset: {asset: {"objectType", "boundingBox": {x, y, z}}}.

    ProcTHOR's own asset-database.json has a list of assets for each type, which is read too.

    Raises:
        FileError: torn or of the wrong form.
    """
    known: dict[str, HouseAsset] = {}
    for key, value in read_json(path, dict[str, Any]).items():
        for number, one in enumerate(value if isinstance(value, list) else [value]):
            place = f"{key}[{number}]" if isinstance(value, list) else key
            try:
                asset = msgspec.convert(one, HouseAsset)
                listed = msgspec.convert(one["assetId"], str) if value is not one else key
            except (msgspec.ValidationError, KeyError) as error:
                raise FileError(path, f"{place}: {error}", fix="copy it from ProcTHOR") from error
            known[listed] = asset
    return known


def house_scene(
    house: Mapping[str, Any], *, name: str, assets: Mapping[str, HouseAsset] | None = None
) -> Scene:
    """Return a house as one scene; its `source` tells what was left out or done about it.

    Boxes are by asset; a thing of another asset has its type's size.

    Raises:
        FileError: the house contradicts itself; the path is `name`, the reason names the key.
    """
    record = read_record(house, name)
    shell = HouseShell(record)
    things = HouseThings(record=record, shell=shell, assets=assets or {}, name=name)
    objects = things.objects()
    cells, apart = _standing(record, shell.cells(obstacles(objects)), name)
    (x0, z0), (x1, z1) = shell.low, shell.high
    bounds = Box(x0, shell.floor_y, z0, x1, shell.ceiling_y, z1)
    scene = Scene(
        name=name,
        room=record.rooms[0].room_type,
        source="; ".join(["ProcTHOR's form", *_notes(record, things, apart)]),
        floor_y=shell.floor_y,
        grid_m=GRID_M,
        agent=_agent(record, cells),
        reachable=tuple(sorted(cells.values())),
        bounds_center=rounded(bounds.center),
        bounds_size=rounded(bounds.size),
        objects=objects,
        rooms=tuple(_scene_rooms(record)),
        walls=shell.walls(),
    )
    check(scene, name)
    return scene


def _scene_rooms(record: HouseRecord) -> Iterator[SceneRoom]:
    counts: dict[str, int] = {}
    for room in record.rooms:
        word = ROOM_WORDS[room.room_type]
        counts[word] = counts.get(word, 0) + 1
        yield SceneRoom(name=f"{word}_{counts[word]}", room=room.room_type, corners=room.corners)


def _standing(
    record: HouseRecord, free: Mapping[Key, Cell], name: str
) -> tuple[dict[Key, Cell], list[str]]:
    """Return the cells that hang together, and the rooms they miss.

    Those of the start that the house tells, else those that lead through most rooms.
    """
    together = parts(free)
    if not together:
        raise FileError(name, "rooms: nowhere to stand, every cell is blocked", fix=FIX)
    floors = list(_scene_rooms(record))

    def met(part: Sequence[Key]) -> list[bool]:
        points = np.array([free[key] for key in part])
        return [bool(inside(room.corners, points[:, 0], points[:, 1]).any()) for room in floors]

    start = record.metadata.agent
    best = max(together, key=lambda part: (sum(met(part)), len(part)))
    if start is not None:
        best = min(together, key=lambda part: min(_gap2(free[key], start.position) for key in part))
    missed = [room.name for room, hit in zip(floors, met(best), strict=True) if not hit]
    return {key: free[key] for key in best}, missed


def _agent(record: HouseRecord, cells: Mapping[Key, Cell]) -> AgentPose:
    """Return the start that the house tells, moved to the nearest cell; else one in the middle."""
    y = round(record.floor_y + ORIGIN_M, 4)
    start = record.metadata.agent
    order = sorted(cells.values())
    if start is None:
        x, z = nearest_to_centre(order)
        return AgentPose(position=(x, y, z))
    x, z = min(order, key=lambda cell: _gap2(cell, start.position))
    horizon = min(max(start.horizon, _HORIZONS_DEG[0]), _HORIZONS_DEG[1])
    return AgentPose(position=(x, y, z), yaw=start.rotation.y % 360, horizon=horizon)


def _gap2(cell: Cell, place: Xyz) -> float:
    return round((cell[0] - place.x) ** 2 + (cell[1] - place.z) ** 2, 9)


def _notes(record: HouseRecord, things: HouseThings, apart: Sequence[str]) -> Iterator[str]:
    """Yield what had to be done about the house."""
    if things.left_out:
        kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(things.left_out.items()))
        yield f"left out {things.left_out.total()} of types that we do not have: {kinds}"
    if things.lay_on:
        yield f"left out {things.lay_on} that lay in or on those"
    if things.usual:
        yield f"{things.usual} things have their type's usual size"
    shut = [
        door
        for door in record.doors
        if not door.leads_out and (door.openable and not door.openness)
    ]
    if shut:
        yield f"shut doors taken as open: {len(shut)}"
    if apart:
        yield f"nobody can walk to {', '.join(apart)}"
