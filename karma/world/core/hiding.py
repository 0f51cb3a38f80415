"""Tell which objects hide others: closed containers, solid boxes; pieces hide nothing."""

import numpy as np

from karma.world.core.arrays import Flags, Floats
from karma.world.core.objects import Objects, derived
from karma.world.core.rules import rules
from karma.world.core.thing import is_inert

_WHOLE = (0.0, 1.0)
_LOOSE = frozenset({"pickupable", "moveable"})


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
        object_id
        for kind in view.hides_when_closed
        for object_id in objects.by_type.get(kind, ())
        if "openable" in objects[object_id].capabilities and objects[object_id].openness <= 0
    }
    found = inert_rows(objects).copy()
    for kind in view.never:
        found[[objects.rows[object_id] for object_id in objects.by_type.get(kind, ())]] = True
    for container in shut:
        for child in containment.inside(container):
            if container in containment.nearest(child):
                found[objects.rows[child]] = True
    return found


@derived("place", "parents", "inert", "open", "held")
def blocking(objects: Objects) -> Flags:
    """Return for [t, o] whether object o can hide object t, shape (n, n).

    Never itself, its contents, what it lies in, or a box that its own centre is inside of
    (boxes are coarser than meshes there).
    """
    boxes, around = objects.boxes, objects.containment.around
    center, low, high = boxes.center[:, None], boxes.low[None] - 0.05, boxes.high[None] + 0.05
    found: Flags = ~np.all((center >= low) & (center <= high), axis=2)
    found &= ~inert_rows(objects)[None]
    for object_id, row in objects.rows.items():
        if objects[object_id].parents:
            others = [objects.rows[other] for other in around(object_id)]
            found[row, others] = False
            found[others, row] = False
    for object_id, row in objects.rows.items():
        for holder in _open_holders(objects, object_id):
            found[row, _built_round(objects, objects.rows[holder])] = False
    np.fill_diagonal(found, False)
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


@derived()
def _fixed(objects: Objects) -> Flags:
    return np.array([_LOOSE.isdisjoint(thing.capabilities) for thing in objects.values()])
