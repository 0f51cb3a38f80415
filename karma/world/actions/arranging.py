"""Put objects somewhere without a hand, also in places drawn by lot, or out of the world."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.seeds import stream
from karma.world.actions.moving import coordinates, lacks, unknown
from karma.world.core.arguments import ObjectPose, Place, TypeCount
from karma.world.core.navigate import interactable_poses
from karma.world.core.objects import Objects
from karma.world.core.placement import find_place, parents_in
from karma.world.core.posing import (
    collision,
    emptied,
    let_lie,
    posed,
    same_pose,
    vector,
    with_contents,
)
from karma.world.core.scene import SceneObject
from karma.world.core.state import Performed, Refusal, Result, WorldState, refuse
from karma.world.core.thing import bottom, difference, is_inert, is_loose, is_shut, moved


def place_at_point(
    state: WorldState,
    *,
    objectId: str,
    position: Place,
    rotation: Place | None = None,
    forceKinematic: bool = False,
) -> Result:
    """Put a thing so that its lower side is at a point; it falls on what is below."""
    if objectId not in state.objects:
        return unknown(objectId)
    thing = state.objects[objectId]
    if not is_loose(thing) or is_inert(thing):
        return Refusal(f"{thing.name} is neither pickupable nor moveable.")
    if objectId == state.held:
        return Refusal(f"{thing.name} is in the agent's hand; put or drop it instead.")
    there = posed(thing, thing.position, None if rotation is None else vector(rotation))
    x, y, z = vector(position)
    foot = (there.center[0], bottom(there), there.center[2])
    by, at = difference((x, y, z), foot), there.position
    there = posed(there, (at[0] + by[0], at[1] + by[1], at[2] + by[2]))
    refusal = collision(state, there)
    return refusal or Performed(let_lie(state, there, falls=not forceKinematic))


def teleport_object(
    state: WorldState,
    *,
    objectId: str,
    position: Place | None = None,
    positions: list[Place] | None = None,
    x: float | None = None,
    y: float | None = None,
    z: float | None = None,
    rotation: Place | None = None,
    forceAction: bool = False,
    forceKinematic: bool = False,
    allowTeleportOutOfHand: bool = False,
    makeUnbreakable: bool = False,
) -> Result:
    """Put an object's origin at a position, the first of several at which it is not stuck."""
    if objectId not in state.objects:
        return unknown(objectId)
    thing = state.objects[objectId]
    refusal = _cannot_go(state, thing, forceAction, allowTeleportOutOfHand)
    if refusal is not None:
        return refusal
    axes = coordinates(None, x, y, z)
    wanted = positions or ([position] if position is not None else [])
    wanted = wanted or ([Place(**axes)] if axes else [])  # type: ignore[typeddict-item]
    if not wanted:
        return lacks("TeleportObject", "position")
    refusal = None
    for one in wanted:
        turn = None if rotation is None else vector(rotation)
        there = posed(thing, vector(one, thing.position), turn)
        refusal = None if forceAction else collision(state, there)
        if refusal is None:
            if makeUnbreakable:
                firm = tuple(can for can in there.capabilities if can != "breakable")
                there = msgspec.structs.replace(there, capabilities=firm)
            falls = not forceKinematic and is_loose(thing)
            return Performed(let_lie(state, there, falls=falls))
    return refusal or Refusal("there is no position to teleport to")


def _cannot_go(
    state: WorldState, thing: SceneObject, force: bool, out_of_hand: bool
) -> Refusal | None:
    if is_inert(thing):
        return refuse("NullReferenceException", "Target object is not there any more.")
    if thing.id == state.held and not out_of_hand:
        return Refusal("Cannot teleport object in hand.")
    if not is_loose(thing) and not force:
        return Refusal(f"{thing.name} is neither pickupable nor moveable; forceAction moves it.")
    return None


# ----------------------------------------------------------------- all poses at once


def set_object_poses(
    state: WorldState, *, objectPoses: list[ObjectPose], placeStationary: bool = True
) -> Result:
    """Pose all loose objects by name: those not named go, those named again are copied.

    With placeStationary they stay where they are put, also in the air.
    """
    if not objectPoses:
        return Refusal("objectPoses must name at least one object.")
    by_name = {thing.name: thing for thing in state.objects.values() if is_loose(thing)}
    for one in objectPoses:
        if one["objectName"] not in by_name:
            name = one["objectName"][:200]
            return Refusal(f"No Pickupable or Moveable object of name {name} found in scene.")
    named = {one["objectName"] for one in objectPoses}
    gone = [thing.id for name, thing in by_name.items() if name not in named]
    state = _without(state, gone)
    wanted, fresh = _wanted(state, by_name, objectPoses)
    state = replace(state, objects=state.objects.changed(fresh))
    placed = {
        key: there
        for key, there in wanted.items()
        if there != state.objects[key] or key in fresh or not (there.parents or placeStationary)
    }
    if state.held in placed:
        state = emptied(state)
    state = replace(state, objects=state.objects.changed(placed))
    for there in sorted(wanted.values(), key=_lowest):
        if there.id in placed or not placed.keys().isdisjoint(state.objects[there.id].parents):
            placed[there.id] = there
            state = let_lie(state, state.objects[there.id], falls=not placeStationary)
    return Performed(state)


def _lowest(thing: SceneObject) -> tuple[float, float, str]:
    """Order so that what holds others comes before them."""
    return (round(bottom(thing), 2), -thing.size[0] * thing.size[2], thing.id)


def _wanted(
    state: WorldState, by_name: dict[str, SceneObject], poses: list[ObjectPose]
) -> tuple[dict[str, SceneObject], dict[str, SceneObject]]:
    """Return all things in their poses, and of them the copies that repeated names ask for.

    A thing that is elsewhere now, or in the hand, lies in nothing until it is found out.
    """
    fresh: dict[str, SceneObject] = {}
    wanted: dict[str, SceneObject] = {}
    for one in poses:
        thing = state.objects[by_name[one["objectName"]].id]
        if thing.id in wanted:
            thing = copied(state.objects, thing, fresh)
            fresh[thing.id] = thing
        turn = vector(one["rotation"], thing.rotation)
        there = posed(thing, vector(one["position"], thing.position), turn)
        if same_pose(thing, there) and not thing.is_picked_up:
            wanted[thing.id] = thing
        else:
            wanted[thing.id] = msgspec.structs.replace(there, parents=(), is_picked_up=False)
    return wanted, fresh


def copied(objects: Objects, source: SceneObject, also: Iterable[str] = ()) -> SceneObject:
    """Return a copy of a thing, with an id and a name of its own, lying in nothing yet."""
    taken = {*objects, *also}
    number = next(n for n in range(1, len(taken) + 2) if f"{source.id}_copy_{n}" not in taken)
    return msgspec.structs.replace(
        source,
        id=f"{source.id}_copy_{number}",
        name=f"{source.name}_copy_{number}",
        parents=(),
        controls=(),
        is_picked_up=False,
    )


# ----------------------------------------------------------------- in and out of the world


def remove(
    state: WorldState, *, objectId: str | None = None, objectIds: list[str] | None = None
) -> Result:
    """Take objects out of the scene for good; what lay in them falls."""
    wanted = [*([] if objectId is None else [objectId]), *(objectIds or ())]
    if not wanted:
        return lacks("RemoveFromScene", "objectId")
    for one in wanted:
        if one not in state.objects:
            return unknown(one)
    return Performed(_without(state, wanted))


def disable(state: WorldState, *, objectId: str) -> Result:
    """Take an object out of the world until EnableObject; what lay in it falls."""
    if objectId not in state.objects:
        return unknown(objectId)
    thing = msgspec.structs.replace(state.objects[objectId], is_picked_up=False)
    after = _without(state, [objectId])
    return Performed(replace(after, disabled={**state.disabled, objectId: thing}))


def enable(state: WorldState, *, objectId: str) -> Result:
    """Bring a disabled object back where it was; nothing happens to one that is there."""
    if objectId in state.objects:
        return Performed(state)
    if objectId not in state.disabled:
        return unknown(objectId)
    rest = {key: thing for key, thing in state.disabled.items() if key != objectId}
    thing = state.disabled[objectId]
    parents = tuple(parent for parent in thing.parents if parent in state.objects)
    controls = tuple(other for other in thing.controls if other in state.objects)
    thing = msgspec.structs.replace(thing, parents=parents, controls=controls)
    after = replace(state, disabled=rest, objects=state.objects.changed({objectId: thing}))
    return Performed(after if parents or not is_loose(thing) else let_lie(after, thing, falls=True))


def _without(state: WorldState, ids: Iterable[str]) -> WorldState:
    """Return the state without some objects; what lay in them alone falls."""
    gone = frozenset(ids)
    orphans = [
        thing.id
        for thing in state.objects.values()
        if thing.id not in gone and thing.parents and gone.issuperset(thing.parents)
    ]
    kept = {
        thing.id: _forgetting(thing, gone)
        for thing in state.objects.values()
        if thing.id not in gone
    }
    if state.held in gone:
        state = emptied(state)
    until = {key: end for key, end in state.until_s.items() if key not in gone}
    state = replace(state, objects=Objects(kept), until_s=until)
    for object_id in orphans:
        if is_loose(state.objects[object_id]) and object_id != state.held:
            state = let_lie(state, state.objects[object_id], falls=True)
    return state


def _forgetting(thing: SceneObject, gone: frozenset[str]) -> SceneObject:
    fields: dict[str, Any] = {}
    if not gone.isdisjoint(thing.parents):
        fields["parents"] = tuple(parent for parent in thing.parents if parent not in gone)
    if not gone.isdisjoint(thing.controls):
        fields["controls"] = tuple(other for other in thing.controls if other not in gone)
    return msgspec.structs.replace(thing, **fields) if fields else thing


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
