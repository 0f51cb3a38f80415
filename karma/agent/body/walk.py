"""Moving the agent: shortest walks over reachable cells, and where to stand to see a thing.

Everything is done with the robot's own actions (MoveAhead, RotateLeft, RotateRight, LookUp,
LookDown); GetReachablePositions is asked once per scene and stands for the robot's map.
"""

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order

from karma.agent.seeing.perceive import camera_of, cells_of, pose_of, scene_of
from karma.types.roles import Event, Stage
from karma.types.space import CameraPose, Pose, Vec3, outside_m

Cell = tuple[int, int]  # steps along x and z from where the map was asked for
State = tuple[int, int, int]  # cell and heading (0 = +z, 1 = +x, 2 = -z, 3 = -x)

_AHEAD = ((0, 1), (1, 0), (0, -1), (-1, 0))
_MOVES = ("MoveAhead", "RotateLeft", "RotateRight")
_TURN = {"RotateRight": 1, "RotateLeft": -1}
_HORIZONS = (-30.0, 0.0, 30.0, 60.0)
_REPLANS = 20  # walls met on one walk before it is given up


class OutOfActionsError(Exception):
    """The skill has used up its actions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """What to look at: the centre of a box; a bare point has no size."""

    center_m: Vec3
    size_m: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stance:
    """A way to stand and look, and what it costs to get there (actions, and a little for odds)."""

    state: State
    horizon_deg: float
    gap_m: float = 0.0  # horizontally, to the target's box
    cost: float = 0.0


class FloorMap:
    """The cells that can be stood on, on a grid through where the agent was.

    Without cells it has the cell that the agent stands on.
    """

    def __init__(self, found: Sequence[Vec3], here: Vec3) -> None:
        self._origin = (here[0], here[2])
        steps = [
            b - a
            for axis in (0, 2)
            for a, b in pairwise(sorted({round(cell[axis], 3) for cell in found}))
            if b - a > 0.01
        ]
        self.grid_m = min(steps, default=0.25)
        self.cells: dict[Cell, tuple[float, float]] = {}
        self.add(*found, here)

    def add(self, *points: Vec3) -> None:
        """Note that cells can be stood on, number all states and link them by their moves.

        `after` is the number of the state that each move leads to, -1 for none: (states, moves).
        """
        fresh = {self.cell(point): (point[0], point[2]) for point in points}
        if fresh.keys() <= self.cells.keys():
            return
        self.cells |= fresh
        self.states: list[State] = [(*cell, turn) for cell, turn in product(self.cells, range(4))]
        self.numbers = {state: number for number, state in enumerate(self.states)}
        after = [[self.numbers.get(_after(s, move), -1) for move in _MOVES] for s in self.states]
        self.after = np.array(after, dtype=np.intp)

    def cell(self, point: Vec3) -> Cell:
        """Return the cell that a point lies in."""
        return (
            round((point[0] - self._origin[0]) / self.grid_m),
            round((point[2] - self._origin[1]) / self.grid_m),
        )

    def metres(self, cell: tuple[int, ...]) -> tuple[float, float]:
        """Return the x and z of a cell."""
        return (self._origin[0] + cell[0] * self.grid_m, self._origin[1] + cell[1] * self.grid_m)

    def gap_m(self, cell: tuple[int, ...], point: Vec3) -> float:
        """Return the horizontal distance of a point from a cell."""
        x, z = self.metres(cell)
        return math.hypot(point[0] - x, point[2] - z)

    def outside_m(self, cell: Cell, target: Target) -> tuple[float, float]:
        """Return how far the cell is outside the target's box, along x and along z."""
        at_x, at_z = self.metres(cell)
        x, _, z = outside_m((at_x, 0.0, at_z), target.center_m, target.size_m)
        return x, z

    def aim(self, cell: Cell, target: Target) -> tuple[float, float]:
        """Return the point of the box to face: the nearest one, up to 0.25 m inside."""
        aim = []
        for at, axis in zip(self.metres(cell), (0, 2), strict=True):
            half = max(target.size_m[axis] / 2 - 0.25, 0.0)
            center = target.center_m[axis]
            aim.append(min(max(at, center - half), center + half))
        return aim[0], aim[1]


class Routes:
    """The shortest ways from one state to all others, in steps ahead and quarter turns.

    `walls` are moves that the world refused; `costs` are the actions to each state that can be
    reached, the nearest first.
    """

    def __init__(
        self, floor: FloorMap, start: State, walls: Collection[tuple[State, str]] = ()
    ) -> None:
        self._floor, size = floor, len(floor.states)
        self._after = floor.after.copy()
        for state, move in walls:
            self._after[floor.numbers[state], _MOVES.index(move)] = -1
        there = self._after >= 0
        rows = np.concatenate(([0], there.sum(axis=1).cumsum()))
        graph = csr_matrix((np.ones(rows[-1]), self._after[there], rows), shape=(size, size))
        order, before = breadth_first_order(graph, floor.numbers[start])
        self._before: list[int] = before.tolist()  # negative for the start
        costs: dict[int, int] = {}
        for number in order.tolist():
            costs[number] = costs.get(self._before[number], -1) + 1
        self.costs = {floor.states[number]: cost for number, cost in costs.items()}

    def to(self, goal: State) -> list[str] | None:
        """Return the actions that lead to a state, or None if no way does."""
        if goal not in self.costs:
            return None
        actions, number = list[str](), self._floor.numbers[goal]
        while (before := self._before[number]) >= 0:
            actions.append(_MOVES[self._after[before].tolist().index(number)])
            number = before
        return actions[::-1]


class Walker:
    """The agent's body: walks, turns, looks, and counts the world's actions.

    After `max_actions` of one skill comes `OutOfActionsError`.
    """

    def __init__(self, world: Stage, *, max_actions: int) -> None:
        self.world = world
        self.max_actions = max_actions
        self.actions = 0  # since `start`
        self.horizon_deg = 0.0  # tilt of the camera, down positive
        self._scene = ""
        self._floor = FloorMap((), (0.0, 0.0, 0.0))
        self._state: State = (0, 0, 0)
        self._walls: frozenset[tuple[State, str]] = frozenset()
        self._known: tuple[Any, Routes] | None = None  # the last routes, and where they begin

    # ------------------------------------------------------------- acting

    def start(self) -> None:
        """Begin a skill: nothing counted, no walls known, the pose read anew.

        The reachable cells are asked for once per scene.
        """
        self.actions, self._walls = 0, frozenset()
        event = self.world.last_event
        if (scene := scene_of(event)) != self._scene:
            here = pose_of(event).position_m
            self._floor = FloorMap(cells_of(self.world.step("GetReachablePositions")), here)
            self._scene = scene
        self._locate()

    def _locate(self) -> None:
        """Read the pose; an odd heading is turned to the nearest of the four."""
        pose = pose_of(self.world.last_event)
        heading = round(pose.yaw_deg / 90.0)
        if abs(pose.yaw_deg - heading * 90.0) > 1.0:
            turn = "RotateRight" if heading * 90.0 > pose.yaw_deg else "RotateLeft"
            self.do(turn, degrees=abs(heading * 90.0 - pose.yaw_deg))
        self._floor.add(pose.position_m)
        self._state = (*self._floor.cell(pose.position_m), heading % 4)
        self.horizon_deg = pose.horizon_deg

    def do(self, action: str, **arguments: Any) -> Event:
        """Do one counted action, or raise OutOfActionsError; the event is true if it happened."""
        if self.actions >= self.max_actions:
            raise OutOfActionsError
        self.actions += 1
        return self.world.step(action, **arguments)

    def look(self, horizon_deg: float) -> bool:
        """Tilt the camera; down is positive. Returns whether it got there."""
        while abs(horizon_deg - self.horizon_deg) > 1.0:
            tilt = min(max(horizon_deg - self.horizon_deg, -30.0), 30.0)
            action = "LookDown" if tilt > 0 else "LookUp"
            if not self.do(action, degrees=round(abs(tilt), 1)):
                return False
            self.horizon_deg += tilt
        return True

    def follow(self, actions: Iterable[str]) -> bool:
        """Do the actions; at the first refusal remember the wall and stop."""
        for action in actions:
            if not self.do(action):
                self._walls |= {(self._state, action)}
                self._locate()
                return False
            self._state = _after(self._state, action)
        return True

    def walk(self, goal: State) -> bool:
        """Walk the shortest way to a cell and heading, round what turns out to be in the way."""
        for _ in range(_REPLANS):
            path = self.routes().to(goal)
            if path is None:
                return False
            if self.follow(path):
                return True
        return False

    def walk_near(self, point: Vec3) -> bool:
        """Walk to the cell nearest to a point that can be walked to, with any heading."""
        for _ in range(_REPLANS):
            routes = self.routes()
            gap, costs = self._floor.gap_m, routes.costs
            near = min(costs, key=lambda state: (gap(state, point), costs[state], state))
            if self.follow(routes.to(near) or ()):
                return True
        return False

    def routes(self) -> Routes:
        """Return the ways from here."""
        start = (self._floor, len(self._floor.cells), self._state, self._walls)
        if self._known is None or self._known[0] != start:
            self._known = (start, Routes(self._floor, self._state, self._walls))
        return self._known[1]

    # ------------------------------------------------------------- where

    @property
    def position(self) -> tuple[float, float]:
        """Where the agent stands: x, z in metres."""
        return self._floor.metres(self._state)

    def gap(self, point: Vec3) -> float:
        """Return the horizontal distance from the agent to a point, in metres."""
        return self._floor.gap_m(self._state, point)

    def stance(self, pose: Pose | None = None) -> Stance:
        """Return a pose, by default the agent's own, as a view; its cost and gap are 0."""
        if pose is None:
            return Stance(state=self._state, horizon_deg=self.horizon_deg)
        state = (*self._floor.cell(pose.position_m), round(pose.yaw_deg / 90.0) % 4)
        return Stance(state=state, horizon_deg=pose.horizon_deg)

    def camera_of(self, view: Stance) -> CameraPose:
        """Return the camera as it would be in a view."""
        now = camera_of(self.world.last_event)
        x, z = self._floor.metres(view.state)
        at = (x, now.position_m[1], z)
        yaw = 90.0 * view.state[2]
        return replace(now, position_m=at, yaw_deg=yaw, horizon_deg=view.horizon_deg)

    def cell_near(self, point: Vec3) -> tuple[float, float]:
        """Return the cell of the map nearest to a point: x, z in metres."""
        x, _, z = point
        return min(self._floor.cells.values(), key=lambda cell: (math.dist(cell, (x, z)), cell))

    def cells(self) -> Iterable[tuple[float, float]]:
        """Return all cells of the map: x, z in metres."""
        return self._floor.cells.values()

    def cost(self, view: Stance) -> float:
        """Return how many actions it takes to get into a view; infinite where no way leads."""
        steps = self.routes().costs.get(view.state, math.inf)
        return steps + abs(view.horizon_deg - self.horizon_deg) / 30.0

    def views(self, target: Target, *, reach_m: float, least_gap_m: float = 0.0) -> list[Stance]:
        """Return the ways to stand and look at a target, the cheapest first.

        Cells within `reach_m` of the target's box; if there are none, the nearest ones.
        """
        routes = self.routes()
        gaps = {
            cell: math.hypot(*self._floor.outside_m(cell, target))
            for cell in {state[:2] for state in routes.costs}
        }
        reach = max(reach_m, min(gaps.values()) + 0.3)
        eye = camera_of(self.world.last_event).position_m[1]
        views = []
        for cell, gap in gaps.items():
            if gap <= reach:
                view = self._view(cell, gap, target, eye, routes)
                far = 3.0 * max(least_gap_m - gap, 0.0) / self._floor.grid_m
                views.append((view.cost + far, view.state, view))
        return [view for _, _, view in sorted(views, key=lambda ranked: ranked[:2])]

    def _view(self, cell: Cell, gap: float, target: Target, eye: float, routes: Routes) -> Stance:
        x, z = self._floor.metres(cell)
        ax, az = self._floor.aim(cell, target)
        dx, dz = ax - x, az - z
        heading = (0 if dz >= 0 else 2) if abs(dz) >= abs(dx) else (1 if dx >= 0 else 3)
        forward, aside = max(abs(dx), abs(dz)), min(abs(dx), abs(dz))
        pitch = math.degrees(math.atan2(eye - target.center_m[1], max(forward, 0.1)))
        horizon = min(_HORIZONS, key=lambda tilt: (abs(tilt - pitch), tilt))
        off = math.degrees(math.atan2(aside, max(forward, 0.01)))
        state = (*cell, heading)
        odds = off / 15.0 + max(abs(horizon - pitch) - 15.0, 0.0) / 5.0
        odds += 1.0 if gap < 0.3 else 4.0 * max(gap - 1.0, 0.0)
        odds += 1.0 if min(self._floor.outside_m(cell, target)) > 0.05 else 0.0  # past a corner
        walk = routes.costs.get(state, 1000)  # many for a heading that walls keep out of reach
        cost = walk + abs(horizon - self.horizon_deg) / 30.0 + odds
        return Stance(state=state, horizon_deg=horizon, gap_m=gap, cost=cost)


def _after(state: State, action: str) -> State:
    x, z, heading = state
    if action == "MoveAhead":
        dx, dz = _AHEAD[heading]
        return x + dx, z + dz, heading
    return x, z, (heading + _TURN[action]) % 4
