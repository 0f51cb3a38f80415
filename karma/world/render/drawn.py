"""Turn the objects of a moment into triangles in the room."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.household.uses import BURNER
from karma.types.space import Vec3
from karma.world.core.boxes import Box, Floats
from karma.world.core.hiding import WORKTOP, hidden_rows, holes_by_row
from karma.world.core.objects import Objects
from karma.world.core.rays import own_frame
from karma.world.core.scene import SceneObject
from karma.world.core.thing import bottom, box_of, is_inert, is_shut
from karma.world.render.cases import SLIDE
from karma.world.render.form import LIQUIDS, WATER, Form, Front, Look, Rectangle, looks, pick, rgb
from karma.world.render.furniture import SURFACES
from karma.world.render.mesh import Mesh, box, joined
from karma.world.render.pixels import PIECES
from karma.world.render.shapes import shape

LEGS_M = 0.6  # shorter worktops need no legs
WIDE_M = 1.8  # wider ones go round a corner
SLIVER_M = 0.015
STAND_COLOUR = (96.0, 99.0, 104.0)
STRIP_M = 0.13  # narrower remains of a bent worktop are left out
REACH_M = 0.55  # the place before a front is this far from it
OWN_M = 0.2  # how much less free the side may be that the object's own turn names


class ObjectFrame(NamedTuple):
    """An upright or lying box: axes x, y, z as rows, the middle of its lower side, its sides."""

    axes: Floats  # (3, 3)
    foot: Floats  # (3,)
    size: Vec3  # along the own axes: width, height, depth


class DrawingTask(NamedTuple):
    """What one object's triangles depend on; equal tasks give equal triangles."""

    thing: SceneObject
    holes: tuple[Rectangle, ...] = ()  # of basins let in
    walked: tuple[Rectangle, ...] = ()  # floor within its box
    shift: Vec3 = (0.0, 0.0, 0.0)  # out with its drawer, or up onto what it lies on

    @property
    def owner(self) -> str | int:
        """What its pixels show: the object, or PIECES, which are no objects."""
        return PIECES if is_inert(self.thing) else self.thing.id

    def same(self, other: "DrawingTask") -> bool:
        """Return whether two tasks give the same triangles."""
        alike = self.thing is other.thing or _appearance(self.thing) == _appearance(other.thing)
        return alike and self[1:] == other[1:]


def _appearance(thing: SceneObject) -> tuple[object, ...]:
    return (
        thing.id, thing.type, thing.center, thing.size, thing.rotation, thing.corners,
        thing.openness, thing.is_toggled, thing.is_broken, thing.is_filled, thing.liquid,
        thing.is_dirty, thing.is_used_up, thing.is_cooked, thing.temperature,
    )  # fmt: skip


def tasks(objects: Objects, cells: Floats, walked: Mapping[str, Floats]) -> Iterator[DrawingTask]:
    """Yield a task for each object that shows: not the floor, not what is shut in or in pieces.

    `cells` are (x, z) where an agent can stand, shape (n, 2); `walked` comes from `walked_in`.
    """
    slides = _slides(objects, cells)
    lifts: dict[str, float] = {}
    hidden, let_in = hidden_rows(objects), holes_by_row(objects)
    for row, (object_id, thing) in enumerate(objects.items()):
        unseen = hidden[row] and thing.type != "TargetCircle" and not _lies_about(objects, thing)
        if thing.type == FLOOR or unseen:
            continue
        x, y, z = slides.get(object_id, (0.0, 0.0, 0.0))
        shift = (x, y + _lift(objects, object_id, lifts), z)
        basins, floor = _rectangles(let_in.get(row)), _rectangles(walked.get(object_id))
        yield DrawingTask(thing, basins, floor, shift)


def _rectangles(grounds: Floats | None) -> tuple[Rectangle, ...]:
    rows = [] if grounds is None else grounds.tolist()
    return tuple((x0, z0, x1, z1) for x0, z0, x1, z1 in rows)


def _lift(objects: Objects, object_id: str, known: dict[str, float]) -> float:
    """Return how far a thing must come up, with what it lies in, to lie on what is drawn."""
    if object_id in known:
        return known[object_id]
    thing = objects[object_id]
    known[object_id] = 0.0
    if "pickupable" not in thing.capabilities or not thing.parents:
        return 0.0
    under = objects[thing.parents[0]]
    surface = SURFACES.get(looks()[under.type].shape)
    if surface is None:
        known[object_id] = _lift(objects, under.id, known)
    else:
        level = bottom(under) + surface.level(under.size[1])
        deep = round(level - bottom(thing), 4)
        known[object_id] = deep if 0 < deep <= surface.lift_m else 0.0
    return known[object_id]


def _lies_about(objects: Objects, thing: SceneObject) -> bool:
    """Return whether an object is in pieces that are no objects, and not shut in."""
    if not is_inert(thing) or thing.is_sliced or object_types()[thing.type].slices_into:
        return False
    around = [objects[parent] for parent in thing.parents[:1]]
    for one in around:
        around += [objects[parent] for parent in one.parents[:1] if objects[parent] not in around]
    return not any(map(is_shut, around))


def _slides(objects: Objects, cells: Floats) -> dict[str, Vec3]:
    """Return how far the contents of open drawers have come out with them."""
    found: dict[str, Vec3] = {}
    for drawer in objects.of_types("Drawer"):
        if drawer.openness > 0:
            stand = frame(drawer, looks()["Drawer"], cells)
            x, y, z = stand.axes[2] * stand.size[2] * SLIDE * drawer.openness
            for child in objects.containment.inside(drawer.id):
                found[child] = (float(x), float(y), float(z))
    return found


def frame(thing: SceneObject, look: Look, cells: Floats) -> ObjectFrame:
    """Return the frame of an object among cells (x, z) where an agent can stand, shape (n, 2).

    Its front is where its yaw points ("turn"), or the side before which an agent can best stand
    ("room"), among those across the thinner ("thin") or along the longer side ("long"). What is
    laid has its longest side as depth and its shortest as height, as cutlery.
    """
    axes, size = own_frame(thing)
    if look.laid:
        axes, size = _sorted(axes, size)
    middle = np.array(thing.center)
    if thing.corners is not None:
        middle = np.array(thing.corners).mean(axis=0)
    quarters = _choices(size, look.front)
    if len(quarters) > 1 and len(cells):
        turn = _best(axes, size, middle, quarters, cells)
        axes, size = _quarter(axes, size, turn)
    elif quarters:
        axes, size = _quarter(axes, size, quarters[0])
    return ObjectFrame(axes, middle - axes[1] * size[1] / 2, size)


def _sorted(axes: Floats, size: Vec3) -> tuple[Floats, Vec3]:
    thin, middle, long = np.argsort(size, kind="stable")
    up = axes[thin] * (1.0 if axes[thin][1] >= 0 else -1.0)
    along = axes[long]
    return np.array([np.cross(up, along), up, along]), (size[middle], size[thin], size[long])


def _quarter(axes: Floats, size: Vec3, turn: int) -> tuple[Floats, Vec3]:
    """Return the frame seen from the side that a number of quarter turns names."""
    x, y, z = axes
    w, h, d = size
    turned = ((x, y, z), (-z, y, x), (-x, y, -z), (z, y, -x))[turn]
    return np.array(turned), ((w, h, d) if turn % 2 == 0 else (d, h, w))


def _choices(size: Vec3, front: Front) -> tuple[int, ...]:
    if front == "turn":
        return ()
    wide = size[0] >= size[2]
    if front == "room":
        return (0, 1, 2, 3)
    if front == "thin":
        return (0, 2) if wide else (1, 3)
    return (1, 3) if wide else (0, 2)


def _best(
    axes: Floats, size: Vec3, middle: Floats, quarters: tuple[int, ...], cells: Floats
) -> int:  # fmt: skip
    """Return the quarter turn whose front has cells nearest; the own one if nearly as good."""
    gaps = []
    for turn in quarters:
        facing, (_, _, depth) = _quarter(axes, size, turn)
        place = middle + facing[2] * (depth / 2 + REACH_M)
        gaps.append(float(np.hypot(*(cells - place[[0, 2]]).T).min()))
    best = min(gaps)
    if quarters[0] == 0 and gaps[0] <= best + OWN_M:
        return 0
    return quarters[gaps.index(best)]


def drawn(task: DrawingTask, cells: Floats, room_name: str) -> Mesh:
    """Return an object's triangles where they are in the room."""
    thing = task.thing
    look = looks()[thing.type]
    stand = frame(thing, look, cells)
    ground = _ground(task, stand)
    form = _form(thing, look, stand, ground, room_name)
    local = shape(look.shape, form, thing.temperature)
    place = (stand.foot + task.shift).astype(np.float32)
    return local._replace(vertices=local.vertices @ stand.axes.astype(np.float32) + place)


def _form(
    thing: SceneObject,
    look: Look,
    stand: ObjectFrame,
    ground: tuple[Rectangle, ...],
    room_name: str,
) -> Form:
    width, height, depth = (round(max(side, 0.002), 4) for side in stand.size)
    mains = look.colours
    main = mains[pick(len(mains), f"{room_name} {thing.type}" if look.alike else thing.id)]
    if thing.type == "Drawer":  # as the cabinets around it
        main = mains[pick(len(mains), f"{room_name} Cabinet")]
    return Form(
        style=look.style,
        width=width,
        height=height,
        depth=depth,
        main=rgb(main),
        second=rgb(look.second),
        third=rgb(look.third),
        openness=round(thing.openness, 3),
        on=thing.is_toggled,
        broken=thing.is_broken,
        filled=thing.is_filled,
        liquid=LIQUIDS.get(thing.liquid or "", WATER),
        dirty=thing.is_dirty,
        used_up=thing.is_used_up,
        cooked=thing.is_cooked,
        filled_parts=ground,
    )


# ------------------------------------------------------------------ what holds things up


def supports(objects: Objects, floor_y: float) -> tuple[Box, ...]:
    """Return the boxes under what would hang in the air: stoves, and worktops without cupboards.

    AI2-THOR shows them too, but they are no objects and stand in no metadata.
    """
    fixed = [
        box_of(thing)
        for thing in objects.values()
        if "pickupable" not in thing.capabilities and thing.type not in (FLOOR, BURNER)
    ]
    found = [_stove(group, floor_y) for group in _burners(objects)]
    found = [stove for stove in found if not any(_under(stove, box) for box in fixed)]
    for worktop in objects.of_types(WORKTOP):
        found += _legs(box_of(worktop), fixed, floor_y)
    return tuple(found)


def _burners(objects: Objects) -> list[list[Box]]:
    """Return the burners, those near to each other together."""
    groups: list[list[Box]] = []
    for burner in map(box_of, objects.of_types(BURNER)):
        wide = burner.grown(0.25, 0.3, 0.25)
        near = [group for group in groups if any(wide.overlaps(other) for other in group)]
        groups = [group for group in groups if group not in near]
        groups.append([burner, *(other for group in near for other in group)])
    return groups


def _stove(burners: list[Box], floor_y: float) -> Box:
    hull = Box.hull(burners)
    return hull.grown(0.05, 0.0, 0.05)._replace(y0=floor_y, y1=hull.y0)


def _under(stove: Box, other: Box) -> bool:
    """Return whether something low takes a good part of a stove's ground."""
    low = other.y0 < (stove.y0 + stove.y1) / 2
    return low and _shared(stove, other) > 0.2 * (stove.x1 - stove.x0) * (stove.z1 - stove.z0)


def _shared(one: Box, other: Box) -> float:
    """Return the ground that two boxes share, square metres."""
    wide = min(one.x1, other.x1) - max(one.x0, other.x0)
    deep = min(one.z1, other.z1) - max(one.z0, other.z0)
    return max(0.0, wide) * max(0.0, deep)


def _legs(top: Box, fixed: list[Box], floor_y: float) -> list[Box]:
    """Return legs at the corners of a worktop under which there is nearly nothing."""
    width, height, depth = top.size
    if max(width, depth) < LEGS_M or min(width, depth) > WIDE_M or height > 0.2:
        return []
    below = [box for box in fixed if box.y1 < top.y1 - 0.01 and box.y0 < top.y0 - 0.3]
    shared = sum(_shared(top, box) for box in below)
    if shared > 0.15 * width * depth or top.y0 - floor_y < 0.4:
        return []
    side = 0.05
    return [
        Box(x, floor_y, z, x + side, top.y0, z + side)
        for x in (top.x0 + 0.03, top.x1 - 0.03 - side)
        for z in (top.z0 + 0.03, top.z1 - 0.03 - side)
    ]


def support(boxes: tuple[Box, ...]) -> Mesh:
    """Return the triangles of supports."""
    return joined(
        box((one.x0, one.y0, one.z0), (one.x1, one.y1, one.z1), STAND_COLOUR) for one in boxes
    )


# ------------------------------------------------------------------ ground with holes


def _ground(task: DrawingTask, stand: ObjectFrame) -> tuple[Rectangle, ...]:
    """Return the parts of a worktop's or sink's box that it fills, in its own frame."""
    free = (*task.holes, *task.walked)
    if not free:
        return ()
    own = box_of(task.thing)
    least = STRIP_M if task.walked else SLIVER_M
    parts = _without((own.x0, own.z0, own.x1, own.z1), free)
    parts = [part for part in parts if min(part[2] - part[0], part[3] - part[1]) > least]
    found = []
    for x0, z0, x1, z1 in parts:
        corners = np.array([(x0, 0.0, z0), (x1, 0.0, z1)]) - stand.foot
        a, b = corners @ stand.axes.T
        low, high = np.minimum(a, b), np.maximum(a, b)
        found.append(tuple(round(float(v), 4) for v in (-high[0], low[2], -low[0], high[2])))
    return tuple(found)  # type: ignore[arg-type]


def _without(whole: Rectangle, holes: Sequence[Rectangle]) -> list[Rectangle]:
    """Return a rectangle less others, as strips along x that are as deep as can be."""
    x0, z0, x1, z1 = whole
    cuts = [
        (max(a, x0), max(b, z0), min(c, x1), min(d, z1))
        for a, b, c, d in holes
        if a < x1 and c > x0 and b < z1 and d > z0
    ]
    xs = np.array(sorted({x0, x1, *(c[0] for c in cuts), *(c[2] for c in cuts)}))
    zs = np.array(sorted({z0, z1, *(c[1] for c in cuts), *(c[3] for c in cuts)}))
    filled = np.ones((len(zs) - 1, len(xs) - 1), dtype=bool)
    for a, b, c, d in cuts:
        rows = slice(np.searchsorted(zs, b), np.searchsorted(zs, d))
        filled[rows, np.searchsorted(xs, a) : np.searchsorted(xs, c)] = False
    found: list[Rectangle] = []
    open_runs: dict[tuple[int, int], int] = {}
    for row in range(len(zs)):
        runs = _runs(filled[row]) if row < len(zs) - 1 else []
        for run in [run for run in open_runs if run not in runs]:
            start = open_runs.pop(run)
            found.append((float(xs[run[0]]), float(zs[start]), float(xs[run[1]]), float(zs[row])))
        for run in runs:
            open_runs.setdefault(run, row)
    return found


def _runs(row: np.ndarray) -> list[tuple[int, int]]:
    """Return (start, end) of each stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
