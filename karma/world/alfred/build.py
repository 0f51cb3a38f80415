"""Build an episode's scene: fixed objects from the room's facts, movable ones from the trial."""

from collections.abc import Mapping, Sequence

import msgspec

from karma.household.ids import type_of
from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.world.alfred.contents import contained
from karma.world.alfred.facts import RoomFacts, middling
from karma.world.alfred.furniture import furnished
from karma.world.alfred.ids import type_now
from karma.world.alfred.steps import STEP_M
from karma.world.alfred.trial import SpawnPose, Trial
from karma.world.core.boxes import Box
from karma.world.core.posing import posed
from karma.world.core.scene import AgentPose, Scene, SceneObject, check
from karma.world.core.thing import turned
from karma.world.importing.scenes import ORIGIN_M, room_box, room_by_name, room_by_things


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
    boxes = (Box.around(thing.center, thing.size) for thing in things if thing.type != FLOOR)
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
