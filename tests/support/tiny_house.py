"""A house of ProcTHOR's form, small enough to read, and ways to walk in any scene."""

from collections import deque
from copy import deepcopy
from itertools import pairwise

from karma.plugins.homes.houses import room_at

TABLE = {
    "id": "DiningTable|2|0", "position": {"x": 1.5, "y": 0.4, "z": 1.5},
    "rotation": {"x": 0, "y": 0, "z": 0}, "assetId": "Table_1",
    "children": [
        {"id": "Apple|surface|2|0", "position": {"x": 1.5, "y": 0.85, "z": 1.5}},
        {"id": "Bowl|surface|2|1", "position": {"x": 1.2, "y": 0.85, "z": 1.5}},
    ],
}  # fmt: skip
ASSETS = {"Table_1": {"objectType": "DiningTable", "boundingBox": {"x": 1.2, "y": 0.8, "z": 0.8}}}
KITCHEN = ((0, 0), (0, 4), (4, 4), (4, 0))
BEDROOM = ((4, 0), (4, 4), (8, 4), (8, 2), (6, 2), (6, 0))  # an L


def xyz(x, y, z):
    """Return a point as the form writes it."""
    return {"x": x, "y": y, "z": z}


def wall(room, p, q, **fields):
    """Return one side of a wall from p to q, as the form writes it."""
    (x0, z0), (x1, z1) = p, q
    where = f"{min(x0, x1):.2f}|{min(z0, z1):.2f}|{max(x0, x1):.2f}|{max(z0, z1):.2f}"
    return {
        "id": f"wall|{room}|{where}",
        "roomId": "exterior" if room == "exterior" else f"room|{room}",
        "polygon": [xyz(x0, 0, z0), xyz(x1, 0, z1), xyz(x0, 2.5, z0), xyz(x1, 2.5, z1)],
        **fields,
    }


def ground(corners):
    """Return a floor as the form writes it."""
    return [xyz(x, 0, z) for x, z in corners]


def ring(room, corners):
    """Return the walls round a room."""
    return [wall(room, p, q) for p, q in zip(corners, (*corners[1:], corners[0]), strict=True)]


def tiny_house():
    """Return a kitchen with a table, and an L-shaped bedroom behind a door 1 m wide.

    The kitchen's wall at x = 4 runs from z = 4 down to 0; the hole begins 1 m along it.
    """
    return {
        "rooms": [
            {"id": "room|2", "roomType": "Kitchen", "floorPolygon": ground(KITCHEN)},
            {"id": "room|3", "roomType": "Bedroom", "floorPolygon": ground(BEDROOM)},
        ],
        "walls": [*ring(2, KITCHEN), *ring(3, BEDROOM)],
        "doors": [
            {
                "id": "door|2|3", "assetId": "Doorway_1", "room0": "room|2", "room1": "room|3",
                "wall0": "wall|2|4.00|0.00|4.00|4.00", "wall1": "wall|3|4.00|0.00|4.00|4.00",
                "holePolygon": [xyz(1, 0, 0), xyz(2, 2.1, 0)], "openable": True, "openness": 1,
            }
        ],
        "windows": [],
        "objects": [deepcopy(TABLE)],
        "metadata": {
            "agent": {"position": xyz(3.02, 0.95, 2.98), "rotation": xyz(0, 90, 0), "horizon": 30},
            "schema": "1.0.0",
        },
    }  # fmt: skip


def ways(scene):
    """Return each cell that steps lead to from the agent's start, with the cell before it."""
    cells = {(round(x / scene.grid_m), round(z / scene.grid_m)) for x, z in scene.reachable}
    x, _, z = scene.agent.position
    start = (round(x / scene.grid_m), round(z / scene.grid_m))
    before, queue = {start: start}, deque([start])
    while queue:
        i, j = cell = queue.popleft()
        for step in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            if step in cells and step not in before:
                before[step] = cell
                queue.append(step)
    return before


def route(before, goal):
    """Return the cells from the start to a goal."""
    found = [goal]
    while before[found[-1]] != found[-1]:
        found.append(before[found[-1]])
    return found[::-1]


def rooms_walked(world, scene):
    """Walk from the start to the middle of each room by single steps; return where one came to.

    Every action must succeed. The agent is put back at the start for each room.
    """
    before = ways(scene)
    x, y, z = scene.agent.position
    came = set()
    for room in scene.rooms:
        mine = [
            c for c in before if room_at(scene, c[0] * scene.grid_m, c[1] * scene.grid_m) == room
        ]
        goal = sorted(mine)[len(mine) // 2]
        start = world.step("TeleportFull", position=xyz(x, y, z), rotation=xyz(0, 0, 0),
                           horizon=0, standing=True)  # fmt: skip
        assert start, start.metadata["errorMessage"]
        yaw, cells = 0, route(before, goal)
        for (i, j), (k, m) in pairwise(cells):
            turn = {(0, 1): 0, (1, 0): 90, (0, -1): 180, (-1, 0): 270}[k - i, m - j]
            for _ in range((turn - yaw) % 360 // 90):
                assert world.step("RotateRight")
            yaw = turn
            event = world.step("MoveAhead")
            assert event, event.metadata["errorMessage"]
        here = world.state.pose.position_m
        assert (round(here[0] / scene.grid_m), round(here[2] / scene.grid_m)) == goal
        came.add(room_at(scene, here[0], here[2]).name)
    return came
