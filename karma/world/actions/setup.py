"""Set the world up: what Initialize says, the picture's size, what metadata lists."""

from dataclasses import replace

import msgspec

from karma.world.core.state import Images, Performed, Refusal, Result, Settings, WorldState, refuse

_AGENT_MODES = ("default", "locobot", "bot", "drone", "arm", "stretch", "stochastic", "fpin")
_SAME_BODY = ("default", "locobot", "bot")  # a LoCoBot does what the default agent does
_QUALITIES = (
    "DONOTUSE", "Very Low", "Low", "Medium", "MediumCloseFitShadows", "High", "Very High",
    "Ultra", "High WebGL",
)  # fmt: skip
_WIDEST_GRID_M = 5.0
_USUAL_GRID_M = 0.25
_LONGEST_SIDE = 8192  # pixels; larger pictures do not fit into memory
_LONGEST_STEP_S = 0.05


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


def set_decay_time(state: WorldState, *, decayTime: float) -> Result:
    """Set how long heat and cold last; 0 = until the next action."""
    if decayTime < 0:
        return Refusal("decayTime must not be negative")
    return Performed(replace(state, decay_s=float(decayTime)))


def change_resolution(state: WorldState, *, x: int, y: int) -> Result:
    """Set the picture's width and height, pixels."""
    sized = replace(state, settings=replace(state.settings, width=x, height=y))
    return _not_this_size(x, y) or Performed(sized, None, 0.0)


def change_quality(state: WorldState, *, quality: str) -> Result:
    """Accept one of the player's qualities; pictures look the same in all of them."""
    if quality not in _QUALITIES:
        known = ", ".join(_QUALITIES)
        return refuse("ArgumentException", f"unknown quality {quality!r}; there are: {known}")
    return Performed(replace(state), None, 0.0)


def set_random_seed(state: WorldState, *, seed: int) -> Result:
    """Set the seed of what later actions draw by lot."""
    return Performed(replace(state, seed=seed))


def set_object_filter(state: WorldState, *, objectIds: list[str]) -> Result:
    """List only some objects in metadata from now on; unknown ids do no harm."""
    return Performed(replace(state, shown=frozenset(objectIds)))


def set_object_filter_for_type(state: WorldState, *, objectTypes: list[str]) -> Result:
    """List only objects of some types in metadata from now on."""
    ids = (i for kind in objectTypes for i in state.objects.by_type.get(kind, ()))
    return Performed(replace(state, shown=frozenset(ids)))


def reset_object_filter(state: WorldState) -> Result:
    """List all objects in metadata again."""
    return Performed(replace(state, shown=None))


def make_all_unbreakable(state: WorldState) -> Result:
    """Take from every object that it can break; what is broken stays so."""
    firm = {
        thing.id: msgspec.structs.replace(
            thing, capabilities=tuple(can for can in thing.capabilities if can != "breakable")
        )
        for thing in state.objects.values()
        if "breakable" in thing.capabilities and not thing.is_broken
    }
    return Performed(replace(state, objects=state.objects.changed(firm)))


def wait_for_physics(state: WorldState) -> Result:
    """Accept a switch of the physics engine, which is not there: the room is always at rest."""
    return Performed(replace(state))


def advance_physics_step(
    state: WorldState,
    *,
    timeStep: float = 0.02,
    simSeconds: float | None = None,
    allowAutoSimulation: bool = False,
) -> Result:
    """Let time pass; things lie still, heat and cold run out."""
    if not 0 < timeStep <= _LONGEST_STEP_S:
        return refuse("ArgumentOutOfRangeException", "timeStep must be in (0, 0.05]")
    seconds = timeStep if simSeconds is None else simSeconds
    if not 0 <= seconds <= 3600:
        return refuse("ArgumentOutOfRangeException", "simSeconds must be in [0, 3600]")
    return Performed(replace(state), None, seconds)


# ----------------------------------------------------------------- the client's own tests


def echo_fast(state: WorldState, *, rvalue: str) -> Result:
    """Return what was said, as an answer to a question."""
    return Performed(state, rvalue, 0.0)


def echo(state: WorldState, *, rvalue: str) -> Result:
    """Return what was said, with full metadata."""
    return Performed(replace(state), rvalue, 0.0)
