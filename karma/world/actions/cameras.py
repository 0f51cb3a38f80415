"""Add and change cameras that are not the agent's."""

import re
from dataclasses import replace
from typing import Any

from karma.world.core.arguments import Place
from karma.world.core.posing import vector
from karma.world.core.state import Camera, Performed, Refusal, Result, WorldState, refuse

_COLORS = (
    "default", "red", "cyan", "blue", "darkblue", "lightblue", "purple", "yellow", "lime",
    "fuchsia", "white", "silver", "grey", "gray", "black", "orange", "brown", "maroon", "green",
    "olive", "navy", "teal", "aqua", "magenta",
)  # that Unity knows by name  # fmt: skip
_HEX = re.compile(r"#([0-9a-fA-F]{3,4}|[0-9a-fA-F]{6}|[0-9a-fA-F]{8})")


def add(
    state: WorldState,
    *,
    position: Place,
    rotation: Place,
    fieldOfView: float = 90.0,
    skyboxColor: str | None = None,
    orthographic: bool = False,
    orthographicSize: float | None = None,
    nearClippingPlane: float | None = None,
    farClippingPlane: float | None = None,
    antiAliasing: str = "none",
) -> Result:
    """Add a camera; its number is how many there were before."""
    usual = Camera(
        position_m=(0.0, 0.0, 0.0),
        orthographic_size_m=5.0,
        near_m=state.settings.near_m,
        far_m=state.settings.far_m,
    )
    camera = _changed(
        usual, position, rotation, fov_deg=fieldOfView, sky=skyboxColor, orthographic=orthographic,
        orthographic_size_m=orthographicSize, near_m=nearClippingPlane, far_m=farClippingPlane,
    )  # fmt: skip
    if isinstance(camera, Refusal):
        return camera
    return Performed(replace(state, cameras=(*state.cameras, camera)))


def update(
    state: WorldState,
    *,
    thirdPartyCameraId: int = 0,
    position: Place | None = None,
    rotation: Place | None = None,
    fieldOfView: float | None = None,
    skyboxColor: str | None = None,
    orthographic: bool | None = None,
    orthographicSize: float | None = None,
    nearClippingPlane: float | None = None,
    farClippingPlane: float | None = None,
    antiAliasing: str | None = None,
) -> Result:
    """Change a camera; what is left out stays, also of a position or rotation."""
    if not 0 <= thirdPartyCameraId < len(state.cameras):
        most = f"0 <= thirdPartyCameraId < {len(state.cameras)}"
        message = f"thirdPartyCameraId: {thirdPartyCameraId} must be in {most}"
        return refuse("ArgumentOutOfRangeException", message)
    camera = _changed(
        state.cameras[thirdPartyCameraId], position, rotation, fov_deg=fieldOfView,
        sky=skyboxColor, orthographic=orthographic, orthographic_size_m=orthographicSize,
        near_m=nearClippingPlane, far_m=farClippingPlane,
    )  # fmt: skip
    if isinstance(camera, Refusal):
        return camera
    cameras = list(state.cameras)
    cameras[thirdPartyCameraId] = camera
    return Performed(replace(state, cameras=tuple(cameras)))


def _changed(
    camera: Camera, position: Place | None, rotation: Place | None, **others: Any
) -> Camera | Refusal:
    """Return a camera with what is not None changed, or what is wrong with it."""
    if position:
        others["position_m"] = vector(position, camera.position_m)
    if rotation:
        others["rotation_deg"] = _angles(vector(rotation, camera.rotation_deg))
    camera = replace(camera, **{k: v for k, v in others.items() if v is not None})
    if camera.sky == "default":
        camera = replace(camera, sky="")
    return _refusal(camera) or camera


def _angles(degrees: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = (round(value % 360, 4) % 360 for value in degrees)
    return (x, y, z)


def _refusal(camera: Camera) -> Refusal | None:
    if not 0 < camera.fov_deg < 180:
        message = f"fieldOfView: {camera.fov_deg:g} must be in 0 < fieldOfView < 180."
        return refuse("ArgumentOutOfRangeException", message)
    if camera.sky and camera.sky.lower() not in _COLORS and not _HEX.fullmatch(camera.sky):
        message = f"Invalid skyboxColor: {camera.sky[:80]}! Cannot be parsed as an HTML color."
        return refuse("ArgumentException", message)
    if camera.orthographic_size_m <= 0:
        return refuse("ArgumentOutOfRangeException", "orthographicSize must be greater than 0.")
    if not 0 < camera.near_m < camera.far_m:
        message = "nearClippingPlane must be greater than 0 and less than farClippingPlane."
        return refuse("ArgumentOutOfRangeException", message)
    return None


def map_view(state: WorldState) -> Result:
    """Return where a camera that looks straight down has the whole room in its picture."""
    (x, y, z), (wide, high, deep) = state.room.bounds_center, state.room.bounds_size
    half = max(wide, deep, wide / state.settings.aspect) / 2
    view = {
        "position": {"x": float(x), "y": float(y + high / 2), "z": float(z)},
        "rotation": {"x": 90.0, "y": 0.0, "z": 0.0},
        "orthographicSize": float(half),
        "orthographic": True,
    }
    return Performed(state, view, 0.0)
