"""Tell which objects hide others: closed containers, solid boxes; pieces hide nothing."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from karma.world.core.arrays import Flags, Floats
from karma.world.core.objects import Derived, Objects, derived
from karma.world.core.rules import rules
from karma.world.core.thing import is_inert, is_loose

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
