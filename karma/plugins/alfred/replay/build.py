"""Build an episode's scene: fixed objects from the room's facts, movable ones from the trial."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import msgspec

from karma.household.ids import type_of
from karma.household.places import FLOOR
from karma.household.types import object_types, type_now
from karma.plugins.alfred.replay.facts import LabelledSpot, RoomFacts, middling
from karma.plugins.alfred.replay.furniture import furnished
from karma.plugins.alfred.replay.steps import STEP_M
from karma.plugins.alfred.replay.trial import SpawnPose, Trial
from karma.plugins.thor_tools.importing.scenes import (
    ORIGIN_M,
    room_box,
    room_by_name,
    room_by_things,
)
from karma.types.space import Vec3
from karma.world.core.posing import posed
from karma.world.core.rules import rules
from karma.world.core.scene import AgentPose, Scene, SceneObject, check
from karma.world.core.thing import bottom, box_of, gaps, top, turned


def build(trial: Trial, facts: RoomFacts, *, widened: Mapping[str, float] | None = None) -> Scene:
    """Return the room of a trial at its start.

    The facts are of its FloorPlan, with this trial among those gathered. Boxes of `widened`
    receptacles are so many times larger across the floor.

    Raises:
        FileError: the trial contradicts itself; the path is its id.
    """
    start = trial.scene.init_action
    floor_y = round(start.y - ORIGIN_M, 4) if facts.dump is None else facts.dump.floor_y
    poses = {pose.id: pose for pose in trial.scene.object_poses if type_now(pose.kind)}
    kinds = frozenset(type_now(pose.kind) or "" for pose in poses.values())
    fixed = furnished(facts, floor_y, kinds)
    fixed = [_wider(thing, widened) for thing in fixed if thing.id not in poses]
    movables = [_movable(pose, facts) for pose in poses.values()]
    parents = contained(trial, facts, fixed, movables)
    movables = [_wider(thing, widened) for thing in movables]
    loose = [_in(thing, parents) for thing in movables]
    things = _named_apart([_at_start(thing, trial) for thing in (*fixed, *loose)])
    cells = facts.cells
    boxes = (box_of(thing) for thing in things if thing.type != FLOOR)
    box = room_box(boxes, floor_y, cells)
    scene = Scene(
        name=facts.name,
        room=room_by_name(facts.name)
        or room_by_things([{"objectType": thing.type} for thing in things]),
        source=f"ALFRED {trial.id}",
        rules="thor-2.1.0",
        floor_y=floor_y,
        grid_m=STEP_M,
        agent=AgentPose(
            position=(start.x, start.y, start.z), yaw=start.rotation % 360, horizon=start.horizon
        ),
        reachable=cells,
        bounds_center=box.center,
        bounds_size=box.size,
        objects=tuple(things),
    )
    check(scene, trial.id)
    return scene


# ----------------------------------------------------------------- movable objects


def _movable(pose: SpawnPose, facts: RoomFacts) -> SceneObject:
    """Return an object at its pose, shaped as one of its type: of this room, of any, or typical."""
    kind = type_now(pose.kind) or ""
    here = () if facts.dump is None else facts.dump.objects
    model = middling(thing for thing in here if thing.type == kind) or facts.models.get(kind)
    place, turn = pose.position.tuple, pose.rotation.tuple
    row = object_types()[kind]
    if model is None:
        x, y, z = place
        made = SceneObject(
            id=pose.id, type=kind, name=pose.id, position=place, size=row.size_m,
            center=(x, y + row.size_m[1] / 2, z),
        )  # fmt: skip
        made = turned(made, turn[1], place)
    else:
        made = posed(model, place, turn)
    return msgspec.structs.replace(
        made,
        id=pose.id,
        type=kind,
        name=pose.object_name,
        position=place,
        rotation=turn,
        capabilities=row.capabilities,
        mass_kg=row.mass_kg if model is None else model.mass_kg,
        materials=row.materials if model is None else model.materials,
        parents=(),
        openness=1.0 if row.starts_open and "openable" in row.capabilities else 0.0,
        temperature="RoomTemp",
        is_toggled=row.starts_on,
        is_broken=False,
        is_dirty=False,
    )


def _in(thing: SceneObject, parents: Mapping[str, str]) -> SceneObject:
    """Return an object in its receptacle, and where that is a vessel, in the vessel's too."""
    chain = []
    above = parents.get(thing.id)
    while above is not None and above not in chain:
        chain.append(above)
        above = parents.get(above)
    return msgspec.structs.replace(thing, parents=tuple(chain))


def _wider(thing: SceneObject, widened: Mapping[str, float] | None) -> SceneObject:
    factor = (widened or {}).get(thing.id)
    if factor is None:
        return thing
    x, y, z = thing.size
    return msgspec.structs.replace(thing, size=(x * factor, y, z * factor), corners=None)


# ----------------------------------------------------------------- states


def _at_start(thing: SceneObject, trial: Trial) -> SceneObject:
    """Return an object in the state that the trial says its type is in."""
    change: dict[str, bool | None] = {}
    for toggle in trial.scene.object_toggles:
        if type_of(thing.id) == toggle.object_type or thing.type == toggle.object_type:
            change["is_toggled"] = toggle.is_on
    if trial.scene.dirty_and_empty:
        if "dirtyable" in thing.capabilities:
            change["is_dirty"] = True
        if "canFillWithLiquid" in thing.capabilities:
            change |= {"is_filled": False, "liquid": None}
    return msgspec.structs.replace(thing, **change) if change else thing


def _named_apart(things: Sequence[SceneObject]) -> list[SceneObject]:
    """Return the objects with unique names: copies share their model's name in ALFRED."""
    taken: set[str] = set()
    found = []
    for thing in things:
        name = thing.name if thing.name not in taken else f"{thing.name}({thing.id})"
        taken.add(name)
        found.append(thing if name == thing.name else msgspec.structs.replace(thing, name=name))
    return found


NEAR_M, LEVEL_M = 0.2, 0.08
_VOTES = 5
_BELOW_M, _ABOVE_M = 0.03, 0.12  # of a surface's height to what rests on it
_BESIDE_M = 0.05
_SEAT_SHARE = 0.3  # of a sofa's height: its box goes up to the back, things lie lower
_OVER_VESSEL_M = 0.08


# ----------------------------------------------------------------- what lies in what


def contained(
    trial: Trial,
    facts: RoomFacts,
    furniture: Sequence[SceneObject],
    movables: Sequence[SceneObject],
) -> dict[str, str]:
    """Return the receptacle of each movable object that has one, id -> id; ALFRED does not say.

    Of the rules below the first that applies decides; the figures: docs/plugins/alfred-replays.md.
    1. The planner names the receptacle at the object's first pickup.
    2. The object reaches, whichever way it is turned, into the box of a larger vessel (plate, mug,
       box ...) at its height. AI2-THOR's volumes of vessels are generous: demonstrators move a cup
       to bring the spoon that lies against it. What they fetch by itself, after the vessel was
       taken away, had not come along.
    3. It is the one that most of the nearest labelled positions of the room have, of those within
       `NEAR_M` across and `LEVEL_M` in height.
    4. The object rests on, or lies within, the box of a fixed receptacle; the smallest such box.
    None of them puts what the demonstrator picked up behind a door not opened before: it was in
    view. The rest lies in no receptacle. What takes one thing at a time (a burner, a coffee
    machine, a hanger) is filled by rule 1 only: a wrong guess would leave no room in it.
    """
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
