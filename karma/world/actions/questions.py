"""Answer questions about paths, poses and what is in the picture; nothing changes."""

import math
from typing import Any

import numpy as np

from karma.types.space import Pose
from karma.world.actions.aiming import outside, ray_through
from karma.world.actions.moving import between_cells, lacks, unknown, yaw_of
from karma.world.core import navigate, scene
from karma.world.core.arguments import Place
from karma.world.core.boxes import Floats, crossing
from karma.world.core.ground import walk
from karma.world.core.hiding import inert_rows, solid_boxes
from karma.world.core.state import Cell, Performed, Refusal, Result, WorldState, refuse
from karma.world.core.thing import heading

_FINEST_M = 0.02  # of the grids that GetReachablePositions can be asked for
_ACROSS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # steps right and ahead


def coordinate(state: WorldState, *, x: float, y: float) -> Result:
    """Return the point that a place in the picture shows."""
    if refusal := outside(x, y):
        return refusal
    eye, ray = ray_through(state, x, y)
    ray /= np.linalg.norm(ray)
    far, _ = _first_hit(state, eye, ray)
    far = min(far, _wall(state, eye, ray))
    point = eye + ray * far if math.isfinite(far) else np.zeros(3)
    value = {axis: round(float(part), 6) for axis, part in zip("xyz", point, strict=True)}
    return Performed(state, value, 0.0)


# ----------------------------------------------------------------- rays


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


# ----------------------------------------------------------------- paths and poses


def reachable_positions(
    state: WorldState,
    *,
    gridSize: float | None = None,
    directionsRelativeAgent: bool = False,
) -> Result:
    """Return the places the agent can walk to, the nearest first."""
    grid = state.settings.grid_m if gridSize is None else gridSize
    if not _FINEST_M <= grid <= 5:
        return refuse("ArgumentOutOfRangeException", f"gridSize must be in [{_FINEST_M}, 5]")
    if abs(grid - state.room.grid_m) < 1e-6 and not directionsRelativeAgent:
        start = navigate.agent_cell(state)
        cells = [] if start is None else list(walk(state.cells, start))
        places = [state.room.cells[cell] for cell in cells]
    else:
        places = _walk_between(state, grid, state.pose.yaw_deg if directionsRelativeAgent else 0.0)
    if not places:
        return Refusal("No reachable positions", "ReachablePositionsCountZero")
    return Performed(state, [_xyz(state, place) for place in places], 0.0)


def _walk_between(state: WorldState, grid: float, yaw_deg: float) -> list[tuple[float, float]]:
    """Return the places that steps of a length lead to, along and across a yaw; the start first."""
    free = between_cells(state)
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
    """Return the path to where the agent is nearest to an object."""
    if objectId is None and objectType is None:
        return lacks("GetShortestPath", "objectId")
    if objectId is None:
        objectId = next(iter(state.objects.by_type.get(str(objectType), ())), "")
    if objectId not in state.objects:
        what = objectId or objectType
        return refuse("ArgumentException", f"Cannot find SimObject with id '{what}'.")
    goal = navigate.approach(state, objectId)
    return _path(state, position, goal, objectId)


def _path(state: WorldState, start: Place | None, goal: Cell | None, name: str) -> Result:
    if start is None:
        first = navigate.agent_cell(state)
    else:
        here = state.pose.position_m
        x, z = start.get("x", here[0]), start.get("z", here[2])
        first = navigate.nearest_cell(state, x, z)
    cells = None if first is None or goal is None else navigate.path(state.cells, first, goal)
    if cells is None:
        return Refusal(f"Path to target {name} could not be found.")
    places = [state.room.cells[cell] for cell in navigate.corners(cells)]
    return Performed(state, {"corners": [_xyz(state, place) for place in places]}, 0.0)


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
        return Performed(state, [], 0.0)
    choice: dict[str, Any] = {
        "cells": positions
        and [state.room.key(p.get("x", 0.0), p.get("z", 0.0)) for p in positions],
        "yaws": rotations and [yaw_of(rotation) for rotation in rotations],
        "horizons": horizons,
        "standings": standings,
    }
    given = {name: value for name, value in choice.items() if value is not None}
    poses = navigate.interactable_poses(state, objectId, max_m=maxDistance, limit=maxPoses, **given)
    return Performed(state, [_pose(pose) for pose in poses], 0.0)


def scenes_in_build(state: WorldState) -> Result:
    """Return the names of the scenes that come with the package."""
    return Performed(state, sorted(path.stem for path in scene.SCENES.glob("*.json")), 0.0)


def _pose(pose: Pose) -> dict[str, Any]:
    x, y, z = pose.position_m
    turned = {"rotation": pose.yaw_deg, "standing": pose.standing, "horizon": pose.horizon_deg}
    return {"x": x, "y": y, "z": z, **turned}


def _xyz(state: WorldState, place: tuple[float, float]) -> dict[str, float]:
    return {"x": place[0], "y": state.pose.position_m[1], "z": place[1]}
