"""Draw the agent for other cameras: a white post with a head that shows where it looks."""

from functools import lru_cache

import numpy as np

from karma.contracts import Pose
from karma.world.core.camera import Camera
from karma.world.core.thing import heading
from karma.world.core.view import camera as eye
from karma.world.render.layer import Layer
from karma.world.render.mesh import ball, box, joined, lathe
from karma.world.render.pixels import AGENT

RADIUS_M = 0.19
INSIDE_M = 0.3  # cameras this near to the agent's axis see through it
FEET_M = 0.9  # the agent's origin is this far above the floor
_WHITE, _DARK, _BLUE = (226.0, 230.0, 234.0), (38.0, 42.0, 48.0), (60.0, 140.0, 220.0)


def sees_body(view: Camera, pose: Pose) -> bool:
    """Return whether a camera is far enough from the agent not to look out of it."""
    x, _, z = pose.position_m
    return (view.position_m[0] - x) ** 2 + (view.position_m[2] - z) ** 2 > INSIDE_M**2 or (
        view.orthographic
    )


@lru_cache(maxsize=4)
def body(pose: Pose) -> Layer:
    """Return the agent's body, which is no object of the scene."""
    x, y, z = pose.position_m
    top = eye(pose)[1]
    low, r = y - FEET_M, RADIUS_M
    post = lathe(
        [(0.0, low), (r, low), (r, low + 0.2), (r * 0.6, low + 0.3), (r * 0.6, top - 0.25),
         (r, top - 0.15), (0.0, top - 0.15)],
        [_DARK, _DARK, _DARK, _WHITE, _WHITE, _WHITE],
    )  # fmt: skip
    head = ball((0.0, top, 0.0), (r * 0.8, 0.12, r * 0.8), _WHITE)
    face = box((-r * 0.6, top - 0.05, r * 0.5), (r * 0.6, top + 0.05, r * 0.86), _BLUE)
    whole = joined([post, head, face])
    sine, cosine = heading(pose.yaw_deg)
    axes = np.array([(cosine, 0, -sine), (0, 1, 0), (sine, 0, cosine)], dtype=np.float32)
    place = np.array([x, 0.0, z], dtype=np.float32)
    return Layer((AGENT,), [whole._replace(vertices=whole.vertices @ axes + place)])
