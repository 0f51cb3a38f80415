"""Tell from a recording's first event what is about to fall through the basin it lies in.

An id keeps where its object was made, to a centimetre. In three of the 104 rooms at reset what was
made in a basin lies lower by then, and below the basin's lower side, all of it equally; in two
more it has left the basin and hangs in the pipes. Nothing else in basins has sunk below them.
"""

from collections.abc import Iterable

import msgspec

from karma.household.ids import made_at
from karma.household.uses import BASINS
from karma.world.core.scene import SceneObject
from karma.world.core.thing import bottom, gaps

_SUNK_M = 0.0065  # more than an id's rounding
_FLOOR_M = 0.03  # of a basin: what was made on it was made no farther below its lower side


def with_falling(things: Iterable[SceneObject]) -> tuple[SceneObject, ...]:
    """Return the objects, with those that sink through a basin in nothing, and falling."""
    every = tuple(things)
    basins = [one for one in every if one.type in BASINS]
    return tuple(
        msgspec.structs.replace(one, parents=(), is_falling=True)
        if any(_sinks_through(one, basin) for basin in basins)
        else one
        for one in every
    )


def _sinks_through(thing: SceneObject, basin: SceneObject) -> bool:
    made, floor = made_at(thing.id), bottom(basin)
    if made is None or "pickupable" not in thing.capabilities:
        return False
    if thing.parents and basin.id not in thing.parents:
        return False
    x, y, z = thing.position
    over = max(gaps(basin, x, z)) <= 0.0
    return over and made[1] - y > _SUNK_M and made[1] > floor - _FLOOR_M and bottom(thing) < floor
