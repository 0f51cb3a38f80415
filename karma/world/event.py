"""What the embedded world returns: AI2-THOR 5.0.0's event, its metadata built when asked for."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from karma.contracts import Frame, Vec3
from karma.world.objects import bottom
from karma.world.scene import SceneObject
from karma.world.state import WorldState
from karma.world.view import camera

_SIGNS = (1, -1)


class Metadata(dict[str, Any]):
    """A dict with AI2-THOR's two aliases."""

    def __missing__(self, key: str) -> Any:
        if key == "hand":
            return self["heldObjectPose"]
        if key == "reachablePositions":
            if self["lastAction"] != "GetReachablePositions":
                raise IndexError("reachablePositions is only known after GetReachablePositions")
            return self["actionReturn"]
        raise KeyError(key)


@dataclass(frozen=True, kw_only=True, eq=False)
class WorldEvent:
    """One action's outcome: the moment after it, and how it went."""

    state: WorldState
    action: str
    success: bool = True
    message: str = ""
    code: str | None = None
    value: Any = None
    first: bool = False  # AI2-THOR leaves three fields null in the first event
    before: "WorldEvent | None" = None  # an event of the same moment; shares its object list

    def __bool__(self) -> bool:
        """Return whether the action happened."""
        return self.success

    @cached_property
    def objects(self) -> list[dict[str, Any]]:
        """All objects' metadata."""
        if self.before is not None:
            return self.before.objects
        return object_list(self.state)

    @cached_property
    def metadata(self) -> Mapping[str, Any]:
        """All 37 fields, the objects with 42 each."""
        late: list[Any] | None = None if self.first else []
        return Metadata(
            objects=self.objects,
            **_situation(self.state),
            lastAction=self.action,
            lastActionSuccess=self.success,
            errorMessage=self.message,
            errorCode=self.code,
            actionReturn=self.value,
            actionIntReturn=0,
            actionFloatReturn=0.0,
            actionStringsReturn=late,
            actionFloatsReturn=late,
            actionVector3sReturn=late,
        )

    @property
    def frame(self) -> Frame | None:
        """None: nothing is rendered here."""
        return None

    @property
    def events(self) -> list["WorldEvent"]:
        """One event per agent."""
        return [self]

    @property
    def screen_width(self) -> int:
        """Pixels."""
        return self.state.settings.width

    @property
    def screen_height(self) -> int:
        """Pixels."""
        return self.state.settings.height

    @property
    def pose(self) -> tuple[int, int, int, int]:
        """Return (x, z, yaw, horizon), each times 1000."""
        pose = self.state.pose
        values = (pose.position_m[0], pose.position_m[2], pose.yaw_deg, pose.horizon_deg)
        x, z, yaw, horizon = (round(value * 1000) for value in values)
        return (x, z, yaw, horizon)

    @property
    def pose_discrete(self) -> tuple[int, int, int, int]:
        """Return (x, z) in quarter metres, yaw in quarter turns, horizon in degrees."""
        pose = self.state.pose
        x, _, z = pose.position_m
        return (int(x / 0.25), int(z / 0.25), int(pose.yaw_deg / 90), round(pose.horizon_deg))

    def get_object(self, object_id: str) -> dict[str, Any] | None:
        """Return one object's metadata; None for an unknown id."""
        row = self.state.objects.rows.get(object_id)
        return None if row is None else self.objects[row]

    def objects_by_type(self, object_type: str) -> list[dict[str, Any]]:
        """Return the metadata of all objects of a type."""
        return [thing for thing in self.objects if thing["objectType"] == object_type]


def _situation(state: WorldState) -> dict[str, Any]:
    """Return the fields that tell of the agent, its hand and the scene."""
    pose, settings, room = state.pose, state.settings, state.room
    held = None if state.held is None else state.objects[state.held]
    yaw = {"x": 0.0, "y": float(pose.yaw_deg), "z": 0.0}
    bounds = box(room.bounds_center, room.bounds_size)
    return {
        "isSceneAtRest": True,
        "agent": {
            "name": "agent",
            "position": xyz(pose.position_m),
            "rotation": yaw,
            "cameraHorizon": float(pose.horizon_deg),
            "isStanding": pose.standing,
            "inHighFrictionArea": False,
        },
        "heldObjectPose": {
            "position": xyz(state.hand),
            "rotation": dict(yaw),
            "localPosition": {"x": 0.0, "y": -0.16, "z": 0.38},
            "localRotation": {"x": 0.0, "y": 0.0, "z": 0.0},
        },
        "arm": None,
        "fov": float(settings.fov_deg),
        "cameraPosition": xyz(camera(pose)),
        "cameraOrthSize": 0.0,
        "thirdPartyCameras": [],
        "collided": False,
        "collidedObjects": [],
        "inventoryObjects": []
        if held is None
        else [{"objectId": held.id, "objectType": held.type}],
        "sceneName": scene_name(room.name),
        "screenWidth": settings.width,
        "screenHeight": settings.height,
        "agentId": 0,
        "depthFormat": "Meters",
        "colors": None,
        "flatSurfacesOnGrid": [],
        "distances": [],
        "normals": [],
        "isOpenableGrid": [],
        "segmentedObjectIds": [],
        "objectIdsInBox": [],
        "visibleRange": None,
        "currentTime": round(state.time_s, 5),
        "sceneBounds": bounds,
    }


def scene_name(name: str) -> str:
    """Return a scene's name as metadata gives it.

    >>> scene_name("FloorPlan1"), scene_name("kitchen_1")
    ('FloorPlan1_physics', 'kitchen_1')
    """
    return f"{name}_physics" if name.startswith("FloorPlan") and "_" not in name else name


def object_list(state: WorldState) -> list[dict[str, Any]]:
    """Return the 42 fields of every object, in the scene's order."""
    sight, children = state.sight, state.objects.children
    return [
        {
            "visible": object_id in sight.visible,
            "isInteractable": object_id in sight.interactable,
            "distance": _far(thing.position, state.pose.position_m),
            "receptacleObjectIds": list(children.get(object_id, ()))
            if "receptacle" in thing.capabilities
            else None,
            **_fields(thing),
        }
        for object_id, thing in state.objects.items()
    ]


def _fields(thing: SceneObject) -> dict[str, Any]:
    """Return the fields that do not depend on anything around the object."""
    can = thing.capabilities
    loose = "pickupable" in can or "moveable" in can
    return {
        "name": thing.name,
        "objectId": thing.id,
        "objectType": thing.type,
        "assetId": thing.asset,
        "position": xyz(thing.position),
        "rotation": xyz(thing.rotation),
        "isMoving": False,
        "receptacle": "receptacle" in can,
        "parentReceptacles": list(thing.parents) or None,
        "pickupable": "pickupable" in can,
        "isPickedUp": thing.is_picked_up,
        "moveable": "moveable" in can,
        "mass": float(thing.mass_kg),
        "salientMaterials": None if thing.materials is None else list(thing.materials),
        "openable": "openable" in can,
        "isOpen": thing.openness > 0,
        "openness": float(thing.openness),
        "toggleable": "toggleable" in can,
        "isToggled": thing.is_toggled,
        "controlledObjects": list(thing.controls) if "toggleable" in can else None,
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
        "axisAlignedBoundingBox": box(thing.center, thing.size),
        "objectOrientedBoundingBox": {"cornerPoints": _corners(thing)} if loose else None,
    }


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


def _corners(thing: SceneObject) -> list[list[float]]:
    """Return the oriented box, its lower side first, each side in turn."""
    if thing.corners is not None:
        return [list(corner) for corner in thing.corners]
    (x, _, z), (sx, sy, sz) = thing.center, thing.size
    low = bottom(thing)
    ring = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return [[x + i * sx / 2, low + up, z + k * sz / 2] for up in (0.0, sy) for i, k in ring]


def _far(a: Vec3, b: Vec3) -> float:
    far: float = ((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2) ** 0.5
    return far
