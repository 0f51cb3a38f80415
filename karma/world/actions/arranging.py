"""Put objects into places drawn by lot."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.seeds import stream
from karma.world.core.navigate import interactable_poses
from karma.world.core.placement import find_place, land, parents_in
from karma.world.core.posing import released, with_contents
from karma.world.core.scene import SceneObject
from karma.world.core.state import Performed, Refusal, Result, WorldState
from karma.world.core.thing import difference, is_inert, is_shut, moved


@dataclass(frozen=True, slots=True)
class _Lot:
    """How places are drawn."""

    rng: np.random.Generator
    places: Sequence[str]
    attempts: int


def initial_random_spawn(
    state: WorldState,
    *,
    randomSeed: int | None = None,
    forceVisible: bool = False,
    placeStationary: bool = True,
    objectIds: list[str] | None = None,
    receptacleObjectIds: list[str] | None = None,
    numPlacementAttempts: int = 5,
) -> Result:
    """Put pickupable things into or onto receptacles drawn by lot; all ids are kept.

    A thing for which no attempt finds room stays where it is.
    """
    if numPlacementAttempts <= 0:
        return Refusal("numPlacementAttempts must be a positive integer.")
    if state.held is not None:
        x, _, z = state.objects[state.held].center
        state = released(state, *land(state, state.objects[state.held], x, z))
    places = [
        place.id
        for place in state.objects.values()
        if "receptacle" in place.capabilities
        and place.type != FLOOR
        and (receptacleObjectIds is None or place.id in receptacleObjectIds)
        and not is_inert(place)
        and "pickupable" not in place.capabilities
        and not (forceVisible and is_shut(place))
    ]
    seed = (state.seed if randomSeed is None else randomSeed) % 2**32
    rng = stream(seed, "actions", "InitialRandomSpawn")
    draw = _Lot(rng, places, numPlacementAttempts)
    things = [
        thing.id
        for thing in state.objects.values()
        if "pickupable" in thing.capabilities and not is_inert(thing)
    ]
    for index in rng.permutation(len(things)):
        object_id = things[index]
        if objectIds is None or object_id in objectIds:
            state = _spawned(state, state.objects[object_id], draw)
    return Performed(state)


def _spawned(state: WorldState, thing: SceneObject, draw: _Lot) -> WorldState:
    """Return the state with a thing in a place drawn by lot; as it is when none has room."""
    within = {thing.id, *state.objects.containment.inside(thing.id)}
    kind = object_types()[thing.type]
    fitting = [
        place
        for place in draw.places
        if place not in within
        and kind.fits(object_types()[state.objects[place].type], state.room.rules)
    ]
    order = draw.rng.permutation(len(fitting))[: draw.attempts]
    without = replace(_from_somewhere(state, draw), held=thing.id)
    for index in order:
        holder = state.objects[fitting[index]]
        middle = find_place(without, thing, holder)
        if middle is not None:
            there = moved(thing, difference(middle, thing.center))
            parents = parents_in(state.objects, there, holder.id)
            there = msgspec.structs.replace(there, parents=parents)
            placed = replace(state, objects=with_contents(state.objects, there))
            if _can_be_seen(placed, thing.id):
                return placed
    return state


def _can_be_seen(state: WorldState, object_id: str) -> bool:
    """Return whether a thing is in view from somewhere, once what it is shut in stands open.

    On a deep counter the place next to the agent may lie behind a plant as seen from everywhere.
    """
    around = state.objects.containment.around(object_id)
    if any(is_shut(state.objects[holder]) for holder in around):
        return True
    poses = interactable_poses(replace(state, held=None), object_id, standings=(True,), limit=1)
    return bool(poses)


def _from_somewhere(state: WorldState, draw: _Lot) -> WorldState:
    """Return the state with the agent on a cell drawn by lot: the free place next to it is used."""
    cells = list(state.cells.values())
    if not cells:
        return state
    x, z = cells[int(draw.rng.integers(len(cells)))]
    y = state.pose.position_m[1]
    return replace(state, pose=replace(state.pose, position_m=(x, y, z)))
