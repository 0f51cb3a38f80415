"""A room from above as shapes for SVG: centimetres, x to the right, z up the page."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from karma.household.places import FLOOR
from karma.memory.scene_graph import SceneGraph
from karma.world.core.scene import Scene, SceneObject

HIGH_M = 1.2  # furniture that begins higher is drawn as an outline
SMALL_M2 = 0.03  # what takes less ground is not drawn
LABEL_CM, LEAST_CM, MOST_CM = 0.56, 8.0, 13.0  # width of a letter per size, sizes of labels
MARGIN_CM = 14.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanShape:
    """One piece of furniture; x and y are its upper left corner."""

    title: str
    x: float
    y: float
    width: float
    height: float
    high: bool
    label: str  # "" where none fits
    label_size: float
    upright: bool  # whether its label runs up the page


@dataclass(frozen=True, slots=True, kw_only=True)
class AreaMark:
    """One area of long-term memory."""

    name: str
    x: float
    y: float
    contains: tuple[str, ...]
    adjacent: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """Two areas that can be walked between."""

    x1: float
    y1: float
    x2: float
    y2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomFloor:
    """The floor of one room of a home; x and y are where its name stands."""

    name: str
    points: str  # of a polygon
    x: float
    y: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomPlan:
    """What the page draws under a path."""

    scene: str
    room: str
    view_box: str
    floor: PlanShape
    rooms: tuple[RoomFloor, ...]  # of a home; () where the scene is one room
    walls: str  # path data
    cells: str  # path data, a dot each
    shapes: tuple[PlanShape, ...]
    areas: tuple[AreaMark, ...]
    edges: tuple[Edge, ...]


def plan_of(scene: Scene, graph: SceneGraph | None) -> RoomPlan:
    """Return the drawing of a room.

    The scene is as at reset; the graph is long-term memory of it.
    """
    (x, _, z), (width, _, depth) = scene.bounds_center, scene.bounds_size
    left, top = _cm(x - width / 2), _cm(-(z + depth / 2))
    floor = PlanShape(
        title=scene.room, x=left, y=top, width=_cm(width), height=_cm(depth),
        high=False, label="", label_size=0.0, upright=False,
    )  # fmt: skip
    box = (
        left - MARGIN_CM,
        top - MARGIN_CM,
        _cm(width) + 2 * MARGIN_CM,
        _cm(depth) + 2 * MARGIN_CM,
    )
    areas = _areas(graph)
    return RoomPlan(
        scene=scene.name,
        room=scene.room,
        view_box=" ".join(f"{value:g}" for value in box),
        floor=floor,
        rooms=tuple(_floors(scene)),
        walls="".join(_walls(scene)),
        cells="".join(f"M{_cm(x):g} {_cm(-z):g}h0" for x, z in scene.reachable),
        shapes=tuple(_shapes(scene)),
        areas=areas,
        edges=tuple(_edges(areas)),
    )


def _floors(scene: Scene) -> Iterable[RoomFloor]:
    for room in scene.rooms or ():
        xs, zs = zip(*room.corners, strict=True)
        yield RoomFloor(
            name=room.name,
            points=" ".join(f"{_cm(x):g},{_cm(-z):g}" for x, z in room.corners),
            x=_cm((min(xs) + max(xs)) / 2),
            y=_cm(-(min(zs) + max(zs)) / 2),
        )


def _walls(scene: Scene) -> Iterable[str]:
    for wall in scene.walls or ():
        (left, _, near), (right, _, far) = wall.low, wall.high
        yield f"M{_cm(left):g} {_cm(-far):g}H{_cm(right):g}V{_cm(-near):g}H{_cm(left):g}Z"


def _shapes(scene: Scene) -> Iterable[PlanShape]:
    """Yield the furniture, the lowest first; labels that would lie on others are left out."""
    big = [one for one in scene.objects if _is_furniture(one)]
    big.sort(key=lambda one: (one.center[1] + one.size[1] / 2, one.id))
    shapes = [_shape(scene, thing) for thing in big]
    taken: list[PlanShape] = []
    for shape in sorted(shapes, key=lambda one: (one.high, -one.width * one.height, one.title)):
        if shape.label and not any(_clash(shape, other) for other in taken):
            taken.append(shape)
    named = {id(shape) for shape in taken}
    return (shape if id(shape) in named else replace(shape, label="") for shape in shapes)


def _clash(one: PlanShape, other: PlanShape) -> bool:
    """Return whether two labels overlap."""
    gaps = (
        abs(one.x + one.width / 2 - other.x - other.width / 2),
        abs(one.y + one.height / 2 - other.y - other.height / 2),
    )
    return all(
        gap < (mine + theirs) / 2
        for gap, mine, theirs in zip(gaps, _extent(one), _extent(other), strict=True)
    )


def _extent(shape: PlanShape) -> tuple[float, float]:
    """Return width and height of a label."""
    long, high = len(shape.label) * shape.label_size * LABEL_CM, shape.label_size * 1.1
    return (high, long) if shape.upright else (long, high)


def _is_furniture(thing: SceneObject) -> bool:
    large = thing.size[0] * thing.size[2] >= SMALL_M2
    return large and thing.type != FLOOR and "pickupable" not in thing.capabilities


def _shape(scene: Scene, thing: SceneObject) -> PlanShape:
    (x, y, z), (width, height, depth) = thing.center, thing.size
    upright = depth > width * 1.25
    along = _cm(max(width, depth) if upright else width)
    size = min(MOST_CM, along / max(len(thing.type), 1) / LABEL_CM, _cm(min(width, depth)) * 0.8)
    return PlanShape(
        title=thing.type,
        x=_cm(x - width / 2),
        y=_cm(-(z + depth / 2)),
        width=_cm(width),
        height=_cm(depth),
        high=y - height / 2 - scene.floor_y > HIGH_M,
        label=thing.type if size >= LEAST_CM else "",
        label_size=round(size, 1),
        upright=upright,
    )


def _areas(graph: SceneGraph | None) -> tuple[AreaMark, ...]:
    if graph is None:
        return ()
    return tuple(
        AreaMark(
            name=area.name,
            x=_cm(area.position_m[0]),
            y=_cm(-area.position_m[2]),
            contains=area.contains,
            adjacent=area.adjacent,
        )
        for area in graph.areas()
    )


def _edges(areas: Sequence[AreaMark]) -> Iterable[Edge]:
    at = {area.name: area for area in areas}
    rank = {area.name: number for number, area in enumerate(areas)}
    for area in areas:
        for other in area.adjacent:
            if rank[other] > rank[area.name]:
                yield Edge(x1=area.x, y1=area.y, x2=at[other].x, y2=at[other].y)


def _cm(metres: float) -> float:
    return round(metres * 100, 1) + 0.0
