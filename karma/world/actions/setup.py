"""Set the world up: Initialize, the picture's size, what metadata lists, third-party cameras."""

from dataclasses import replace

from karma.world.core.arguments import Place
from karma.world.core.posing import vector
from karma.world.core.state import (
    Camera,
    Images,
    Performed,
    Refusal,
    Result,
    Settings,
    WorldState,
    refuse,
)

_AGENT_MODES = ("default", "locobot", "bot", "drone", "arm", "stretch", "stochastic", "fpin")
_SAME_BODY = ("default", "locobot", "bot")  # a LoCoBot does what the default agent does
_WIDEST_GRID_M = 5.0
_USUAL_GRID_M = 0.25
_LONGEST_SIDE = 8192  # pixels; larger pictures do not fit into memory


def initialize(
    state: WorldState,
    *,
    agentMode: str = "default",
    agentCount: int = 1,
    gridSize: float | None = None,
    snapToGrid: bool = True,
    rotateStepDegrees: float = 90.0,
    visibilityDistance: float = 1.5,
    visibilityScheme: str = "Collider",
    fieldOfView: float = 90.0,
    cameraNearPlane: float = 0.01,
    cameraFarPlane: float = 20.0,
    fastActionEmit: bool = True,
    renderImage: bool = True,
    renderDepthImage: bool = False,
    renderSemanticSegmentation: bool = False,
    renderClassImage: bool = False,
    renderInstanceSegmentation: bool = False,
    renderObjectImage: bool = False,
    renderNormalsImage: bool = False,
    renderFlowImage: bool = False,
) -> Result:
    """Set everything that Initialize sets; what is left out gets AI2-THOR's default."""
    grid_m = state.room.grid_m if gridSize is None else gridSize or _USUAL_GRID_M
    settings = replace(
        state.settings,
        grid_m=grid_m,
        visibility_m=visibilityDistance if visibilityDistance > 0 else 1.5,
        fov_deg=fieldOfView,
        rotate_deg=rotateStepDegrees,
        snap=snapToGrid,
        near_m=cameraNearPlane,
        far_m=cameraFarPlane,
        fast_emit=fastActionEmit,
        images=Images(
            rgb=renderImage,
            depth=renderDepthImage,
            classes=renderSemanticSegmentation or renderClassImage,
            instances=renderInstanceSegmentation or renderObjectImage,
            normals=renderNormalsImage,
        ),
    )
    refusal = _not_this_agent(agentMode, agentCount) or unfit(settings)
    if refusal is not None:
        return refusal
    planes = {"cameraNearPlane": cameraNearPlane, "cameraFarPlane": cameraFarPlane}
    return Performed(replace(state, settings=settings), planes, 0.0)


def unfit(settings: Settings) -> Refusal | None:
    """Return why there is no world with these settings, if so."""
    grid_m, turn_deg, fov_deg = settings.grid_m, settings.rotate_deg, settings.fov_deg
    if not 0 < grid_m <= _WIDEST_GRID_M:
        return Refusal(f"gridSize must be in the range (0,5], not {grid_m:g}")
    if not turn_deg > 0:
        return Refusal(f"rotateStepDegrees must be greater than 0, not {turn_deg:g}")
    if settings.snap and turn_deg % 90:
        message = f"Invalid values 'rotateStepDegrees': {turn_deg:g} and 'snapToGrid': True."
        return Refusal(f"{message} With snapToGrid only multiples of 90 degrees are supported.")
    if not 0 < fov_deg < 180:
        return Refusal(f"fov must be set to (0, 180) noninclusive, not {fov_deg:g}.")
    if not 0 < settings.near_m < settings.far_m:
        return Refusal("cameraNearPlane must be greater than 0 and less than cameraFarPlane")
    return _not_this_size(settings.width, settings.height)


def _not_this_agent(mode: str, count: int) -> Refusal | None:
    if mode not in _AGENT_MODES:
        return refuse("ArgumentException", f"unsupported agentMode {mode}")
    if mode not in _SAME_BODY:
        return Refusal(f"agentMode {mode} is not part of the embedded world: use 'default'.")
    if count != 1:
        return Refusal(f"agentCount {count} is not part of the embedded world: it has one agent.")
    return None


def _not_this_size(width: int, height: int) -> Refusal | None:
    if not (1 <= width <= _LONGEST_SIDE and 1 <= height <= _LONGEST_SIDE):
        return refuse("ArgumentOutOfRangeException", f"x and y must be in [1, {_LONGEST_SIDE}]")
    return None


def change_resolution(state: WorldState, *, x: int, y: int) -> Result:
    """Set the picture's width and height, pixels."""
    sized = replace(state, settings=replace(state.settings, width=x, height=y))
    return _not_this_size(x, y) or Performed(sized, None, 0.0)


def set_random_seed(state: WorldState, *, seed: int) -> Result:
    """Set the seed of what later actions draw by lot."""
    return Performed(replace(state, seed=seed))


def set_object_filter(state: WorldState, *, objectIds: list[str]) -> Result:
    """List only some objects in metadata from now on; unknown ids do no harm."""
    return Performed(replace(state, shown=frozenset(objectIds)))


def reset_object_filter(state: WorldState) -> Result:
    """List all objects in metadata again."""
    return Performed(replace(state, shown=None))


# ----------------------------------------------------------------- the client's own tests


def echo_fast(state: WorldState, *, rvalue: str) -> Result:
    """Return what was said, as an answer to a question."""
    return Performed(state, rvalue, 0.0)


def echo(state: WorldState, *, rvalue: str) -> Result:
    """Return what was said, with full metadata."""
    return Performed(replace(state), rvalue, 0.0)


def add_camera(
    state: WorldState, *, position: Place, rotation: Place, fieldOfView: float = 90.0
) -> Result:
    """Add a camera; its number is how many there were before."""
    near_m, far_m = state.settings.near_m, state.settings.far_m
    usual = Camera(position_m=(0.0, 0.0, 0.0), near_m=near_m, far_m=far_m)
    camera = _changed(usual, position, rotation, fieldOfView)
    if isinstance(camera, Refusal):
        return camera
    return Performed(replace(state, cameras=(*state.cameras, camera)))


def update_camera(
    state: WorldState,
    *,
    thirdPartyCameraId: int = 0,
    position: Place | None = None,
    rotation: Place | None = None,
    fieldOfView: float | None = None,
) -> Result:
    """Change a camera; what is left out stays, also of a position or rotation."""
    number = thirdPartyCameraId
    if not 0 <= number < len(state.cameras):
        message = f"thirdPartyCameraId: {number} must be in 0 <= thirdPartyCameraId < "
        return refuse("ArgumentOutOfRangeException", f"{message}{len(state.cameras)}")
    camera = _changed(state.cameras[number], position, rotation, fieldOfView)
    if isinstance(camera, Refusal):
        return camera
    cameras = (*state.cameras[:number], camera, *state.cameras[number + 1 :])
    return Performed(replace(state, cameras=cameras))


def _changed(
    camera: Camera, position: Place | None, rotation: Place | None, fov_deg: float | None
) -> Camera | Refusal:
    """Return a camera with what is given changed, or the reason why it cannot be."""
    if position:
        camera = replace(camera, position_m=vector(position, camera.position_m))
    if rotation:
        x, y, z = (round(v % 360, 4) % 360 for v in vector(rotation, camera.rotation_deg))
        camera = replace(camera, rotation_deg=(x, y, z))
    if fov_deg is not None:
        camera = replace(camera, fov_deg=fov_deg)
    if not 0 < camera.fov_deg < 180:
        message = f"fieldOfView: {camera.fov_deg:g} must be in 0 < fieldOfView < 180."
        return refuse("ArgumentOutOfRangeException", message)
    return camera
