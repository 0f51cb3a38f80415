"""Which room a place is in, and which rooms can be walked to."""

from collections import deque

from karma.world.core.scene import Scene, SceneRoom


def room_at(scene: Scene, x: float, z: float) -> SceneRoom | None:
    """Return the room whose floor a point is on; None outside, or where a scene is one room."""
    for room in scene.rooms or ():
        if _inside(room.corners, x, z):
            return room
    return None


def _inside(corners: tuple[tuple[float, float], ...], x: float, z: float) -> bool:
    """Return whether a point is in a polygon, by counting the edges to its right."""
    inside = False
    for (x0, z0), (x1, z1) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if (z0 > z) != (z1 > z) and x < x0 + (z - z0) / (z1 - z0) * (x1 - x0):
            inside = not inside
    return inside


def rooms_reached(scene: Scene) -> frozenset[str]:
    """Return the names of the rooms that steps over the cells lead to from the agent's start."""
    grid = scene.grid_m
    cells = {(round(x / grid), round(z / grid)): (x, z) for x, z in scene.reachable}
    start_x, _, start_z = scene.agent.position
    start = (round(start_x / grid), round(start_z / grid))
    seen, queue = {start}, deque([start] if start in cells else [])
    names = set()
    while queue:
        column, row = cell = queue.popleft()
        room = room_at(scene, *cells[cell])
        if room is not None:
            names.add(room.name)
        for step in ((column + 1, row), (column - 1, row), (column, row + 1), (column, row - 1)):
            if step in cells and step not in seen:
                seen.add(step)
                queue.append(step)
    return frozenset(names)
