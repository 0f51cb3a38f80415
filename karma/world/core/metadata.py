"""Write AI2-THOR 5.0.0 metadata of one object: the fields that depend on nothing around it."""

import math
from typing import Any

from karma.types.space import Vec3
from karma.world.core.objects import Objects, derived, per_object
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.thing import corners, is_loose

_SIGNS = (1, -1)


def fields(thing: SceneObject) -> dict[str, Any]:
    """Return all 42 fields; those that depend on agent and contents are not filled in yet."""
    can = thing.capabilities
    return {
        "name": thing.name,
        "position": xyz(thing.position),
        "rotation": xyz(thing.rotation),
        "visible": False,
        "isInteractable": False,
        "receptacle": "receptacle" in can,
        "toggleable": "toggleable" in can,
        "isToggled": thing.is_toggled,
        "breakable": "breakable" in can,
        "isBroken": thing.is_broken,
        "canFillWithLiquid": "canFillWithLiquid" in can,
        "isFilledWithLiquid": thing.is_filled,
        "fillLiquid": thing.liquid,
        "dirtyable": "dirtyable" in can,
        "isDirty": thing.is_dirty,
        "canBeUsedUp": "canBeUsedUp" in can,
        "isUsedUp": thing.is_used_up,
        "cookable": "cookable" in can,
        "isCooked": thing.is_cooked,
        "temperature": thing.temperature,
        "isHeatSource": "isHeatSource" in can,
        "isColdSource": "isColdSource" in can,
        "sliceable": "sliceable" in can,
        "isSliced": thing.is_sliced,
        "openable": "openable" in can,
        "isOpen": thing.openness > 0,
        "openness": float(thing.openness),
        "pickupable": "pickupable" in can,
        "isPickedUp": thing.is_picked_up,
        "moveable": "moveable" in can,
        "mass": float(thing.mass_kg),
        "salientMaterials": None if thing.materials is None else list(thing.materials),
        "receptacleObjectIds": None,
        "distance": 0.0,
        "objectType": thing.type,
        "objectId": thing.id,
        "assetId": thing.asset,
        "parentReceptacles": list(thing.parents) or None,
        "controlledObjects": list(thing.controls) if "toggleable" in can else None,
        "isMoving": False,
        "axisAlignedBoundingBox": box(*_outline(thing)),
        "objectOrientedBoundingBox": {"cornerPoints": [list(corner) for corner in corners(thing)]}
        if is_loose(thing)
        else None,
    }


records = per_object(fields)


@derived()
def holders(objects: Objects) -> list[tuple[int, str]]:
    """Return row and id of each receptacle."""
    rows = enumerate(objects.values())
    return [(row, thing.id) for row, thing in rows if "receptacle" in thing.capabilities]


def _outline(thing: SceneObject) -> tuple[Vec3, Vec3]:
    """Return center and size of an object's box, with its door where that stands open."""
    doors = rules().doors
    if thing.openness <= 0 or thing.type not in doors.swing:
        return thing.center, thing.size
    (x, y, z), (wide, high, deep) = thing.center, thing.size
    east, north = (round(part(math.radians(thing.rotation[1])), 6) for part in (math.sin, math.cos))
    reach = thing.openness * doors.reach_share * (abs(north) * wide + abs(east) * deep)
    center = (x + east * reach / 2, y, z + north * reach / 2)
    return center, (wide + abs(east) * reach, high, deep + abs(north) * reach)


def xyz(point: Vec3) -> dict[str, float]:
    """Return a point as AI2-THOR writes it."""
    x, y, z = point
    return {"x": float(x), "y": float(y), "z": float(z)}


def box(center: Vec3, size: Vec3) -> dict[str, Any]:
    """Return an axis-aligned box as AI2-THOR writes it."""
    (cx, cy, cz), (sx, sy, sz) = center, (size[0] / 2, size[1] / 2, size[2] / 2)
    corners = [
        [cx + i * sx, cy + j * sy, cz + k * sz] for i in _SIGNS for j in _SIGNS for k in _SIGNS
    ]
    return {"cornerPoints": corners, "center": xyz(center), "size": xyz(size)}
