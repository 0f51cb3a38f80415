"""Answer questions about what is in the picture; nothing changes."""

import math

import numpy as np

from karma.contracts import Pose
from karma.world.actions.aiming import outside, shown_at
from karma.world.core.arrays import Floats, crossing
from karma.world.core.hiding import inert_rows, solid_boxes
from karma.world.core.state import Camera, Performed, Refusal, Result, WorldState, refuse
from karma.world.core.view import CAMERA_M, camera, camera_axes, in_picture

_SCHEMES = ("Collider", "Distance")


def coordinate(state: WorldState, *, x: float, y: float) -> Result:
    """Return the point that a place in the picture shows."""
    if refusal := outside(x, y):
        return refusal
    eye, ray = _ray(state, x, y)
    far, _ = _first_hit(state, eye, ray)
    far = min(far, _wall(state, eye, ray))
    point = eye + ray * far if math.isfinite(far) else np.zeros(3)
    value = {axis: round(float(part), 6) for axis, part in zip("xyz", point, strict=True)}
    return Performed(state, value, 0.0)


def object_in_frame(state: WorldState, *, x: float, y: float, checkVisible: bool = False) -> Result:
    """Return the id of the object that a place in the picture shows."""
    if refusal := outside(x, y):
        return refusal
    if checkVisible:
        found = shown_at(state, x, y)
    else:
        _, found = _first_hit(state, *_ray(state, x, y))
    if found is None:
        return Refusal(f"No object is shown at ({x:g}, {y:g}).")
    return Performed(state, found, 0.0)


def visible_objects(
    state: WorldState,
    *,
    maxDistance: float | None = None,
    visibilityScheme: str | None = None,
    thirdPartyCameraIndex: int | None = None,
) -> Result:
    """Return the ids of what the agent, or another camera, has in view, in the scene's order."""
    if visibilityScheme is not None and visibilityScheme not in _SCHEMES:
        message = f"visibilityScheme must be one of {', '.join(_SCHEMES)}"
        return refuse("ArgumentException", message)
    reach = state.settings.visibility_m if maxDistance is None else maxDistance
    if reach < 0:
        return refuse("ArgumentOutOfRangeException", "maxDistance must not be negative")
    if thirdPartyCameraIndex is None:
        seen = state.sight_from(state.pose, visibility_m=reach).visible
        return Performed(state, [i for i in state.objects if i in seen], 0.0)
    if not 0 <= thirdPartyCameraIndex < len(state.cameras):
        message = f"there is no third-party camera {thirdPartyCameraIndex}"
        return refuse("ArgumentOutOfRangeException", message)
    return _seen_by(state, state.cameras[thirdPartyCameraIndex], reach)


def _seen_by(state: WorldState, one: Camera, reach: float) -> Result:
    if one.orthographic:
        return refuse("NotSupportedException", "an orthographic camera has no list of what it sees")
    x, y, z = one.position_m
    pitch, yaw, _ = one.rotation_deg
    pose = Pose(position_m=(x, y - CAMERA_M, z), yaw_deg=yaw, horizon_deg=pitch)
    seen = state.sight_from(pose, visibility_m=reach, fov_deg=one.fov_deg).visible
    held = sorted(state.in_hand)
    offsets = np.array([state.objects[i].center for i in held]).reshape(-1, 3) - np.array((x, y, z))
    shown = in_picture(offsets, camera_axes(yaw, pitch), one.fov_deg, state.settings.aspect)
    shown &= np.linalg.norm(offsets, axis=1) <= reach
    gone = {object_id for object_id, there in zip(held, shown, strict=True) if not there}
    return Performed(state, [i for i in state.objects if i in seen and i not in gone], 0.0)


# ----------------------------------------------------------------- rays


def _ray(state: WorldState, x: float, y: float) -> tuple[Floats, Floats]:
    """Return the camera's place and the way to a place in the picture, of length 1."""
    settings, pose = state.settings, state.pose
    scale = math.tan(math.radians(settings.fov_deg) / 2)
    right, up, forward = camera_axes(pose.yaw_deg, pose.horizon_deg)
    ray = forward + right * (2 * x - 1) * scale * settings.aspect + up * (1 - 2 * y) * scale
    return np.array(camera(pose)), ray / np.linalg.norm(ray)


def _first_hit(state: WorldState, eye: Floats, ray: Floats) -> tuple[float, str | None]:
    """Return how far away the first solid box is, and whose it is; infinity when there is none."""
    objects = state.objects
    if not len(objects):
        return math.inf, None
    low, high = solid_boxes(objects)
    enter, leave = crossing(eye, ray, low, high)
    hits = (enter < leave) & (enter > 0) & ~inert_rows(objects) & (high[:, 1] > low[:, 1])
    for object_id in state.in_hand:
        hits[objects.rows[object_id]] = False
    if not hits.any():
        return math.inf, None
    row = int(np.argmin(np.where(hits, np.round(enter, 9), math.inf)))
    return float(enter[row]), list(objects)[row]


def _wall(state: WorldState, eye: Floats, ray: Floats) -> float:
    """Return how far away the room's shell is, seen from inside; infinity from outside."""
    room = state.room
    middle, half = np.array(room.bounds_center), np.array(room.bounds_size) / 2
    low = middle - half
    low[1] = room.floor_y
    enter, leave = crossing(eye, ray, low, middle + half)
    return float(leave) if enter <= 0 < leave else math.inf
