"""Go to an object: the benchmark's `find` teleports, and nobody looks whether it is seen."""

import math
from collections.abc import Iterator

from karma.household.ids import root_type
from karma.household.uses import FRIDGE, MICROWAVE
from karma.world.core.view import CAMERA_M
from karma.world.eb_alfred.choosing import Thing
from karma.world.sim import EmbeddedWorld

_TRIES, _FROM_THE_SIDE = 20, 10
_AS_TOLD_M = 0.9 + 0.75  # the camera's height in the source, which is too high
_TILT = 0.9  # of the angle to the object
_LEAST_DEG, _MOST_DEG = -30.0, 60.0  # that AI2-THOR's looks reach


def go_to(world: EmbeddedWorld, thing: Thing, *, strict: bool) -> bool:
    """Teleport to the cell nearest to an object's origin, turned to it; tell if one was free.

    Args:
        world: of the episode.
        thing: an object of its metadata.
        strict: tilt as from the source's height, and beyond what looks reach.
    """
    x, y, z = (float(thing["position"][axis]) for axis in "xyz")
    state = world.state
    height = _AS_TOLD_M if strict else state.pose.position_m[1] + CAMERA_M
    for cell_x, cell_z in _cells(world, thing):
        if state.room.key(cell_x, cell_z) not in state.cells:
            continue
        far = math.hypot(x - cell_x, z - cell_z)
        tilt = _TILT * math.degrees(math.atan2(height - y, far))
        if not strict:
            tilt = min(max(tilt, _LEAST_DEG), _MOST_DEG)
        event = world.step(
            "TeleportFull",
            x=cell_x,
            y=state.pose.position_m[1],
            z=cell_z,
            rotation={"x": 0.0, "y": _yaw(x - cell_x, z - cell_z), "z": 0.0},
            horizon=tilt,
            standing=True,
            forceAction=strict,  # else a tilt that looks do not reach is refused
        )
        if event.success:
            return True
    return False


def _cells(world: EmbeddedWorld, thing: Thing) -> Iterator[tuple[float, float]]:
    """Yield the cells to try; those of fridges and microwaves from the front first."""
    x, z = float(thing["position"]["x"]), float(thing["position"]["z"])
    ranked = sorted(world.state.room.cells.values(), key=lambda at: (math.dist(at, (x, z)), at))[
        :_TRIES
    ]
    kind = root_type(thing["objectId"])
    if kind not in (FRIDGE, MICROWAVE):
        yield from ranked
        return
    turn = float(thing["rotation"]["y"])
    near = ranked[:_FROM_THE_SIDE]
    for at in near:
        off = abs((_yaw(x - at[0], z - at[1]) - turn + 180.0) % 360.0 - 180.0)
        if 70.0 < off < 110.0 if kind == FRIDGE else off < 20.0 or off > 160.0:
            yield at
    yield from near


def _yaw(right: float, ahead: float) -> float:
    return math.degrees(math.atan2(right, ahead)) % 360.0
