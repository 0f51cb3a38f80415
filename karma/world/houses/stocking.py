"""Give a home as many movable things as are wanted: more of what it has, or fewer."""

from dataclasses import replace
from hashlib import blake2b

import msgspec
import numpy as np

from karma.household.places import FLOOR
from karma.household.types import object_types
from karma.world.core.placement import find_place
from karma.world.core.scene import Scene, SceneObject
from karma.world.core.state import Settings, WorldState, begin
from karma.world.core.thing import difference, moved
from karma.world.generation.generate import object_id

_IN_VAIN = 40  # draws that find no room before a home counts as full


def stocked(scene: Scene, things: int | None, rng: np.random.Generator) -> Scene:
    """Return the scene with that many movable things, or as many as find room."""
    loose = [one for one in scene.objects if "pickupable" in one.capabilities]
    if things is None or things == len(loose):
        return scene
    if things < len(loose):
        return _fewer(scene, loose, len(loose) - things, rng)
    return _more(scene, loose, things - len(loose), rng)


def _fewer(scene: Scene, loose: list[SceneObject], number: int, rng: np.random.Generator) -> Scene:
    held = {parent for thing in scene.objects for parent in thing.parents}
    free = [thing.id for thing in loose if thing.id not in held]
    gone = {free[int(i)] for i in rng.permutation(len(free))[:number]}
    return msgspec.structs.replace(
        scene, objects=tuple(thing for thing in scene.objects if thing.id not in gone)
    )


def _more(scene: Scene, loose: list[SceneObject], number: int, rng: np.random.Generator) -> Scene:
    """Copy things that the home has, each onto or into furniture that takes it."""
    types = object_types()
    state = begin(scene, Settings(grid_m=scene.grid_m))
    places = [
        one for one in scene.objects
        if "receptacle" in one.capabilities and "pickupable" not in one.capabilities
        and "openable" not in one.capabilities and one.type != FLOOR
    ]  # fmt: skip
    names = {thing.name for thing in scene.objects}
    added: list[SceneObject] = []
    vain = 0
    while len(added) < number and vain < _IN_VAIN:
        model = loose[int(rng.integers(len(loose)))]
        fitting = [one for one in places if types[model.type].fits(types[one.type])]
        if fitting:
            place = fitting[int(rng.integers(len(fitting)))]
            copy = _copied(state, model, place, names)
            if copy is not None:
                added.append(copy)
                names.add(copy.name)
                state = _with(state, copy)
                vain = 0
                continue
        vain += 1
    return msgspec.structs.replace(scene, objects=(*scene.objects, *added))


def _copied(
    state: WorldState, model: SceneObject, place: SceneObject, names: set[str]
) -> SceneObject | None:
    middle = find_place(state, model, place)
    if middle is None:
        return None
    there = moved(model, difference(middle, model.center))
    x, y, z = (round(value, 4) + 0.0 for value in there.position)
    identity = object_id(model.type, (x, y, z))
    if identity in state.objects:
        return None
    digest = blake2b(identity.encode(), digest_size=4).hexdigest()
    name = f"{model.type}_{digest}"
    if name in names:
        return None
    a, b, c = (round(value, 4) + 0.0 for value in there.center)
    return msgspec.structs.replace(
        there, id=identity, name=name, position=(x, y, z), center=(a, b, c), parents=(place.id,)
    )


def _with(state: WorldState, thing: SceneObject) -> WorldState:
    return replace(state, objects=state.objects.changed({thing.id: thing}))
