"""Return what happened as AI2-THOR 5.0.0's event.

A genuine `ai2thor.server.Event` where that package is installed, else one with the same attributes.
Metadata and pictures are made when first asked for; a moment never changes, so later is not too
late. Parts of the metadata are shared between events: copy before changing any.
"""

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from karma.world import event_base
from karma.world.core.metadata import holders, records, xyz
from karma.world.core.posing import hand_rotation
from karma.world.core.state import Camera, Images, WorldState
from karma.world.core.view import camera

try:
    from ai2thor.server import Event, MetadataWrapper
except ImportError:  # the extra `thor` is not installed
    Event, MetadataWrapper = (  # type: ignore[assignment, misc, unused-ignore]
        event_base.SegmentedEvent,
        event_base.MetadataWrapper,
    )

if TYPE_CHECKING:
    from karma.world.render.picture import Picture


_FRAMES = {  # of the agent: that of third-party cameras
    "frame": "third_party_camera_frames",
    "depth_frame": "third_party_depth_frames",
    "normals_frame": "third_party_normals_frames",
    "instance_segmentation_frame": "third_party_instance_segmentation_frames",
    "semantic_segmentation_frame": "third_party_semantic_segmentation_frames",
}


_MASKS = ("instance_masks", "class_masks", "instance_detections2D", "class_detections2D")
_DRAWN = {  # attribute that is made when first asked for -> the event's method that sets it
    **dict.fromkeys((*_FRAMES, *_MASKS), "draw_agent"),
    **dict.fromkeys(_FRAMES.values(), "draw_cameras"),
    **dict.fromkeys(("third_party_instance_masks", "third_party_class_masks"), "draw_cameras"),
}


class WorldEvent(Event):  # type: ignore[misc]
    """One action's outcome: the moment after it, and how it went; `message` is why it did not.

    AI2-THOR leaves three fields null in the `first` event. Images are those of the state's settings
    unless given; the object list and pictures of an event `before`, of the same moment, are shared.
    """

    def __init__(
        self,
        *,
        state: WorldState,
        action: str,
        success: bool = True,
        message: str = "",
        code: str | None = None,
        value: Any = None,
        first: bool = False,
        images: Images | None = None,
        before: "WorldEvent | None" = None,
    ) -> None:
        self.state = state
        self.action = action
        self.success = success
        self.message = message
        self.code = code
        self.value = value
        self.first = first
        self.images = state.settings.images if images is None else images
        self.before: WorldEvent | None = None if before is None else before.before or before
        self.events = [self]
        self.flow_frame = None
        self.third_party_flows_frames: list[Any] = []

    def __getattr__(self, name: str) -> Any:
        """Return a picture or mask, drawn with those that go with it when first asked for."""
        if name not in _DRAWN:
            raise AttributeError(f"an event has no attribute {name!r}")
        getattr(self, _DRAWN[name])()
        return self.__dict__[name]

    def __bool__(self) -> bool:
        """Return whether the action happened."""
        return self.success

    @property
    def screen_width(self) -> int:
        """Pixels."""
        return self.state.settings.width

    @property
    def screen_height(self) -> int:
        """Pixels."""
        return self.state.settings.height

    # ------------------------------------------------------------- metadata

    @cached_property
    def objects(self) -> list[dict[str, Any]]:
        """The listed objects' metadata, 42 fields each."""
        return object_list(self.state) if self.before is None else self.before.objects

    @cached_property
    def metadata(self) -> dict[str, Any]:
        """All 37 fields."""
        late: list[Any] | None = None if self.first else []
        fields: dict[str, Any] = MetadataWrapper(_situation(self.state, self.images))
        fields.update(
            objects=self.objects,
            lastAction=self.action,
            lastActionSuccess=self.success,
            errorMessage=self.message,
            errorCode=self.code,
            actionReturn=self.value,
            actionStringsReturn=late,
            actionFloatsReturn=late,
            actionVector3sReturn=late,
        )
        return fields

    @cached_property
    def color_to_object_id(self) -> dict[tuple[int, int, int], str]:
        """Names by colour; empty without segmentation."""
        return {tuple(row["color"]): row["name"] for row in self.metadata["colors"] or ()}

    @cached_property
    def object_id_to_color(self) -> dict[str, tuple[int, int, int]]:
        """Colours by name; empty without segmentation."""
        return {name: color for color, name in self.color_to_object_id.items()}

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
        return next((thing for thing in self.objects if thing["objectId"] == object_id), None)

    # ------------------------------------------------------------- pictures

    @cached_property
    def picture(self) -> "Picture":
        """What the agent's camera sees; drawn even when the event has no frame."""
        from karma.world.render.picture import agent_camera

        if self.before is not None:
            return self.before.picture
        return self._rendered(agent_camera(self.state))

    @cached_property
    def camera_pictures(self) -> "list[Picture]":
        """What each third-party camera sees."""
        if self.before is not None:
            return self.before.camera_pictures
        return [self._rendered(camera) for camera in self.state.cameras]

    def _rendered(self, view: Camera, *, normals: bool = False) -> "Picture":
        from karma.world.render.picture import render

        settings = self.state.settings
        return render(self.state, view, settings.width, settings.height, normals=normals)

    def draw_agent(self) -> None:
        """Set the agent's frames, masks and boxes."""
        frames: dict[str, Any] = {}
        if self.images.rgb:
            from karma.world.render.picture import agent_camera

            frames = self._frames(self.picture, agent_camera(self.state))
        for name in _FRAMES:
            setattr(self, name, frames.get(name))
        for name in _MASKS:
            setattr(self, name, None if name == "instance_detections2D" else {})
        if self.instance_segmentation_frame is not None:
            self.process_colors_ids(rgba_bytes(self.instance_segmentation_frame))

    def draw_cameras(self) -> None:
        """Set the lists of the third-party cameras' frames and masks."""
        pairs = (
            zip(self.camera_pictures, self.state.cameras, strict=True) if self.images.rgb else ()
        )
        frames = [self._frames(picture, view) for picture, view in pairs]
        for name, of_cameras in _FRAMES.items():
            setattr(self, of_cameras, [one[name] for one in frames if name in one])
        readers = [self._reader(one) for one in self.third_party_instance_segmentation_frames]
        self.third_party_instance_masks = [one.instance_masks for one in readers]
        self.third_party_class_masks = [one.class_masks for one in readers]

    def _frames(self, picture: "Picture", view: Camera) -> dict[str, Any]:
        """Return the wanted frames of what a camera sees, by name."""
        from karma.world.render.pixels import class_frame, instance_frame

        wanted, objects = self.images, self.state.objects
        found: dict[str, Any] = {"frame": picture.rgb}
        if wanted.depth:
            found["depth_frame"] = picture.depth_m
        if wanted.normals:
            found["normals_frame"] = self._normals(view)
        if wanted.classes:
            found["semantic_segmentation_frame"] = class_frame(picture.rows, objects)
        if wanted.instances:
            found["instance_segmentation_frame"] = instance_frame(picture.rows, objects)
        return found

    def _normals(self, view: Camera) -> np.ndarray:
        """Return a camera's normals as a picture: each axis from -1..1 to 0..255."""
        found = self._rendered(view, normals=True).normals
        return np.round((np.zeros(3) if found is None else found) * 127.5 + 127.5).astype(np.uint8)

    def _reader(self, frame: np.ndarray) -> Any:
        """Return an event that has read one segmentation frame."""
        reader = WorldEvent(state=self.state, action=self.action, images=self.images, before=self)
        reader.process_colors_ids(rgba_bytes(frame))
        return reader


def rgba_bytes(frame: np.ndarray) -> bytes:
    """Return a frame as AI2-THOR sends it: bottom row first, four bytes a pixel, alpha 255."""
    height, width, _ = frame.shape
    full = np.full((height, width, 4), 255, dtype=np.uint8)
    full[:, :, :3] = frame[::-1]
    return full.tobytes()


def _situation(state: WorldState, images: Images) -> dict[str, Any]:
    """Return the fields that tell of the agent, its hand and the scene."""
    pose, settings, room = state.pose, state.settings, state.room
    held = None if state.held is None else state.objects[state.held]
    yaw = {"x": 0.0, "y": float(pose.yaw_deg), "z": 0.0}
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
            "rotation": xyz(hand_rotation(state)) if any(state.hand_turn_deg) else dict(yaw),
            "localPosition": xyz(state.hand_m),
            "localRotation": xyz(state.hand_turn_deg),
        },
        "arm": None,
        "fov": float(settings.fov_deg),
        "cameraPosition": xyz(camera(pose)),
        "cameraOrthSize": 0.0,
        "thirdPartyCameras": _cameras(state) if images.rgb else None,
        "collided": False,
        "collidedObjects": [],
        "inventoryObjects": []
        if held is None
        else [{"objectId": held.id, "objectType": held.type}],
        "sceneName": room.scene_name,
        "screenWidth": settings.width,
        "screenHeight": settings.height,
        "agentId": 0,
        "depthFormat": "Meters",
        "colors": _colors(state, images),
        "flatSurfacesOnGrid": [],
        "distances": [],
        "normals": [],
        "isOpenableGrid": [],
        "segmentedObjectIds": [],
        "objectIdsInBox": [],
        "actionIntReturn": 0,
        "actionFloatReturn": 0.0,
        "visibleRange": None,
        "currentTime": round(state.time_s, 5),
        "sceneBounds": room.bounds,
    }


def _cameras(state: WorldState) -> list[dict[str, Any]]:
    return [
        {
            "thirdPartyCameraId": number,
            "position": xyz(one.position_m),
            "rotation": xyz(one.rotation_deg),
            "fieldOfView": float(one.fov_deg),
        }
        for number, one in enumerate(state.cameras)
    ]


def _colors(state: WorldState, images: Images) -> list[dict[str, Any]] | None:
    """Return the colour table that goes with segmentation."""
    if not (images.rgb and (images.instances or images.classes)):
        return None
    from karma.world.render.pixels import colour_table

    return list(colour_table(state.objects))


def object_list(state: WorldState) -> list[dict[str, Any]]:
    """Return the 42 fields of every listed object, in the scene's order."""
    objects, sight = state.objects, state.sight
    far = np.sqrt(((objects.boxes.origin - state.pose.position_m) ** 2).sum(axis=1)).tolist()
    visible, interactable = sight.visible_rows.tolist(), sight.interactable_rows.tolist()
    found = [record.copy() for record in records(objects)]
    for record, seen, near, metres in zip(found, visible, interactable, far, strict=True):
        record["visible"] = seen
        record["isInteractable"] = near
        record["distance"] = metres
    children = objects.containment.children
    for row, object_id in holders(objects):
        found[row]["receptacleObjectIds"] = list(children.get(object_id, ()))
    if state.shown is None:
        return found
    return [record for record in found if record["objectId"] in state.shown]
