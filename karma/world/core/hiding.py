"""Tell which objects hide others, and where boxes are open: nothing is drawn there, nor hides.

Closed containers and solid boxes hide; pieces hide nothing. Basins are let into worktops and sinks;
and the one box of a worktop that goes round a corner, or stands out over what is built in beneath
it, spans floor on which people stand and look.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from karma.household.places import FLOOR
from karma.household.uses import BASIN_OF, BASINS, SINK
from karma.world.core.boxes import Box, Flags, Floats
from karma.world.core.ground import AGENT_RADIUS_M, Cell
from karma.world.core.objects import Derived, Objects, derived
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.thing import box_of, is_inert, is_loose

WORKTOP = "CounterTop"
_LET_INTO: Mapping[str, tuple[str, ...]] = {WORKTOP: (*BASIN_OF, *BASINS), SINK: (BASIN_OF[SINK],)}
_BELOW_M = 0.3  # how far under a worktop's box a basin may end
AHEAD_M = 0.55  # from a cell to the front of what is built in: a body, a step, a hand
EDGE_M = 0.05  # by which a worktop stands out over such a front


@derived("place")
def holes(objects: Objects) -> Mapping[str, tuple[Box, ...]]:
    """Return the boxes of the basins let into each worktop and sink that has some."""
    found = {one.id: tuple(_let_in(objects, one)) for one in objects.of_types(*_LET_INTO)}
    return {object_id: boxes for object_id, boxes in found.items() if boxes}


def _let_in(objects: Objects, thing: SceneObject) -> Iterator[Box]:
    own = box_of(thing)
    for other in map(box_of, objects.of_types(*_LET_INTO[thing.type])):
        level = own.y0 - _BELOW_M < other.y1 and other.y0 < own.y1
        if level and own.overlaps(other._replace(y0=own.y0, y1=own.y1)):
            yield other


@derived("place")
def holes_by_row(objects: Objects) -> Mapping[int, Floats]:
    """Return the ground of the holes by the row of what they are in, each x0, z0, x1, z1."""
    return {
        objects.rows[object_id]: np.array([(b.x0, b.z0, b.x1, b.z1) for b in boxes])
        for object_id, boxes in holes(objects).items()
    }


def walked_in(things: Iterable[SceneObject], cells: Sequence[Cell]) -> Mapping[str, Floats]:
    """Return the floor within worktops' boxes, by their ids, each x0, z0, x1, z1; shape (n, 4).

    It reaches as far as the agent's body on the cells, and on from there to a worktop's edge, which
    is at the fronts of what is built in beneath it.
    """
    every = tuple(things)
    places = np.array(cells, dtype=float).reshape(-1, 2)
    found = {}
    for thing in every:
        if thing.type != WORKTOP:
            continue
        own = box_of(thing)
        fronts = np.array([(b.x0, b.z0, b.x1, b.z1) for b in built_in(own, every)]).reshape(-1, 4)
        grounds = _before(fronts, places[_near(places, own)])
        low, high = np.array((own.x0, own.z0)), np.array((own.x1, own.z1))
        inside = np.all((grounds[:, :2] < high) & (grounds[:, 2:] > low), axis=1)
        if inside.any():
            found[thing.id] = np.array(sorted(set(map(tuple, grounds[inside].tolist()))))
    return found


def built_in(worktop: Box, things: Iterable[SceneObject]) -> list[Box]:
    """Return the boxes of the fixed objects beneath a worktop."""
    boxes = [
        box_of(one) for one in things if one.type not in (FLOOR, WORKTOP) and not is_loose(one)
    ]
    return [b for b in boxes if b.y0 < worktop.y0 and worktop.overlaps(b._replace(y1=worktop.y1))]


def _near(places: Floats, box: Box) -> Flags:
    gap_x = np.maximum(box.x0 - places[:, 0], places[:, 0] - box.x1)
    gap_z = np.maximum(box.z0 - places[:, 1], places[:, 1] - box.z1)
    near: Flags = np.maximum(gap_x, gap_z) < AHEAD_M
    return near


def _before(fronts: Floats, places: Floats) -> Floats:
    """Return the ground that the agent's body takes on cells, grown to the fronts it stands at.

    Along fronts in a row it goes on to their ends: a worktop's edge is straight there. Fronts are
    x0, z0, x1, z1, shape (n, 4), places (m, 2), what is returned (m + strips, 4).
    """
    r = AGENT_RADIUS_M
    found = np.concatenate([places - r, places + r], axis=1)
    if not len(fronts):
        return found
    strips = []
    for axis in (0, 1):
        other = 1 - axis
        beside = (fronts[None, :, other] < places[:, other, None] + r) & (
            fronts[None, :, other + 2] > places[:, other, None] - r
        )
        for sign, face, end in ((1, axis, axis + 2), (-1, axis + 2, axis)):
            gap = sign * (fronts[None, :, face] - places[:, axis, None])
            gap = np.where(beside & (gap > r - EDGE_M), gap, np.inf)
            nearest = gap.min(axis=1)
            stands, row = nearest <= AHEAD_M, gap <= nearest[:, None] + EDGE_M
            reach = np.where(stands, np.maximum(nearest - EDGE_M, r), r)
            found[:, end] = places[:, axis] + sign * reach
            strip = found.copy()
            strip[:, other] = np.where(row, fronts[None, :, other], np.inf).min(axis=1)
            strip[:, other + 2] = np.where(row, fronts[None, :, other + 2], -np.inf).max(axis=1)
            strips.append(strip[stands])
    return np.concatenate([found, *strips])


_WHOLE = (0.0, 1.0)


@derived("place")
def solid_boxes(objects: Objects) -> tuple[Floats, Floats]:
    """Return lower and upper corners of the part of each box that hides what is behind it."""
    table = rules().view.solid
    part = np.array([table.get(t.type, _WHOLE) for t in objects.values()]).reshape(-1, 2)
    low, high = objects.boxes.low.copy(), objects.boxes.high.copy()
    height = high[:, 1] - low[:, 1]
    low[:, 1], high[:, 1] = low[:, 1] + part[:, 0] * height, low[:, 1] + part[:, 1] * height
    return low, high


@derived("inert")
def inert_rows(objects: Objects) -> Flags:
    """Return whether each object has been replaced by its pieces, shape (n,)."""
    return np.array([is_inert(thing) for thing in objects.values()], dtype=bool)


@derived("parents", "inert", "open")
def hidden_rows(objects: Objects) -> Flags:
    """Return whether each object lies in something closed, or is no longer there, shape (n,)."""
    view, containment = rules().view, objects.containment
    shut = {
        one.id
        for one in objects.of_types(*view.hides_when_closed)
        if "openable" in one.capabilities and one.openness <= 0
    }
    found = inert_rows(objects).copy()
    found[[objects.rows[one.id] for one in objects.of_types(*view.never)]] = True
    for container in shut:
        for child in containment.inside(container):
            if container in containment.nearest(child):
                found[objects.rows[child]] = True
    return found


# rows of `blocking` that have been worked out
_rows_known: Derived[dict[int, Flags]] = Derived(
    lambda objects: {}, "place", "parents", "inert", "open", "held"
)
_fixed: Derived[Flags] = Derived(lambda all_: np.array([not is_loose(t) for t in all_.values()]))


def blocking(objects: Objects, rows: Sequence[int] | NDArray[np.intp]) -> Flags:
    """Return for [t, o] whether object o can hide the object of row t, shape (rows, n).

    Never itself, its contents, what it lies in, or a box that its own centre is inside of
    (boxes are coarser than meshes there).
    """
    known = _rows_known(objects)
    numbers = [int(row) for row in rows]
    new = list(dict.fromkeys(row for row in numbers if row not in known))
    if new:
        known.update(zip(new, _worked_out(objects, new), strict=True))
    found: Flags = np.array([known[row] for row in numbers], dtype=bool)
    return found.reshape(len(numbers), len(objects))


def _worked_out(objects: Objects, rows: Sequence[int]) -> Flags:
    boxes, containment = objects.boxes, objects.containment
    center, low, high = boxes.center[rows, None], boxes.low[None] - 0.05, boxes.high[None] + 0.05
    found: Flags = ~np.all((center >= low) & (center <= high), axis=2)
    found &= ~inert_rows(objects)[None]
    names = tuple(objects)
    for at, row in enumerate(rows):
        object_id = names[row]
        kin = (*containment.around(object_id), *containment.inside(object_id))
        found[at, [row, *(objects.rows[other] for other in kin)]] = False
        for holder in _open_holders(objects, object_id):
            found[at, _built_round(objects, objects.rows[holder])] = False
    return found


def _open_holders(objects: Objects, object_id: str) -> list[str]:
    """Return the open doors and drawers that an object lies behind."""
    around = objects.containment.around
    return [
        other
        for other in around(object_id)
        if "openable" in (thing := objects[other]).capabilities
        and "pickupable" not in thing.capabilities
        and thing.openness > 0
        and object_id not in around(other)
    ]


def _built_round(objects: Objects, row: int) -> Flags:
    """Return the fixed boxes that adjoin a container: an open one shows its contents past them.

    Drawers do not slide out and doors do not swing here, so the worktop over an open drawer
    would hide what a robot in front of the real one sees.
    """
    low, high = objects.boxes.low, objects.boxes.high
    touch: Flags = np.all((low <= high[row] + 0.06) & (high >= low[row] - 0.06), axis=1)
    return touch & _fixed(objects)
