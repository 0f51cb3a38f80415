"""Make the pieces of a thing that was cut or broken."""

from dataclasses import replace

import msgspec

from karma.household.ids import part_id
from karma.household.pieces import EGG
from karma.household.types import object_types
from karma.world.core.objects import Objects
from karma.world.core.scene import SceneObject
from karma.world.core.state import WorldState
from karma.world.core.thing import bottom, shatters


def broken(state: WorldState, thing: SceneObject) -> WorldState:
    """Return the state with a thing broken.

    An egg runs out; a screen goes dark and stays; of a vessel only its id is left, out of
    everything, and what lay in it lies where it lay.
    """
    if thing.type == EGG:
        return in_pieces(state, msgspec.structs.replace(thing, is_broken=True))
    if not shatters(thing):
        thing = msgspec.structs.replace(thing, is_broken=True, is_toggled=False)
        return replace(state, objects=state.objects.changed({thing.id: thing}))
    gone = msgspec.structs.replace(thing, is_broken=True, parents=())
    changes = {thing.id: gone, **left_behind(state.objects, thing)}
    return replace(state, objects=state.objects.changed(changes))


def left_behind(objects: Objects, thing: SceneObject) -> dict[str, SceneObject]:
    """Return the contents of a thing, now lying where the thing lies."""
    found = {}
    for child in objects.containment.children.get(thing.id, ()):
        rest = tuple(p for p in objects[child].parents if p != thing.id)
        found[child] = msgspec.structs.replace(objects[child], parents=rest or thing.parents)
    return found


def in_pieces(state: WorldState, source: SceneObject) -> WorldState:
    """Return the state with the pieces of a thing in its place; the source stays, inert."""
    kind = object_types()[source.type].slices_into or ""
    pieces = _pieces(source, kind, object_types()[source.type].slice_count)
    changes = {source.id: msgspec.structs.replace(source, parents=()), **pieces}
    return replace(state, objects=state.objects.changed(changes))


def _pieces(source: SceneObject, kind: str, count: int) -> dict[str, SceneObject]:
    """Return the pieces side by side along the source's longer side, as `<id>|<kind>_<n>`."""
    row = object_types()[kind]
    axis = 0 if source.size[0] >= source.size[2] else 2
    found = {}
    for number in range(count):
        size = list(source.size) if count > 1 else list(row.size_m)
        middle = list(source.center)
        middle[1] = bottom(source) + size[1] / 2
        if count > 1:
            size[axis] /= count
            middle[axis] += (number - (count - 1) / 2) * size[axis]
        place = (round(middle[0], 5), round(middle[1], 5), round(middle[2], 5))
        piece = SceneObject(
            id=part_id(source.id, f"{kind}_{number}"),
            type=kind,
            name=f"{kind}_{number}_of_{source.name}",
            position=place,
            center=place,
            size=(size[0], size[1], size[2]),
            rotation=source.rotation,
            capabilities=row.capabilities,
            mass_kg=row.mass_kg,
            materials=row.materials,
            parents=source.parents,
            is_cooked=source.is_cooked and "cookable" in row.capabilities,
        )
        found[piece.id] = piece
    return found
