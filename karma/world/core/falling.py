"""Let what has slipped through the basin it lay in come down, by the clock of the world.

Some of AI2-THOR's basins have no floor: what is made in one sinks through it, past the pipes, into
the cabinet that the basin is built over, shut or not.
"""

from dataclasses import replace

import msgspec

from karma.contracts import Vec3
from karma.world.core.placement import land, lying_below, parents_in, resting
from karma.world.core.scene import SceneObject
from karma.world.core.state import WorldState
from karma.world.core.thing import GRAVITY_MS2, bottom, difference, moved, top

_PAST = (0.0, -0.05, 0.0)  # what it has slipped through does not catch it


def come_down(state: WorldState) -> WorldState:
    """Return the state with what has fallen for long enough lying where it comes to rest."""
    changes, still = dict[str, SceneObject](), set[str]()
    for object_id in sorted(state.falling):
        thing = state.objects.get(object_id)
        if thing is None or thing.parents or object_id in state.in_hand:  # taken away, or caught
            continue
        middle, holder = _rest(state, thing)
        if GRAVITY_MS2 / 2 * state.time_s**2 < thing.center[1] - middle[1]:
            still.add(object_id)
            continue
        there = moved(thing, difference(middle, thing.center))
        parents = () if holder is None else parents_in(state.objects, there, holder)
        changes[object_id] = msgspec.structs.replace(there, parents=parents)
    objects = state.objects.changed(changes) if changes else state.objects
    return replace(state, objects=objects, falling=frozenset(still))


def _rest(state: WorldState, thing: SceneObject) -> tuple[Vec3, str | None]:
    """Return where a thing's middle comes to rest, and in or on what."""
    x, y, z = thing.center
    round_it = [
        one
        for one in lying_below(state, x, z)
        if "openable" in one.capabilities and bottom(one) < bottom(thing) and y < top(one)
    ]
    if not round_it:
        return land(state, moved(thing, _PAST), x, z)
    holder = max(round_it, key=bottom)
    return (x, resting(thing, bottom(holder)), z), holder.id
