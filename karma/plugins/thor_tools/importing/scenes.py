"""Make scenes from AI2-THOR metadata: what the genuine simulator reported at reset."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from karma.errors import FileError
from karma.household.places import FLOOR
from karma.household.types import Capability, RoomType, object_types
from karma.plugins.thor_tools.importing.dump import (
    Seen,
    named,
    read_layouts,
    rows,
    seen_object,
    stance,
)
from karma.plugins.thor_tools.importing.floor import Floor, start_of
from karma.types.space import Vec3
from karma.world.core.boxes import Box
from karma.world.core.ground import AGENT_RADIUS_M, Cell, nearest_to_centre
from karma.world.core.scene import AgentPose, Scene, SceneObject, check

ORIGIN_M = 0.9  # the agent's origin above the floor
FLAGS: tuple[Capability, ...] = Capability.__args__  # type: ignore[attr-defined]
_FIELDS = {field.encode_name: field.name for field in msgspec.structs.fields(Seen)}
SAME = set(SceneObject.__struct_fields__) & set(Seen.__struct_fields__) - {
    "position", "rotation", "openness",
}  # fields that both have  # fmt: skip
ROOMS: tuple[RoomType, ...] = ("Kitchen", "LivingRoom", "Bedroom", "Bathroom")  # by hundreds
ROOM_OF_HUNDRED = {0: 0, 2: 1, 3: 2, 4: 3}


# ----------------------------------------------------------------- a file of dumps


def import_dump(
    path: str | Path,
    *,
    layouts: str | Path | None = None,
    only: Sequence[str] | None = None,
) -> Iterator[Scene]:
    """Read scenes from a dump: lines or one array of {"scene": name, "objects": [...]}.

    What scripts/export_thor_scenes.py writes also has `agent` and `reachable`; they are used.

    Files may be gzipped; one JSON object alone is one scene. Cells come from `layouts`, ALFRED's
    {scene: {"reachable": [[x, z], ...]}}, else from the boxes. Of the names only `only`.

    Raises:
        FileError: torn, not JSON, a missing or wrong field, an unknown object type, or a name
            of `only` that is not there; says in which line and object.
    """
    cells = read_layouts(layouts) if layouts is not None else {}
    wanted = None if only is None else set(only)
    there: list[str] = []
    for place, row in rows(Path(path)):
        name, objects = named(row, path, place)
        there.append(name)
        if wanted is None or name in wanted:
            try:
                agent, known = stance(row, path, place)
                yield scene_from_dump(
                    name, objects, reachable=cells.get(name) or known, agent=agent
                )
            except FileError as error:
                raise FileError(path, f"{place}: {error.reason}", fix=error.fix) from error
            if wanted is not None:
                wanted.discard(name)
    if wanted:
        reason = f"no scene named {sorted(wanted)[0]!r} among {len(there)}, such as {there[0]}"
        raise FileError(path, reason, fix="leave --only out, or give it other names")


@dataclass(frozen=True, slots=True, kw_only=True)
class FloorScore:
    """How well the floor worked out from a room's boxes fits its recorded cells."""

    scene: str
    computed: int  # cells
    recorded: int
    both: int

    @property
    def precision(self) -> float:
        """Share of the computed cells that were recorded."""
        return self.both / self.computed

    @property
    def recall(self) -> float:
        """Share of the recorded cells that were computed."""
        return self.both / self.recorded


def floor_scores(path: str | Path, layouts: str | Path) -> Iterator[FloorScore]:
    """Yield the score of every room of a dump that has recorded cells.

    Raises:
        FileError: a file is torn or of the wrong form.
    """
    known = read_layouts(layouts)
    for scene in import_dump(path):
        if cells := {(round(x, 3), round(z, 3)) for x, z in known.get(scene.name, ())}:
            found = {(round(x, 3), round(z, 3)) for x, z in scene.reachable}
            yield FloorScore(
                scene=scene.name,
                computed=len(found),
                recorded=len(cells),
                both=len(found & cells),
            )


def scene_from_dump(
    scene_name: str,
    objects: Sequence[Mapping[str, Any]],
    *,
    reachable: Sequence[Cell] | None = None,
    agent: AgentPose | None = None,
    stood: Sequence[Cell] = (),
    grid_m: float = 0.25,
) -> Scene:
    """Return a scene from AI2-THOR's object metadata at reset.

    Args:
        scene_name: "FloorPlan1" and so on; its number says which room it is, else what is in it.
        objects: `event.metadata["objects"]`.
        reachable: (x, z) cells; computed from the boxes when None.
        agent: its start, which is a cell of its own. When None, the place that the objects'
            distances tell; failing that the cell nearest to the middle of all.
        stood: cells that somebody stood on, which are free whatever the boxes say.
        grid_m: distance of the cells.

    Raises:
        FileError: a field is missing or wrong, or the objects contradict each other; the path
            is the scene's name.
    """
    seen = [seen_object(scene_name, index, row) for index, row in enumerate(objects)]
    if not seen:
        raise FileError(scene_name, "objects: there are none")
    floor_y = _floor_y(seen)
    cells = tuple(sorted((float(x), float(z)) for x, z in reachable or ()))
    boxes = [one.box for one in seen if one.type != FLOOR] or [seen[0].box]
    box = room_box(boxes, floor_y, cells)
    cells, agent, note = _standing(seen, box, cells, agent, stood, grid_m)
    if not cells:
        raise FileError(scene_name, "nowhere to stand: every cell is blocked")
    x, z = nearest_to_centre(cells)
    parents = _parents(seen)
    scene = Scene(
        name=scene_name,
        room=room_by_name(scene_name) or room_by_things(objects),
        source="; ".join(filter(None, ("AI2-THOR metadata at reset", note))),
        floor_y=floor_y,
        grid_m=grid_m,
        agent=agent or AgentPose(position=(x, round(floor_y + ORIGIN_M, 4), z)),
        reachable=cells,
        bounds_center=box.center,
        bounds_size=box.size,
        objects=tuple(_object(one, parents[one.id]) for one in seen),
    )
    check(scene, scene_name)
    return scene


# ----------------------------------------------------------------- geometry


def room_by_name(scene_name: str) -> RoomType | None:
    """Return the room by AI2-THOR's numbers: 1-30 kitchen, 201-, 301-, 401-; None without one."""
    found = re.match(r"FloorPlan(\d+)", scene_name)
    hundred = int(found[1]) // 100 if found else -1
    return ROOMS[ROOM_OF_HUNDRED[hundred]] if hundred in ROOM_OF_HUNDRED else None


def room_by_things(objects: Sequence[Mapping[str, Any]]) -> RoomType:
    """Return the room in which AI2-THOR has most of the types seen; the first of equals.

    For scenes named otherwise (RoboTHOR, houses): a type counts the more, the fewer rooms have it.
    """
    weight = dict.fromkeys(ROOMS, 0.0)
    for kind in sorted({str(row.get("objectType")) for row in objects}):
        rooms_of = object_types()[kind].rooms if kind in object_types() else ()
        for room in rooms_of:
            weight[room] += 1 / len(rooms_of)
    return max(ROOMS, key=lambda room: weight[room])


def _floor_y(seen: Sequence[Seen]) -> float:
    """Return the floor's height: its upper side, or the lowest lower side of any object.

    The Floor's origin does not tell: in 5.0.0 it lies up to 1.3 m off its surface.
    """
    floors = [one.box.y1 for one in seen if one.type == FLOOR]
    low = floors or [one.box.y0 for one in seen]
    return round(min(low), 4) + 0.0


def room_box(boxes: Iterable[Box], floor_y: float, cells: Sequence[Cell]) -> Box:
    """Return what holds all boxes and an agent on all cells, two metres high at least.

    The floor's own box is not to be among them: it reaches beyond the walls.
    """
    r = AGENT_RADIUS_M
    stands = [Box(x - r, floor_y, z - r, x + r, floor_y, z + r) for x, z in cells]
    hull = Box.hull([*boxes, *stands])
    return hull._replace(y0=floor_y, y1=max(floor_y + 2.0, hull.y1))


def _standing(
    seen: Sequence[Seen],
    box: Box,
    recorded: Sequence[Cell],
    agent: AgentPose | None,
    stood: Sequence[Cell],
    grid_m: float,
) -> tuple[tuple[Cell, ...], AgentPose | None, str]:
    """Return the cells to stand on, the agent's start, and what had to be done about the cells.

    Arguments as of `scene_from_dump`; `recorded` are its `reachable`.
    """
    place = agent.position if agent is not None else start_of(seen)
    if recorded and agent is None and place is not None and not _on_grid(place, recorded, grid_m):
        place = None
    start = None if place is None else (place[0], place[2])
    origin = start or (recorded[0] if recorded else (0.0, 0.0))
    floor = Floor(seen, box, start=start, origin=origin, grid_m=grid_m)
    if recorded:
        every = _with_places(recorded, (*stood, *filter(None, [start])), grid_m)
        cells, note = floor.connected(every, from_start=agent is not None)
    else:
        cells, note = floor.walkable(stood), "floor computed from the boxes"
    if place and start and agent is None and _with_places(cells, [start], grid_m) == cells:
        agent = AgentPose(position=place)
    return cells, agent, note


def _on_grid(place: Vec3, cells: Sequence[Cell], grid_m: float) -> bool:
    """Return whether a place is in steps of the grid from the cells, and not far from them."""
    (x, _, z), (a, b) = place, cells[0]
    off = [abs(gap / grid_m - round(gap / grid_m)) for gap in (x - a, z - b)]
    near = min(max(abs(x - a), abs(z - b)) for a, b in cells) < 1.5 * grid_m
    return max(off) < 0.05 and near


def _with_places(cells: Sequence[Cell], places: Iterable[Cell], grid_m: float) -> tuple[Cell, ...]:
    """Return the cells with those that were stood on."""
    found = list(cells)
    for x, z in places:
        if not any(abs(a - x) < grid_m / 2 and abs(b - z) < grid_m / 2 for a, b in found):
            found.append((x, z))
    return tuple(sorted(found))


# ----------------------------------------------------------------- containment


def _parents(seen: Sequence[Seen]) -> dict[str, tuple[str, ...]]:
    """Return for each id its receptacles, the nearest first.

    The two lists of the dump are joined: an id counts as a parent if either side says so. Then
    goes what a household cannot mean: unknown ids, the object itself, a fixed object in a smaller
    one that can be moved, and, of two that contain each other, the larger in the smaller.
    """
    by_id = {one.id: one for one in seen}
    pairs = {(one.id, parent) for one in seen for parent in one.parent_receptacles or ()}
    pairs |= {(child, one.id) for one in seen for child in one.receptacle_object_ids or ()}
    kept = {
        (child, parent)
        for child, parent in pairs
        if child != parent and child in by_id and parent in by_id
        and not _swallows(by_id[child], by_id[parent])
        and not ((parent, child) in pairs and not _smaller(by_id[child], by_id[parent]))
    }  # fmt: skip
    parents: dict[str, tuple[str, ...]] = {}
    for one in seen:
        mine = [by_id[parent] for child, parent in kept if child == one.id]
        mine.sort(key=lambda parent, child=one: _nearness(child, parent))  # type: ignore[misc]
        parents[one.id] = tuple(parent.id for parent in mine)
    return _without_loops(parents)


def _swallows(child: Seen, parent: Seen) -> bool:
    """Return whether something movable would hold a fixed thing with more ground than its own."""
    ground = [one.box.size[0] * one.box.size[2] for one in (child, parent)]
    return child.fixed and not parent.fixed and ground[0] >= ground[1]


def _smaller(one: Seen, other: Seen) -> bool:
    """Return whether one may lie in the other when each claims the other."""
    if one.fixed and other.fixed:
        return False
    return (one.fixed, _volume(one), one.id) < (other.fixed, _volume(other), other.id)


def _volume(one: Seen) -> float:
    x, y, z = one.box.size
    return x * y * z


def _nearness(child: Seen, parent: Seen) -> tuple[bool, float, float, str]:
    gap = round(parent.box.distance(*child.box.center), 2)
    return parent.type == FLOOR, gap, _volume(parent), parent.id


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


def _object(one: Seen, parents: tuple[str, ...]) -> SceneObject:
    corners, shape = one.object_oriented_bounding_box, one.axis_aligned_bounding_box
    return SceneObject(
        **{field: getattr(one, field) for field in SAME},
        position=one.position.tuple,
        rotation=one.rotation.tuple,
        center=shape.center.tuple,
        size=shape.size.tuple,
        corners=corners.corner_points if corners else None,
        capabilities=tuple(flag for flag in FLAGS if getattr(one, _FIELDS[flag])),
        parents=parents,
        controls=one.controlled_objects or (),
        openness=(one.openness or 1.0) if one.is_open else 0.0,  # 5.0.0 says 1.0 for a few closed
    )
