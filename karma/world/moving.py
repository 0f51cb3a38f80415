"""Actions of the agent's body: walking, turning, looking, and asking for ways and poses."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from karma.contracts import Pose
from karma.world import navigate, scene
from karma.world.arguments import Place
from karma.world.footing import BODY_M, Ground, finer, snapped
from karma.world.objects import Objects, heading, moved, turned
from karma.world.state import Cell, Done, Refusal, Result, WorldState, refuse

_LOOK_UP_LIMIT, _LOOK_DOWN_LIMIT = -30.0, 60.0
_ON_GRID_M = 0.01
_FLOOR_SLACK_M = 0.05  # a teleport may miss the floor's height by this much
_BODY_TOP_M = 1.8
_FINEST_M = 0.02  # of the grids that GetReachablePositions can be asked for
_MOST_STEPS = 10_000  # of GetReachablePositions, per square metre of a step
_ACROSS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # steps right and ahead


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
    on_cells = snap and not finer(state)
    free = _on_a_cell(state) if on_cells else _between_cells(state)
    parts = max(round(far / room.grid_m * (1 if on_cells else 4)), 1)
    for part in range(1, parts + 1):
        target = (x + step[0] * far * part / parts, z + step[1] * far * part / parts)
        if snap and not on_cells and part == parts:
            target = snapped(state, *target)
        if not free(*target):
            by = f"({step[0] * far:.4f}, 0.0000, {step[1] * far:.4f})"
            return Refusal(f"{_in_the_way(state, target)} is blocking Agent 0 from moving by {by}.")
    if on_cells:
        target = room.cells[room.key(*target)]
    pose = replace(state.pose, position_m=(round(target[0], 6), y, round(target[1], 6)))
    return Done(with_pose(state, pose))


def _on_a_cell(state: WorldState) -> Callable[[float, float], bool]:
    room = state.room
    return lambda x, z: room.key(x, z) in room.cells


def _between_cells(state: WorldState) -> Callable[[float, float], bool]:
    """Return whether one can stand at a place; an agent that cannot stand where it is may leave."""
    ground = Ground(state)
    x, _, z = state.pose.position_m
    return ground.free if ground.free(x, z) else _on_a_cell(state)


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
        if max(gap_x, gap_z) <= BODY_M:
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
        if abs(degrees * 10 - round(degrees * 10)) > 1e-3:
            return refuse("InvalidOperationException", "degrees must be a multiple of 0.1")
        horizon = round(state.pose.horizon_deg + sign * degrees, 4)
        refusal = _beyond(horizon)
        return refusal or Done(with_pose(state, replace(state.pose, horizon_deg=horizon)))

    return look


def _beyond(horizon: float) -> Refusal | None:
    if horizon > _LOOK_DOWN_LIMIT + 1e-3:
        message = "can't look down beyond 60 degrees below the forward horizon"
    elif horizon < _LOOK_UP_LIMIT - 1e-3:
        message = "can't look up beyond 30 degrees above the forward horizon"
    else:
        return None
    return Refusal(message, "LookDownCantExceedMin")


def rotate_look(
    state: WorldState, *, rotation: Place | None = None, horizon: float | None = None
) -> Result:
    """Turn to a yaw and tilt to a horizon; what is left out is 0."""
    tilt = round(horizon or 0.0, 4)
    pose = replace(state.pose, yaw_deg=_yaw(rotation or {}), horizon_deg=tilt)
    return _beyond(tilt) or Done(with_pose(state, pose))


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
    rotation: Place | None = None,
    horizon: float | None = None,
    standing: bool | None = None,
    forceAction: bool = False,
) -> Result:
    """Put the agent elsewhere; what is left out stays as it is."""
    here = state.pose.position_m
    given = _given(position, x, y, z)
    to = (given.get("x", here[0]), given.get("y", here[1]), given.get("z", here[2]))
    pose = Pose(
        position_m=to,
        yaw_deg=state.pose.yaw_deg if rotation is None else _yaw(rotation),
        horizon_deg=state.pose.horizon_deg if horizon is None else float(horizon),
        standing=state.pose.standing if standing is None else standing,
    )
    refusal = None if forceAction else _cannot_be(state, pose)
    if refusal is not None:
        return refusal
    at = _on_grid(state, to[0], to[2])
    if at is not None and abs(to[1] - here[1]) <= _FLOOR_SLACK_M:
        pose = replace(pose, position_m=(at[0], here[1], at[1]))
    elif refusal is None and not forceAction:
        pose = replace(pose, position_m=(to[0], here[1], to[2]))
    return Done(with_pose(state, pose))


def _given(
    position: Place | None, x: float | None, y: float | None, z: float | None
) -> dict[str, float]:
    """Return the coordinates that were said, either way of saying them."""
    axes = {k: v for k, v in (("x", x), ("y", y), ("z", z)) if v is not None}
    said: Mapping[str, Any] = position or {}
    return {**said, **axes}


def teleport_full(
    state: WorldState,
    *,
    rotation: Place,
    horizon: float,
    standing: bool,
    position: Place | None = None,
    x: float | None = None,
    y: float | None = None,
    z: float | None = None,
    forceAction: bool = False,
) -> Result:
    """Put the agent elsewhere; everything has to be said."""
    given = _given(position, x, y, z)
    if missing := [axis for axis in "xyz" if axis not in given]:
        return Refusal(
            f"action: TeleportFull is missing the following arguments: {', '.join(missing)}",
            "MissingArguments",
        )
    return teleport(
        state,
        x=given["x"],
        y=given["y"],
        z=given["z"],
        rotation=rotation,
        horizon=horizon,
        standing=standing,
        forceAction=forceAction,
    )


def _yaw(rotation: Place | float) -> float:
    yaw = rotation.get("y", 0.0) if isinstance(rotation, dict) else rotation
    return round(yaw % 360, 4) % 360


def _on_grid(state: WorldState, x: float, z: float) -> tuple[float, float] | None:
    """Return the point of the agent's grid that a place is on; None when it is on none."""
    fine = finer(state)
    point = snapped(state, x, z) if fine else state.room.cells.get(state.room.key(x, z))
    if point is None or max(abs(point[0] - x), abs(point[1] - z)) > _ON_GRID_M:
        return None
    return point


def _cannot_be(state: WorldState, pose: Pose) -> Refusal | None:
    """Return why the agent cannot be there, if so."""
    x, y, z = pose.position_m
    if not _LOOK_UP_LIMIT - 1e-3 <= pose.horizon_deg <= _LOOK_DOWN_LIMIT + 1e-3:
        message = f"horizon must be in [-30, 60], not {pose.horizon_deg}"
        return refuse("ArgumentOutOfRangeException", message)
    middle, size = state.room.bounds_center, state.room.bounds_size
    if abs(x - middle[0]) > size[0] / 2 or abs(z - middle[2]) > size[2] / 2:
        message = f"Teleport target ({x:.4f}, {z:.4f}) is out of the scene's bounds"
        return refuse("ArgumentOutOfRangeException", message)
    if abs(y - state.pose.position_m[1]) > _FLOOR_SLACK_M:
        return Refusal(f"Teleport target y {y:.4f} is not at the height of the floor.")
    on_cells = not finer(state)
    if not (_on_a_cell(state) if on_cells else Ground(state).free)(x, z):
        what = _in_the_way(state, (x, z))
        return Refusal(f"{what} is in the way: Agent 0 cannot teleport to ({x:.4f}, {z:.4f}).")
    if state.settings.snap and _on_grid(state, x, z) is None:
        return Refusal(f"Teleport target ({x:.4f}, {z:.4f}) is not on the grid.")
    return None


# ----------------------------------------------------------------- questions; nothing changes


def reachable_positions(
    state: WorldState,
    *,
    maxStepCount: int | None = None,
    gridSize: float | None = None,
    directionsRelativeAgent: bool = False,
) -> Result:
    """Return the places the agent can walk to, the nearest first."""
    grid = state.settings.grid_m if gridSize is None else gridSize
    if not _FINEST_M <= grid <= 5:
        return refuse("ArgumentOutOfRangeException", f"gridSize must be in [{_FINEST_M}, 5]")
    if abs(grid - state.room.grid_m) < 1e-6 and not directionsRelativeAgent:
        start = navigate.agent_cell(state)
        cells = [] if start is None else list(navigate.walk(state.room, start))
        places = [state.room.cells[cell] for cell in cells]
    else:
        places = _walk_between(state, grid, state.pose.yaw_deg if directionsRelativeAgent else 0.0)
    if not places:
        return Refusal("No reachable positions", "ReachablePositionsCountZero")
    most = _MOST_STEPS if maxStepCount is None else maxStepCount
    if len(places) > most / grid**2:
        return Refusal("Too many steps taken in GetReachablePositions.")
    return Done(state, [_xyz(state, place) for place in places], 0.0)


def _walk_between(state: WorldState, grid: float, yaw_deg: float) -> list[tuple[float, float]]:
    """Return the places that steps of a length lead to, along and across a yaw; the start first."""
    free = _between_cells(state)
    x, _, z = state.pose.position_m
    (ahead_x, ahead_z), (right_x, right_z) = heading(yaw_deg), heading(yaw_deg + 90)
    found = {(0, 0): (x, z)}
    queue = [(0, 0)]
    for right, ahead in queue:
        for across, along in _ACROSS:
            key = (right + across, ahead + along)
            place = (
                round(x + (key[0] * right_x + key[1] * ahead_x) * grid, 6),
                round(z + (key[0] * right_z + key[1] * ahead_z) * grid, 6),
            )
            if key not in found and free(*place):
                found[key] = place
                queue.append(key)
    return list(found.values())


def shortest_path(
    state: WorldState,
    *,
    objectId: str | None = None,
    objectType: str | None = None,
    position: Place | None = None,
    initialRotation: Place | None = None,
    rotation: Place | None = None,
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
    given = _given(target, x, y, z)
    if "x" not in given or "z" not in given:
        message = "action: GetShortestPathToPoint is missing the following arguments: target"
        return Refusal(message, "MissingArguments")
    goal = navigate.nearest_cell(state.room, given["x"], given["z"])
    return _way(state, position, goal, f"({given['x']}, {given['z']})")


def _way(state: WorldState, start: Place | None, goal: Cell | None, name: str) -> Result:
    if start is None:
        first = navigate.agent_cell(state)
    else:
        here = state.pose.position_m
        x, z = start.get("x", here[0]), start.get("z", here[2])
        first = navigate.nearest_cell(state.room, x, z)
    cells = None if first is None or goal is None else navigate.path(state.room, first, goal)
    if cells is None:
        return Refusal(f"Path to target {name} could not be found.")
    places = [state.room.cells[cell] for cell in navigate.corners(cells)]
    return Done(state, {"corners": [_xyz(state, place) for place in places]}, 0.0)


def interactable_poses(
    state: WorldState,
    *,
    objectId: str,
    positions: list[Place] | None = None,
    rotations: list[float | Place] | None = None,
    horizons: list[float] | None = None,
    standings: list[bool] | None = None,
    maxDistance: float | None = None,
    maxPoses: int | None = None,
) -> Result:
    """Return poses from which an object can be interacted with, the nearest first."""
    if objectId not in state.objects:
        return unknown(objectId)
    if maxPoses is not None and maxPoses < 1:
        return refuse("ArgumentOutOfRangeException", "maxPoses must be > 0.")
    if [] in (positions, rotations, horizons, standings):
        return Done(state, [], 0.0)
    choice: dict[str, Any] = {"max_m": maxDistance, "limit": maxPoses}
    if positions is not None:
        cells = [state.room.key(p.get("x", 0.0), p.get("z", 0.0)) for p in positions]
        choice["cells"] = cells
    if rotations is not None:
        choice["yaws"] = [_yaw(rotation) for rotation in rotations]
    if horizons is not None:
        choice["horizons"] = horizons
    if standings is not None:
        choice["standings"] = standings
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


def _xyz(state: WorldState, place: tuple[float, float]) -> dict[str, float]:
    return {"x": place[0], "y": state.pose.position_m[1], "z": place[1]}
