"""Actions of the agent's body: walking, turning, looking, and asking for ways and poses."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from karma.contracts import Pose
from karma.world import navigate, scene
from karma.world.objects import Objects, heading, moved, turned
from karma.world.state import Cell, Done, Refusal, Result, WorldState, refuse

_LOOK_UP_LIMIT, _LOOK_DOWN_LIMIT = -30.0, 60.0
_ON_GRID_M = 0.01
_BODY_M = 0.2  # the agent's radius
_BODY_TOP_M = 1.8

Place = dict[str, Any]  # AI2-THOR's {x, y, z}


def with_pose(state: WorldState, pose: Pose) -> WorldState:
    """Return the state with the agent elsewhere; what it holds comes along."""
    after = replace(state, pose=pose)
    if state.held is None:
        return after
    turn = pose.yaw_deg - state.pose.yaw_deg
    return replace(after, objects=hang(after, state.held, turn))


def hang(state: WorldState, object_id: str, turn: float) -> Objects:
    """Return the objects with one, and what it carries, brought to the hand and turned."""
    thing = turned(state.objects[object_id], turn, state.objects[object_id].position)
    here, hand = state.objects[object_id].position, state.hand
    by = (hand[0] - here[0], hand[1] - here[1], hand[2] - here[2])
    changes = {object_id: moved(thing, by)}
    for child in state.objects.carried(object_id):
        changes[child] = moved(turned(state.objects[child], turn, here), by)
    return state.objects.changed(changes, in_hand=object_id in state.in_hand)


def mover(angle: float) -> Callable[..., Result]:
    """Return the action that steps in a direction relative to the agent's yaw."""

    def move(
        state: WorldState,
        *,
        moveMagnitude: float | None = None,
        forceAction: bool = False,
        snapToGrid: bool | None = None,
    ) -> Result:
        far = state.settings.grid_m if moveMagnitude is None else float(moveMagnitude)
        if far <= 0:
            return Refusal("moveMagnitude must be greater than 0")
        step = heading(state.pose.yaw_deg + angle)
        return _step(state, step, far, state.settings.snap if snapToGrid is None else snapToGrid)

    return move


def _step(state: WorldState, step: tuple[float, float], far: float, snap: bool) -> Result:
    room, (x, y, z) = state.room, state.pose.position_m
    parts = max(round(far / room.grid_m), 1)
    for part in range(1, parts + 1):
        target = (x + step[0] * far * part / parts, z + step[1] * far * part / parts)
        if room.key(*target) not in room.cells:
            by = f"({step[0] * far:.4f}, 0.0000, {step[1] * far:.4f})"
            return Refusal(f"{_in_the_way(state, target)} is blocking Agent 0 from moving by {by}.")
    if snap:
        target = room.cells[room.key(*target)]
    pose = replace(state.pose, position_m=(round(target[0], 6), y, round(target[1], 6)))
    return Done(with_pose(state, pose))


def _in_the_way(state: WorldState, place: tuple[float, float]) -> str:
    """Return the name of what blocks a place, or of the room's wall."""
    floor = state.room.floor_y
    best: tuple[float, str] | None = None
    for thing in state.objects.values():
        low, high = (thing.center[1] + sign * thing.size[1] / 2 for sign in (-1, 1))
        if thing.type == "Floor" or thing.id in state.in_hand:
            continue
        if high < floor + 0.05 or low > floor + _BODY_TOP_M:
            continue
        gap_x = max(abs(thing.center[0] - place[0]) - thing.size[0] / 2, 0.0)
        gap_z = max(abs(thing.center[2] - place[1]) - thing.size[2] / 2, 0.0)
        if max(gap_x, gap_z) <= _BODY_M:
            far = abs(thing.center[0] - place[0]) + abs(thing.center[2] - place[1])
            best = min(best or (far, thing.name), (far, thing.name))
    return "Wall" if best is None else best[1]


def turner(sign: int) -> Callable[..., Result]:
    """Return the action that turns the agent: sign +1 right, -1 left."""

    def turn(
        state: WorldState, *, degrees: float | None = None, forceAction: bool = False
    ) -> Result:
        by = state.settings.rotate_deg if degrees is None else float(degrees)
        if by <= 0:
            return Refusal("degrees must be greater than 0")
        yaw = round((state.pose.yaw_deg + sign * by) % 360, 4) % 360
        return Done(with_pose(state, replace(state.pose, yaw_deg=yaw)))

    return turn


def looker(sign: int) -> Callable[..., Result]:
    """Return the action that tilts the camera: sign +1 down, -1 up."""

    def look(state: WorldState, *, degrees: float = 30.0) -> Result:
        if degrees < 0:
            return Refusal("degrees must not be negative")
        horizon = round(state.pose.horizon_deg + sign * degrees, 4)
        if horizon > _LOOK_DOWN_LIMIT + 1e-3:
            message = "can't look down beyond 60 degrees below the forward horizon"
            return Refusal(message, "LookDownCantExceedMin")
        if horizon < _LOOK_UP_LIMIT - 1e-3:
            message = "can't look up beyond 30 degrees above the forward horizon"
            return Refusal(message, "LookDownCantExceedMin")
        return Done(with_pose(state, replace(state.pose, horizon_deg=horizon)))

    return look


def crouch(state: WorldState) -> Result:
    """Crouch; refused when crouching already."""
    if not state.pose.standing:
        return Refusal("Agent is already crouching.")
    return Done(with_pose(state, replace(state.pose, standing=False)))


def stand(state: WorldState) -> Result:
    """Stand up; refused when standing already."""
    if state.pose.standing:
        return Refusal("Agent is already standing.")
    return Done(with_pose(state, replace(state.pose, standing=True)))


def wait(state: WorldState) -> Result:
    """Let one action's time pass."""
    return Done(state)


def teleport(
    state: WorldState,
    *,
    position: Place | None = None,
    x: float | None = None,
    y: float | None = None,
    z: float | None = None,
    rotation: Place | float | None = None,
    horizon: float | None = None,
    standing: bool | None = None,
    forceAction: bool = False,
) -> Result:
    """Put the agent elsewhere; what is left out stays as it is."""
    here = state.pose.position_m
    given = {
        **(position or {}),
        **{k: v for k, v in (("x", x), ("y", y), ("z", z)) if v is not None},
    }
    to = (
        float(given.get("x", here[0])),
        float(given.get("y", here[1])),
        float(given.get("z", here[2])),
    )
    yaw = state.pose.yaw_deg if rotation is None else _yaw(rotation)
    pose = Pose(
        position_m=to,
        yaw_deg=round(yaw, 4) % 360,
        horizon_deg=state.pose.horizon_deg if horizon is None else float(horizon),
        standing=state.pose.standing if standing is None else standing,
    )
    refusal = None if forceAction else _cannot_be(state, pose)
    if refusal is not None:
        return refusal
    cell = state.room.cells.get(state.room.key(to[0], to[2]))
    if cell is not None and max(abs(cell[0] - to[0]), abs(cell[1] - to[2])) <= _ON_GRID_M:
        pose = replace(pose, position_m=(cell[0], here[1], cell[1]))
    return Done(with_pose(state, pose))


def teleport_full(
    state: WorldState,
    *,
    rotation: Place | float,
    horizon: float,
    standing: bool,
    position: Place | None = None,
    x: float | None = None,
    y: float | None = None,
    z: float | None = None,
    forceAction: bool = False,
) -> Result:
    """Put the agent elsewhere; everything has to be said."""
    given = {
        **(position or {}),
        **{k: v for k, v in (("x", x), ("y", y), ("z", z)) if v is not None},
    }
    if missing := [axis for axis in "xyz" if axis not in given]:
        return Refusal(
            f"action: TeleportFull is missing the following arguments: {', '.join(missing)}",
            "MissingArguments",
        )
    return teleport(
        state,
        position=given,
        rotation=rotation,
        horizon=horizon,
        standing=standing,
        forceAction=forceAction,
    )


def _yaw(rotation: Place | float) -> float:
    return float(rotation.get("y", 0.0)) if isinstance(rotation, dict) else float(rotation)


def _cannot_be(state: WorldState, pose: Pose) -> Refusal | None:
    """Return why the agent cannot be there, if so."""
    x, y, z = pose.position_m
    if not _LOOK_UP_LIMIT - 1e-3 <= pose.horizon_deg <= _LOOK_DOWN_LIMIT + 1e-3:
        message = f"horizon must be in [-30, 60], not {pose.horizon_deg}"
        return refuse("ArgumentOutOfRangeException", message)
    if abs(y - state.pose.position_m[1]) > 0.05:
        return Refusal(f"Teleport target y {y:.4f} is not at the height of the floor.")
    cell = state.room.cells.get(state.room.key(x, z))
    if cell is None:
        what = _in_the_way(state, (x, z))
        return Refusal(f"{what} is in the way: Agent 0 cannot teleport to ({x:.4f}, {z:.4f}).")
    if state.settings.snap and max(abs(cell[0] - x), abs(cell[1] - z)) > _ON_GRID_M:
        return Refusal(f"Teleport target ({x:.4f}, {z:.4f}) is not on the grid.")
    return None


# ----------------------------------------------------------------- questions; nothing changes


def reachable_positions(
    state: WorldState,
    *,
    maxStepCount: int | None = None,
    gridSize: float | None = None,
    directionsRelativeAgent: list[Any] | None = None,
) -> Result:
    """Return the places the agent can walk to, the nearest first."""
    start = navigate.agent_cell(state)
    cells = [] if start is None else list(navigate.walk(state.room, start))
    if not cells:
        return Refusal("No reachable positions", "ReachablePositionsCountZero")
    return Done(state, [_xyz(state, cell) for cell in cells], 0.0)


def shortest_path(
    state: WorldState,
    *,
    objectId: str | None = None,
    objectType: str | None = None,
    position: Place | None = None,
    initialRotation: Place | float | None = None,
    rotation: Place | float | None = None,
    allowedError: float = 1e-4,
) -> Result:
    """Return the way to where the agent is nearest to an object."""
    if objectId is None and objectType is None:
        message = "action: GetShortestPath is missing the following arguments: objectId"
        return Refusal(message, "MissingArguments")
    if objectId is None:
        objectId = next(iter(state.objects.by_type.get(str(objectType), ())), "")
    if objectId not in state.objects:
        what = objectId or objectType
        return refuse("ArgumentException", f"Cannot find SimObject with id '{what}'.")
    goal = navigate.approach(state, objectId)
    return _way(state, position, goal, objectId)


def shortest_path_to_point(
    state: WorldState,
    *,
    x: float | None = None,
    y: float | None = None,
    z: float | None = None,
    target: Place | None = None,
    position: Place | None = None,
    allowedError: float = 1e-4,
) -> Result:
    """Return the way to the cell nearest to a point."""
    given = {**(target or {}), **{k: v for k, v in (("x", x), ("z", z)) if v is not None}}
    if "x" not in given or "z" not in given:
        message = "action: GetShortestPathToPoint is missing the following arguments: target"
        return Refusal(message, "MissingArguments")
    goal = navigate.nearest_cell(state.room, float(given["x"]), float(given["z"]))
    return _way(state, position, goal, f"({given['x']}, {given['z']})")


def _way(state: WorldState, start: Place | None, goal: Cell | None, name: str) -> Result:
    if start is None:
        first = navigate.agent_cell(state)
    else:
        first = navigate.nearest_cell(state.room, float(start["x"]), float(start["z"]))
    cells = None if first is None or goal is None else navigate.path(state.room, first, goal)
    if cells is None:
        return Refusal(f"Path to target {name} could not be found.")
    return Done(state, {"corners": [_xyz(state, cell) for cell in navigate.corners(cells)]}, 0.0)


def interactable_poses(
    state: WorldState,
    *,
    objectId: str,
    positions: list[Any] | None = None,
    rotations: list[Any] | None = None,
    horizons: list[Any] | None = None,
    standings: list[Any] | None = None,
    maxDistance: float | None = None,
    maxPoses: int | None = None,
) -> Result:
    """Return poses from which an object can be interacted with, the nearest first."""
    if objectId not in state.objects:
        return unknown(objectId)
    if maxPoses is not None and maxPoses < 1:
        return refuse("ArgumentOutOfRangeException", "maxPoses must be > 0.")
    choice: dict[str, Any] = {"max_m": maxDistance, "limit": maxPoses}
    if positions is not None:
        choice["cells"] = [state.room.key(float(p["x"]), float(p["z"])) for p in positions]
    if rotations is not None:
        choice["yaws"] = [_yaw(rotation) % 360 for rotation in rotations]
    if horizons is not None:
        choice["horizons"] = [float(horizon) for horizon in horizons]
    if standings is not None:
        choice["standings"] = [bool(standing) for standing in standings]
    poses = navigate.interactable_poses(state, objectId, **choice)
    return Done(state, [_pose(pose) for pose in poses], 0.0)


def scenes_in_build(state: WorldState) -> Result:
    """Return the names of the scenes that come with the package."""
    return Done(state, sorted(path.stem for path in scene.SCENES.glob("*.json")), 0.0)


def set_decay_time(state: WorldState, *, decayTime: float) -> Result:
    """Set how long heat and cold last; 0 = until the next action."""
    if decayTime < 0:
        return Refusal("decayTime must not be negative")
    return Done(replace(state, decay_s=float(decayTime)))


def unknown(object_id: str) -> Refusal:
    """Return the refusal for an id that no object has."""
    message = f"objectId: {object_id} is not the objectId on any object in the scene!"
    return refuse("ArgumentException", message)


def _pose(pose: Pose) -> dict[str, Any]:
    x, y, z = pose.position_m
    return {
        "x": x,
        "y": y,
        "z": z,
        "rotation": pose.yaw_deg,
        "standing": pose.standing,
        "horizon": pose.horizon_deg,
    }


def _xyz(state: WorldState, cell: Cell) -> dict[str, float]:
    x, z = state.room.cells[cell]
    return {"x": x, "y": state.pose.position_m[1], "z": z}
