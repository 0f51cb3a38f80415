"""Say where basins are let into worktops and sinks: nothing is drawn there, nor hides what is."""

from collections.abc import Iterator, Mapping

import numpy as np

from karma.household.uses import BASIN_OF, BASINS, SINK
from karma.world.core.arrays import Floats
from karma.world.core.boxes import Box
from karma.world.core.objects import Objects, derived
from karma.world.core.scene import SceneObject

WORKTOP = "CounterTop"
_LET_INTO: Mapping[str, tuple[str, ...]] = {
    WORKTOP: (*BASIN_OF, *BASINS),
    SINK: (BASIN_OF[SINK],),
}
_BELOW_M = 0.3  # how far under a worktop's box a basin may end


@derived("place")
def holes(objects: Objects) -> Mapping[str, tuple[Box, ...]]:
    """Return the boxes of the basins let into each worktop and sink that has some."""
    found = {
        object_id: tuple(_let_in(objects, objects[object_id]))
        for kind in _LET_INTO
        for object_id in objects.by_type.get(kind, ())
    }
    return {object_id: boxes for object_id, boxes in found.items() if boxes}


def _let_in(objects: Objects, thing: SceneObject) -> Iterator[Box]:
    own = Box.around(thing.center, thing.size)
    for kind in _LET_INTO[thing.type]:
        for object_id in objects.by_type.get(kind, ()):
            other = Box.around(objects[object_id].center, objects[object_id].size)
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
