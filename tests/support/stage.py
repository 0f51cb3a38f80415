"""Small scenes for pictures, and cameras that look at them."""

import math
from dataclasses import replace

from karma.world.core.scene import AgentPose, Scene
from karma.world.core.state import Camera, Settings, begin
from support.household import thing


def room(*objects, size=(4.0, 2.5, 4.0), cells=((0.0, 0.0),), name="stage"):
    """A room round the origin, its floor at 0, with nothing in it but the objects."""
    return Scene(
        name=name,
        room="Kitchen",
        source="tests/support/stage.py",
        agent=AgentPose(position=(0.0, 0.9, 0.0)),
        reachable=cells,
        bounds_center=(0.0, size[1] / 2, 0.0),
        bounds_size=size,
        objects=tuple(objects),
    )


def moment(*objects, **more):
    return begin(room(*objects, **more), Settings())


def alone(kind, **state):
    """One object of a type on the floor in the middle of a large room."""
    size = thing(kind, (0.0, 0.0, 0.0)).size
    one = thing(kind, (0.0, size[1] / 2, 0.0), **state)
    now = moment(one, size=(8.0, 3.0, 8.0), cells=((0.0, 2.0),))
    return facing(now, 0, position=(3.5, 0.9, 3.5)), size


def towards(target, *, yaw=200.0, pitch=25.0, far=1.0, fov=45.0):
    """A camera that looks at a place from a distance."""
    down, turn = math.radians(pitch), math.radians(yaw)
    forward = (
        math.sin(turn) * math.cos(down),
        -math.sin(down),
        math.cos(turn) * math.cos(down),
    )
    place = tuple(a - b * far for a, b in zip(target, forward, strict=True))
    return Camera(position_m=place, rotation_deg=(pitch, yaw, 0.0), fov_deg=fov)


def close_up(kind, **state):
    """A moment with one object, and a camera that fills the picture with it."""
    now, size = alone(kind, **state)
    radius = max(math.hypot(*size) / 2, 0.03)
    return now, towards((0.0, size[1] / 2, 0.0), far=radius * 3)


def facing(state, yaw, horizon=0.0, position=None):
    """The moment with the agent turned, and perhaps elsewhere."""
    pose = replace(
        state.pose,
        yaw_deg=float(yaw),
        horizon_deg=float(horizon),
        position_m=position or state.pose.position_m,
    )
    return replace(state, pose=pose)
