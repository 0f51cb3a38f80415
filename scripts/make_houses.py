"""Write twenty houses of our own in ProcTHOR's form, and the boxes of their assets.

python scripts/make_houses.py --seed 16 --out eval/lived/houses

Rooms are those of `karma.world.houses`; some get an alcove (so their floor is an L), more doors
and a front door. Equal seeds give equal bytes.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from karma.files import write_atomic
from karma.household.uses import WHOLE_OF
from karma.offline import go_offline
from karma.seeds import stream
from karma.world.core.boxes import Box
from karma.world.core.scene import Scene, SceneObject
from karma.world.houses import build_home

HOUSES = (2, 3, 4, 5, 6, 3, 5, 4, 7, 2, 6, 5, 4, 8, 3, 5, 6, 4, 7, 5)  # rooms of each
DOOR_M, DOOR_HIGH_M = 0.9, 2.1
ALCOVES_M = ((1.5, 1.25), (1.25, 1.5), (1.0, 1.0), (0.75, 0.75))  # along the wall, and deep
FRONT_M = 0.25  # kept free before a new door
FACING_M = 0.7  # rooms so near may have one more door between them
PLAIN = 0.2  # share of rooms that stay rectangles
APART_M = 1.3  # of two doors in a wall
FIRST_ROOM = 2  # as ProcTHOR counts: 0 and 1 are no rooms

Point = tuple[float, float]


@dataclass(slots=True)
class Doorstep:
    """A gap between two points of a room's wall; the same place in the other room's."""

    rooms: tuple[int, int]
    gaps: tuple[tuple[Point, Point], tuple[Point, Point]]


@dataclass(slots=True)
class Assets:
    """The boxes of all houses' things, a name each."""

    known: dict[tuple[str, tuple[float, ...]], str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    def name(self, thing: SceneObject) -> str:
        """Return the asset of a thing with its size at yaw 0."""
        x, y, z = (round(side, 3) for side in thing.size)
        size = (z, y, x) if round(thing.rotation[1] / 90) % 2 else (x, y, z)
        key = (thing.type, size)
        if key not in self.known:
            self.counts[thing.type] = self.counts.get(thing.type, 0) + 1
            self.known[key] = f"{thing.type}_{self.counts[thing.type]}"
        return self.known[key]

    def table(self) -> dict[str, Any]:
        """Return the database as it is written."""
        return {
            name: {"objectType": kind, "boundingBox": _xyz(*size)}
            for (kind, size), name in self.known.items()
        }


def _xyz(x: float, y: float, z: float) -> dict[str, float]:
    return {axis: round(value, 3) + 0.0 for axis, value in zip("xyz", (x, y, z), strict=True)}


# ----------------------------------------------------------------- doors and alcoves


class FloorPlanDraft:
    """The rooms of a home as polygons, with the doors between them.

    Args:
        scene: a home whose rooms are rectangles.
        rng: draws alcoves and doors.
    """

    def __init__(self, scene: Scene, rng: np.random.Generator) -> None:
        self.scene, self.rng = scene, rng
        self.boxes = [_box(room.corners) for room in scene.rooms or ()]
        self.solid = [
            Box.around(one.center, one.size) for one in scene.objects if one.type != "Floor"
        ]
        self.polygons: list[list[Point]] = [
            [(box.x0, box.z0), (box.x1, box.z0), (box.x1, box.z1), (box.x0, box.z1)]
            for box in self.boxes
        ]
        self.doors = [step for pair in _pairs(self.boxes) for step in self._between(pair)]
        self.doors += [step for pair in _pairs(self.boxes) for step in self._another(pair)]
        self.added = [self._alcove(room) for room in range(len(self.boxes))]

    def _between(self, pair: tuple[int, int]) -> Iterator[Doorstep]:
        """Yield the doors that the home has between two rooms: its walls leave gaps there."""
        walls = [Box(*wall.low, *wall.high) for wall in self.scene.walls or ()]
        for axis, low, high, start, end in _facing(self.boxes[pair[0]], self.boxes[pair[1]]):
            for number in range(int((end - start) / 0.025)):
                middle = round(start + number * 0.025, 3)
                gate = _gate(axis, low - 0.06, high + 0.06, middle, DOOR_M - 0.01)
                if middle - DOOR_M / 2 < start or middle + DOOR_M / 2 > end:
                    continue
                if not any(gate.overlaps(wall) for wall in walls):
                    yield _step(pair, axis, low, high, middle)
                    break

    def _another(self, pair: tuple[int, int]) -> Iterator[Doorstep]:
        """Yield one more door between two rooms, where nothing stands in its way."""
        for axis, low, high, start, end in _facing(self.boxes[pair[0]], self.boxes[pair[1]]):
            for middle in np.arange(start + DOOR_M / 2 + 0.1, end - DOOR_M / 2 - 0.1, 0.25):
                step = _step(pair, axis, low, high, round(float(middle), 3))
                gate = _gate(axis, low - FRONT_M, high + FRONT_M, middle, DOOR_M + 0.1)
                taken = any(_near(step, other) for other in self.doors)
                if not taken and not any(gate.overlaps(box) for box in self.solid):
                    yield step
                    return

    def _alcove(self, room: int) -> bool:
        """Make a room's floor an L, where the outside is free; return whether it could be."""
        corners = self.polygons[room]
        if self.rng.random() < PLAIN:
            return False
        for side, (wide, deep) in product(map(int, self.rng.permutation(4)), ALCOVES_M):
            p, q = np.array(corners[side]), np.array(corners[(side + 1) % 4])
            along = (q - p) / np.linalg.norm(q - p)
            out = np.array((along[1], -along[0])) * deep
            ends = [p + out, p + along * wide + out, p + along * wide]
            new = [(round(float(x), 3), round(float(z), 3)) for x, z in ends]
            inner = np.linalg.norm(q - p) >= wide + 0.5
            if inner and self._free(room, _box([corners[side], *new]), out / deep):
                corners[side : side + 1] = new
                return True
        return False

    def _free(self, room: int, area: Box, out: np.ndarray) -> bool:
        """Return whether nothing is where an alcove would be, nor at the wall before it."""
        wide = area.grown(0.15, 0.0, 0.15)
        others = [_box(polygon) for i, polygon in enumerate(self.polygons) if i != room]
        before = area.grown(0.05, 3.0, 0.05).shifted(*(-0.25 * out))
        gaps = [point for step in self.doors for gap in step.gaps for point in gap]
        shut = any(wide.x0 < x < wide.x1 and wide.z0 < z < wide.z1 for x, z in gaps)
        return not (
            shut
            or any(wide.overlaps(other) for other in others)
            or any(before.overlaps(box) for box in self.solid)
        )


def _box(corners: Sequence[Point]) -> Box:
    xs, zs = [x for x, _ in corners], [z for _, z in corners]
    return Box(min(xs), 0.0, min(zs), max(xs), 3.0, max(zs))


def _pairs(boxes: Sequence[Box]) -> Iterator[tuple[int, int]]:
    for one in range(len(boxes)):
        for other in range(one + 1, len(boxes)):
            yield one, other


def _facing(one: Box, other: Box) -> Iterator[tuple[str, float, float, float, float]]:
    """Yield axis, both walls' places across, and the stretch along which two rooms face."""
    for axis, low, high, ends in (
        ("x", one.x1, other.x0, (one.z0, other.z0, one.z1, other.z1)),
        ("x", other.x1, one.x0, (one.z0, other.z0, one.z1, other.z1)),
        ("z", one.z1, other.z0, (one.x0, other.x0, one.x1, other.x1)),
        ("z", other.z1, one.z0, (one.x0, other.x0, one.x1, other.x1)),
    ):
        start, end = max(ends[:2]), min(ends[2:])
        if 0 <= high - low <= FACING_M and end - start > DOOR_M:
            yield axis, low, high, start, end


def _gate(axis: str, low: float, high: float, middle: float, wide: float) -> Box:
    start, end = middle - wide / 2, middle + wide / 2
    if axis == "x":
        return Box(low, 0.05, start, high, DOOR_HIGH_M, end)
    return Box(start, 0.05, low, end, DOOR_HIGH_M, high)


def _step(pair: tuple[int, int], axis: str, low: float, high: float, middle: float) -> Doorstep:
    start, end = round(middle - DOOR_M / 2, 3), round(middle + DOOR_M / 2, 3)
    if axis == "x":
        return Doorstep(rooms=pair, gaps=(((low, start), (low, end)), ((high, start), (high, end))))
    return Doorstep(rooms=pair, gaps=(((start, low), (end, low)), ((start, high), (end, high))))


def _near(step: Doorstep, other: Doorstep) -> bool:
    (a, b), (c, d) = ([np.mean(gap, axis=0) for gap in one.gaps] for one in (step, other))
    return bool(min(np.linalg.norm(x - y) for x in (a, b) for y in (c, d)) < APART_M)


# ----------------------------------------------------------------- the form


def house_json(scene: Scene, rng: np.random.Generator, assets: Assets) -> dict[str, Any]:
    """Return a home in ProcTHOR's form."""
    plan = FloorPlanDraft(scene, rng)
    high = scene.bounds_center[1] + scene.bounds_size[1] / 2
    walls = [
        _wall(f"{room + FIRST_ROOM}", p, q, high)
        for room, corners in enumerate(plan.polygons)
        for p, q in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    doors = [_door(number, step, walls, rng) for number, step in enumerate(plan.doors)]
    doors.append(_front_door(plan, walls, high))
    x, y, z = scene.agent.position
    agent = {"position": _xyz(x, y, z), "rotation": _xyz(0, scene.agent.yaw, 0)}
    return {
        "rooms": [
            {
                "id": f"room|{room + FIRST_ROOM}",
                "roomType": told.room,
                "floorPolygon": [_xyz(x, 0, z) for x, z in plan.polygons[room]],
                "ceilings": [],
                "children": [],
            }
            for room, told in enumerate(scene.rooms or ())
        ],
        "walls": walls,
        "doors": doors,
        "windows": [],
        "objects": _objects(scene, plan.boxes, assets),
        "proceduralParameters": {"floorColliderThickness": 1.0, "receptacleHeight": 0.7},
        "metadata": {
            "agent": {**agent, "horizon": 30, "standing": True},
            "roomSpecId": f"{len(plan.boxes)}-room",
            "schema": "1.0.0",
        },
    }


def _wall(room: str, p: Point, q: Point, high: float) -> dict[str, Any]:
    (x0, z0), (x1, z1) = p, q
    where = "|".join(f"{v:.2f}" for v in (min(x0, x1), min(z0, z1), max(x0, x1), max(z0, z1)))
    return {
        "id": f"wall|{room}|{where}",
        "roomId": "exterior" if room == "exterior" else f"room|{room}",
        "polygon": [_xyz(x, y, z) for y in (0, high) for x, z in (p, q)],
    }


def _door(
    number: int, step: Doorstep, walls: Sequence[dict[str, Any]], rng: np.random.Generator
) -> dict[str, Any]:
    """Return a door; its hole is measured along the first room's wall."""
    mine = sorted(step.rooms)
    found = [(r, wall, gap) for r in mine for gap in step.gaps for wall in walls
             if wall["roomId"] == f"room|{r + FIRST_ROOM}" and _on(wall, gap)]  # fmt: skip
    (_, first, gap), (_, second, _) = found
    start = first["polygon"][0]
    along = sorted(abs(x - start["x"]) + abs(z - start["z"]) for x, z in gap)
    low, high = mine[0] + FIRST_ROOM, mine[1] + FIRST_ROOM
    return {
        "id": f"door|{low}|{high}|{number}",
        "assetId": "Doorway_1",
        "room0": f"room|{low}",
        "room1": f"room|{high}",
        "wall0": first["id"],
        "wall1": second["id"],
        "holePolygon": [_xyz(along[0], 0, 0), _xyz(along[1], DOOR_HIGH_M, 0)],
        "openable": True,
        "openness": int(rng.integers(2)),
    }


def _on(wall: dict[str, Any], gap: tuple[Point, Point]) -> bool:
    p, q = wall["polygon"][:2]
    box = _box([(p["x"], p["z"]), (q["x"], q["z"])]).grown(0.002, 0.0, 0.002)
    return all(box.x0 <= x <= box.x1 and box.z0 <= z <= box.z1 for x, z in gap)


def _front_door(plan: FloorPlanDraft, walls: list[dict[str, Any]], high: float) -> dict[str, Any]:
    """Return the house's own door, in the first long wall with nothing behind; it stays shut."""
    for room, corners in enumerate(plan.polygons):
        for p, q in zip(corners, [*corners[1:], corners[0]], strict=True):
            long = abs(q[0] - p[0]) + abs(q[1] - p[1])
            strip = _box([p, q]).grown(0.8, 0.0, 0.8)
            others = [_box(one) for i, one in enumerate(plan.polygons) if i != room]
            if long > DOOR_M + 0.2 and not any(strip.overlaps(other) for other in others):
                outer = _wall("exterior", q, p, high)
                walls.append(outer)
                inner = _wall(f"{room + FIRST_ROOM}", p, q, high)["id"]
                middle = long / 2
                hole = (middle - DOOR_M / 2, middle + DOOR_M / 2)
                here = f"room|{room + FIRST_ROOM}"
                return {
                    "id": f"door|1|{room + FIRST_ROOM}",
                    "assetId": "Doorway_1",
                    "room0": here,
                    "room1": here,
                    "wall0": inner,
                    "wall1": outer["id"],
                    "holePolygon": [_xyz(hole[0], 0, 0), _xyz(hole[1], DOOR_HIGH_M, 0)],
                    "openable": False,
                    "openness": 0,
                }
    raise ValueError("every wall has a room behind it")


# ----------------------------------------------------------------- things


def _objects(scene: Scene, boxes: Sequence[Box], assets: Assets) -> list[dict[str, Any]]:
    """Return the things of a home, in one another as they lie."""
    told: dict[str, dict[str, Any]] = {}
    top: list[dict[str, Any]] = []
    floors = {one.id for one in scene.objects if one.type == "Floor"}
    above = {one.id: _holder(one, scene, floors) for one in scene.objects}
    for number, one in enumerate(scene.objects):
        if one.id not in floors:
            x, _, z = one.center
            room = min(range(len(boxes)), key=lambda i: boxes[i].distance(x, 0.0, z))
            told[one.id] = _thing(one, room + FIRST_ROOM, number, above[one.id], assets)
    for one in scene.objects:
        if one.id in told:
            holder = above[one.id]
            group = top if holder is None else told[holder].setdefault("children", [])
            group.append(told[one.id])
    return top


def _holder(one: SceneObject, scene: Scene, floors: set[str]) -> str | None:
    """Return what a thing is written in: a basin in its sink, the rest where it lies."""
    if one.type in WHOLE_OF:
        return one.id.rpartition("|")[0]
    parent = next(iter(one.parents), None)
    return None if parent in floors else parent


def _thing(
    one: SceneObject, room: int, number: int, holder: str | None, assets: Assets
) -> dict[str, Any]:
    where = f"{room}|{number}" if holder is None else f"surface|{room}|{number}"
    found: dict[str, Any] = {
        "id": f"{one.type}|{where}",
        "assetId": assets.name(one),
        "position": _xyz(*one.center),
        "rotation": _xyz(*one.rotation),
        "kinematic": "moveable" not in one.capabilities and "pickupable" not in one.capabilities,
    }
    if "openable" in one.capabilities:
        found["openness"] = one.openness
    if "toggleable" in one.capabilities:
        found["isOn"] = one.is_toggled
    if one.is_dirty:
        found["isDirty"] = True
    return found


def write_houses(seed: int, out: Path, count: int = len(HOUSES)) -> Iterator[tuple[Path, int]]:
    """Write the first houses and the database of their assets; yield each path and its size."""
    assets = Assets()
    for number, rooms in enumerate(HOUSES[:count], 1):
        name = f"house_{number:02}"
        scene = build_home(rooms, seed + number, name=name)
        house = house_json(scene, stream(seed, "houses of our own", name), assets)
        path = out / f"{name}.json"
        data = msgspec.json.encode(house) + b"\n"
        write_atomic(path, data)
        yield path, len(data)
    data = msgspec.json.encode(assets.table()) + b"\n"
    write_atomic(out / "assets.json", data)
    yield out / "assets.json", len(data)


def main() -> None:
    """Write the houses."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=16)
    parser.add_argument("--out", type=Path, default=Path("eval/lived/houses"))
    arguments = parser.parse_args()
    for path, size in write_houses(arguments.seed, arguments.out):
        print(f"{path}: {size} bytes")


if __name__ == "__main__":
    go_offline()
    main()
