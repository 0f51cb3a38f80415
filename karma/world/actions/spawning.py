"""Put things in places drawn by lot; the seed alone decides."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.seeds import stream
from karma.world.actions.teleporting import copied
from karma.world.core.arguments import TypeCount
from karma.world.core.navigate import interactable_poses
from karma.world.core.placement import find_place, parents_in
from karma.world.core.posing import emptied, let_lie, with_contents
from karma.world.core.scene import SceneObject
from karma.world.core.state import Performed, Refusal, Result, WorldState
from karma.world.core.thing import difference, is_inert, is_shut, moved

_MOST_OF_A_TYPE = 100


@dataclass(frozen=True, slots=True)
class _Lot:
    """How places are drawn."""

    rng: np.random.Generator
    places: Sequence[str]
    attempts: int


def lot(state: WorldState, seed: int | None, action: str) -> np.random.Generator:
    """Return the generator of one action; without a seed, that of SetRandomSeed."""
    return stream((state.seed if seed is None else seed) % 2**32, "actions", action)


def initial_random_spawn(
    state: WorldState,
    *,
    randomSeed: int | None = None,
    forceVisible: bool = False,
    placeStationary: bool = True,
    numDuplicatesOfType: list[TypeCount] | None = None,
    excludedReceptacles: list[str] | None = None,
    excludedObjectIds: list[str] | None = None,
    objectIds: list[str] | None = None,
    receptacleObjectIds: list[str] | None = None,
    numPlacementAttempts: int = 5,
    allowFloor: bool = False,
    allowMoveable: bool = False,
) -> Result:
    """Put pickupable things into or onto receptacles drawn by lot; all ids are kept.

    With allowMoveable what can only be pushed is put somewhere too. A thing for which no attempt
    finds room stays where it is; a copy is then not made.
    """
    if numPlacementAttempts <= 0:
        return Refusal("numPlacementAttempts must be a positive integer.")
    if state.held is not None:
        state = let_lie(emptied(state), state.objects[state.held], falls=True)
    barred = frozenset(excludedReceptacles or ()) | (frozenset() if allowFloor else {FLOOR})
    places = [
        place.id
        for place in state.objects.values()
        if "receptacle" in place.capabilities
        and place.type not in barred
        and (receptacleObjectIds is None or place.id in receptacleObjectIds)
        and not is_inert(place)
        and "pickupable" not in place.capabilities
        and not (forceVisible and is_shut(place))
    ]
    rng = lot(state, randomSeed, "InitialRandomSpawn")
    draw = _Lot(rng, places, numPlacementAttempts)
    spared = frozenset(excludedObjectIds or ())
    things = [thing.id for thing in state.objects.values() if _spawns(thing, allowMoveable)]
    for index in rng.permutation(len(things)):
        object_id = things[index]
        if object_id not in spared and (objectIds is None or object_id in objectIds):
            state = _spawned(state, state.objects[object_id], draw)
    for row in numDuplicatesOfType or ():
        kind = state.objects.by_type.get(row["objectType"], ())
        sources = [object_id for object_id in kind if object_id in things]
        state = _duplicated(state, sources, row["count"], draw)
    return Performed(state)


def _spawns(thing: SceneObject, moveable: bool) -> bool:
    return not is_inert(thing) and (
        "pickupable" in thing.capabilities or (moveable and "moveable" in thing.capabilities)
    )


def _duplicated(state: WorldState, sources: Sequence[str], count: int, draw: _Lot) -> WorldState:
    """Return the state with copies until there are as many of a type as asked for."""
    missing = min(count, _MOST_OF_A_TYPE) - len(sources)
    for number in range(missing if sources else 0):
        thing = copied(state.objects, state.objects[sources[number % len(sources)]])
        state = _spawned(state, thing, draw)
    return state


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
    without = replace(
        _from_somewhere(state, draw), held=thing.id if thing.id in state.objects else None
    )
    for index in order:
        holder = state.objects[fitting[index]]
        middle = find_place(without, thing, holder)
        if middle is not None:
            there = moved(thing, difference(middle, thing.center))
            parents = parents_in(state.objects, there, holder.id)
            there = msgspec.structs.replace(there, parents=parents)
            if thing.id not in state.objects:
                placed = replace(state, objects=state.objects.changed({thing.id: there}))
            else:
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
