"""Which room a place is in, and which rooms can be walked to."""

from karma.world.core.ground import inside, walk
from karma.world.core.scene import Scene, SceneRoom


def room_at(scene: Scene, x: float, z: float) -> SceneRoom | None:
    """Return the room whose floor a point is on; None outside, or where a scene is one room."""
    for room in scene.rooms or ():
        if inside(room.corners, x, z):
            return room
    return None


def room_name(scene: Scene, x: float, z: float) -> str:
    """Return the name of the room that a point is in; of the scene where it is in none."""
    room = room_at(scene, x, z)
    return room.name if room is not None else scene.name


def rooms_reached(scene: Scene) -> frozenset[str]:
    """Return the names of the rooms that steps over the cells lead to from the agent's start."""
    grid = scene.grid_m
    cells = {(round(x / grid), round(z / grid)): (x, z) for x, z in scene.reachable}
    start_x, _, start_z = scene.agent.position
    start = (round(start_x / grid), round(start_z / grid))
    reached = walk(cells, start) if start in cells else {}
    rooms = (room_at(scene, *cells[cell]) for cell in reached)
    return frozenset(room.name for room in rooms if room is not None)
