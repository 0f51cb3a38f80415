"""Infer which receptacle each movable object lies in at the start, which ALFRED does not say.

Of the rules below the first that applies decides; the figures are in docs/replays.md.
1. The planner names the receptacle at the object's first pickup.
2. The object reaches, whichever way it is turned, into the box of a larger vessel (plate, mug, box
   ...) at its height. AI2-THOR's volumes of vessels are generous: demonstrators move a cup to
   bring the spoon that lies against it. What they fetch by itself, after the vessel was taken
   away, had not come along.
3. It is the one that most of the nearest labelled positions of the room have, of those within
   `NEAR_M` across and `LEVEL_M` in height.
4. The object rests on, or lies within, the box of a fixed receptacle; the smallest such box.
None of them puts what the demonstrator picked up behind a door not opened before: it was in view.
Nothing else is assumed: the rest lies in no receptacle. What takes one thing at a time (a burner,
a coffee machine, a hanger) is filled by rule 1 only: a wrong guess would leave no room in it.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from karma.contracts import Vec3
from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.world.alfred.facts import RoomFacts
from karma.world.alfred.trial import LabelledSpot, Trial
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.thing import bottom, gaps, top

NEAR_M, LEVEL_M = 0.2, 0.08
_VOTES = 5
_BELOW_M, _ABOVE_M = 0.03, 0.12  # of a surface's height to what rests on it
_BESIDE_M = 0.05
_SEAT_SHARE = 0.3  # of a sofa's height: its box goes up to the back, things lie lower
_OVER_VESSEL_M = 0.08


def contained(
    trial: Trial,
    facts: RoomFacts,
    furniture: Sequence[SceneObject],
    movables: Sequence[SceneObject],
) -> dict[str, str]:
    """Return the receptacle of each movable object that has one, id -> id."""
    places = {thing.id: thing for thing in furniture if "receptacle" in thing.capabilities}
    hide = rules().view.hides_when_closed
    doors = frozenset(
        one for one, p in places.items() if p.type in hide and "openable" in p.capabilities
    )
    own = {spot.thing: spot.receptacle for spot in facts.spots if spot.trial == trial.id}
    opened, taken = (_before_handled(trial, name) for name in ("OpenObject", "PickupObject"))
    spots = [spot for spot in facts.spots if spot.receptacle in places]
    found = {}
    for thing in movables:
        shut = doors - opened[thing.id] if thing.id in opened else frozenset()
        label = own.get(thing.id)
        if label in places and label not in shut:
            found[thing.id] = label
            continue
        vessel = _vessel(thing, movables, taken) if label is None else None
        if vessel is not None:
            found[thing.id] = vessel
            continue
        fits = {one: place for one, place in places.items() if one not in shut}
        guess = _voted(thing, trial.id, spots, fits) or _resting(thing.position, fits)
        if guess is not None and not object_types()[places[guess].type].accepts_only:
            found[thing.id] = guess
    return found


def _before_handled(trial: Trial, action: str) -> dict[str, frozenset[str]]:
    """Return what an action had been done on when each object was first handled."""
    done: set[str] = set()
    found: dict[str, frozenset[str]] = {}
    for low in trial.plan.low_actions:
        step = low.api_action
        if step.action in ("PickupObject", "SliceObject") and step.object_id:
            found.setdefault(step.object_id, frozenset(done))
        if step.action == action and step.object_id:
            done.add(step.object_id)
    return found


def _vessel(
    thing: SceneObject, movables: Sequence[SceneObject], taken: Mapping[str, frozenset[str]]
) -> str | None:
    """Return the vessel whose box a thing is deepest in; not one taken before the thing was."""
    found = []
    for other in movables:
        if other.id in taken.get(thing.id, ()):
            continue
        if "receptacle" not in other.capabilities or _volume(other) <= _volume(thing):
            continue
        reach = max(thing.size[0], thing.size[2]) / 2  # whichever way it is turned
        apart = [abs(thing.center[i] - other.center[i]) - other.size[i] / 2 for i in (0, 2)]
        low, high = bottom(other) - _BELOW_M, top(other) + _OVER_VESSEL_M
        if max(apart) < reach and low <= bottom(thing) <= high:
            found.append((round(max(apart), 6), other.id))
    return min(found)[1] if found else None


def _volume(thing: SceneObject) -> float:
    return round(math.prod(thing.size), 9)


def _voted(
    thing: SceneObject,
    trial: str,
    spots: Sequence[LabelledSpot],
    places: Mapping[str, SceneObject],
) -> str | None:
    """Return the receptacle that most of the nearest labels have; the nearest of equals."""
    x, y, z = thing.position
    far = sorted(
        (math.hypot(spot.x - x, spot.z - z), spot.receptacle)
        for spot in spots
        if spot.receptacle in places
        and abs(spot.y - y) <= LEVEL_M
        and (spot.trial, spot.thing) != (trial, thing.id)
    )
    near = [receptacle for gap, receptacle in far[:_VOTES] if gap <= NEAR_M]
    return Counter(near).most_common(1)[0][0] if near else None


def _resting(position: Vec3, places: Mapping[str, SceneObject]) -> str | None:
    """Return the fixed receptacle on or in whose box a position is."""
    found = []
    for place in places.values():
        rank = _rank(position, place)
        if rank is not None:
            found.append((*rank, place.id))
    return min(found)[-1] if found else None


def _rank(position: Vec3, place: SceneObject) -> tuple[bool, bool, float] | None:
    """Return how well a position fits a receptacle, less is better; None = not at all."""
    if place.type == FLOOR:
        return None
    x, y, z = position
    across, along = gaps(place, x, z)
    if math.hypot(across, along) > _BESIDE_M:
        return None
    low, high = bottom(place), top(place)
    beside = across > 0 or along > 0
    if place.type in rules().put.inside:
        fits = low - _BELOW_M <= y <= max(high - 0.02, low + 0.05)
        return (False, beside, _volume(place)) if fits else None
    if -_BELOW_M <= y - high <= _ABOVE_M:
        return (False, beside, _volume(place))
    seat = low + _SEAT_SHARE * (high - low)
    return (True, beside, _volume(place)) if seat <= y <= high else None
