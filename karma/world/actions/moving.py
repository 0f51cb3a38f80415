"""Walk, turn and tilt the agent, and put it elsewhere."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from karma.household.places import FLOOR
from karma.types.space import Pose
from karma.world.core.arguments import Place
from karma.world.core.hiding import inert_rows
from karma.world.core.navigate import BODY_TOP_M, Ground, finer, snapped
from karma.world.core.objects import Objects
from karma.world.core.state import BODY_M, SILL_M, Performed, Refusal, Result, WorldState, refuse
from karma.world.core.thing import difference, heading, moved, turned

_LOOK_UP_LIMIT, _LOOK_DOWN_LIMIT = -30.0, 60.0
_ON_GRID_M = 0.01
_FLOOR_SLACK_M = 0.05  # a teleport may miss the floor's height by this much


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
    here = state.objects[object_id].position
    by = difference(state.hand, here)
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
    free = _on_a_cell(state) if on_cells else between_cells(state)
    parts = max(round(far / room.grid_m * (1 if on_cells else 4)), 1)
    for part in range(1, parts + 1):
        target = (x + step[0] * far * part / parts, z + step[1] * far * part / parts)
        if snap and not on_cells and part == parts:
            target = snapped(state, *target)
        if not free(*target):
            by = f"({step[0] * far:.4f}, 0.0000, {step[1] * far:.4f})"
            return Refusal(f"{_in_the_way(state, target)} is blocking Agent 0 from moving by {by}.")
    if on_cells:
        target = state.cells[room.key(*target)]
    pose = replace(state.pose, position_m=(round(target[0], 6), y, round(target[1], 6)))
    return Performed(with_pose(state, pose))


def _on_a_cell(state: WorldState) -> Callable[[float, float], bool]:
    key, cells = state.room.key, state.cells
    return lambda x, z: key(x, z) in cells


def between_cells(state: WorldState) -> Callable[[float, float], bool]:
    """Return whether one can stand at a place; an agent that cannot stand where it is may leave."""
    ground = Ground(state)
    x, _, z = state.pose.position_m
    return ground.free if ground.free(x, z) else _on_a_cell(state)


def _in_the_way(state: WorldState, place: tuple[float, float]) -> str:
    """Return the name of what blocks a place, or of the room's wall."""
    objects, floor = state.objects, state.room.floor_y
    boxes = objects.boxes
    gap = np.abs(boxes.center[:, [0, 2]] - place) - boxes.half[:, [0, 2]]
    near = (gap.max(axis=1) <= BODY_M) & ~inert_rows(objects)
    near &= (boxes.high[:, 1] >= floor + SILL_M) & (boxes.low[:, 1] <= floor + BODY_TOP_M)
    far = np.abs(boxes.center[:, [0, 2]] - place).sum(axis=1)
    things = list(objects.values())
    found = [
        (float(far[row]), things[row].name)
        for row in np.flatnonzero(near)
        if things[row].type != FLOOR and things[row].id not in state.in_hand
    ]
    return min(found, default=(0.0, "Wall"))[1]


def turner(sign: int) -> Callable[..., Result]:
    """Return the action that turns the agent: sign +1 right, -1 left."""

    def turn(
        state: WorldState, *, degrees: float | None = None, forceAction: bool = False
    ) -> Result:
        by = state.settings.rotate_deg if degrees is None else float(degrees)
        if by <= 0:
            return Refusal("degrees must be greater than 0")
        yaw = round((state.pose.yaw_deg + sign * by) % 360, 4) % 360
        return Performed(with_pose(state, replace(state.pose, yaw_deg=yaw)))

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
        return refusal or Performed(with_pose(state, replace(state.pose, horizon_deg=horizon)))

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
    pose = replace(state.pose, yaw_deg=yaw_of(rotation or {}), horizon_deg=tilt)
    return _beyond(tilt) or Performed(with_pose(state, pose))


def stander(standing: bool) -> Callable[..., Result]:
    """Return the action that stands up or crouches; refused when the agent does so already."""

    def change(state: WorldState) -> Result:
        if state.pose.standing == standing:
            return Refusal(f"Agent is already {'standing' if standing else 'crouching'}.")
        return Performed(with_pose(state, replace(state.pose, standing=standing)))

    return change


def wait(state: WorldState) -> Result:
    """Let one action's time pass."""
    return Performed(state)


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
    given = coordinates(position, x, y, z)
    to = (given.get("x", here[0]), given.get("y", here[1]), given.get("z", here[2]))
    pose = Pose(
        position_m=to,
        yaw_deg=state.pose.yaw_deg if rotation is None else yaw_of(rotation),
        horizon_deg=state.pose.horizon_deg if horizon is None else float(horizon),
        standing=state.pose.standing if standing is None else standing,
    )
    if not forceAction and (refusal := _cannot_be(state, pose)):
        return refusal
    at = _on_grid(state, to[0], to[2])
    if at is not None and abs(to[1] - here[1]) <= _FLOOR_SLACK_M:
        pose = replace(pose, position_m=(at[0], here[1], at[1]))
    elif not forceAction:
        pose = replace(pose, position_m=(to[0], here[1], to[2]))
    return Performed(with_pose(state, pose))


def coordinates(
    position: Place | None, x: float | None, y: float | None, z: float | None
) -> dict[str, float]:
    """Return the coordinates that were said, either way of saying them."""
    axes = {k: v for k, v in (("x", x), ("y", y), ("z", z)) if v is not None}
    given: Mapping[str, Any] = position or {}
    return {**given, **axes}


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
    given = coordinates(position, x, y, z)
    if missing := [axis for axis in "xyz" if axis not in given]:
        return lacks("TeleportFull", *missing)
    return teleport(
        state, x=given["x"], y=given["y"], z=given["z"], rotation=rotation, horizon=horizon,
        standing=standing, forceAction=forceAction,
    )  # fmt: skip


def yaw_of(rotation: Place | float) -> float:
    """Return the yaw of a rotation, in [0, 360)."""
    yaw = rotation.get("y", 0.0) if isinstance(rotation, dict) else rotation
    return round(yaw % 360, 4) % 360


def _on_grid(state: WorldState, x: float, z: float) -> tuple[float, float] | None:
    """Return the point of the agent's grid that a place is on; None when it is on none."""
    fine = finer(state)
    point = snapped(state, x, z) if fine else state.cells.get(state.room.key(x, z))
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


def lacks(action: str, *arguments: str) -> Refusal:
    """Return the refusal of an action without arguments that it needs."""
    names = ", ".join(arguments)
    text = f"action: {action} is missing the following arguments: {names}"
    return Refusal(text, "MissingArguments")


def unknown(object_id: str) -> Refusal:
    """Return the refusal for an id that no object has."""
    message = f"objectId: {object_id} is not the objectId on any object in the scene!"
    return refuse("ArgumentException", message)
