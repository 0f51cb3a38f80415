"""Cast a camera's rays, one for each pixel, the top row first."""

from functools import lru_cache
from math import radians, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.world.core.camera import Camera
from karma.world.core.thing import heading
from karma.world.core.view import camera_axes
from karma.world.render.mesh import Floats

Pixels = NDArray[np.intp]


class Rays(NamedTuple):
    """Where rays start and point; a ray's length along the view is 1, so distances are depths."""

    origins: Floats  # (n, 3), on the near plane or further
    directions: Floats  # (n, 3)
    steps: Floats  # (3, n): the directions again, each part in one piece
    sources: Floats  # (3, 1) or (3, n): where rays come from: the eye, or the near plane
    passed: Floats | float  # (n,): how far from there the origins are
    forward: Floats  # (3,)
    eye: Floats | None  # (3,), where all meet; None when they are parallel

    def beyond(self, pixels: Pixels, far: Floats) -> "Rays":
        """Return some of the rays from further along."""
        directions = self.directions[pixels]
        passed = self.passed if isinstance(self.passed, float) else self.passed[pixels]
        return self._replace(
            origins=self.origins[pixels] + directions * far[:, None],
            directions=directions,
            steps=self.steps[:, pixels],
            sources=self.sources if self.sources.shape[1] == 1 else self.sources[:, pixels],
            passed=far + np.float32(passed) if isinstance(passed, float) else passed + far,
        )


def rays(view: Camera, width: int, height: int) -> Rays:
    """Return the rays of a camera's pixels, row by row."""
    axes = _axes(view)
    eye = np.array(view.position_m, dtype=np.float32)
    near = np.float32(view.near_m)
    if view.orthographic:
        plane, _ = _plane(width, height, view.orthographic_size_m)
        directions = np.empty_like(plane)
        directions[:] = axes[2]
        origins = eye + near * axes[2] + plane[:, :2] @ axes[:2]
        steps, sources = (np.ascontiguousarray(part.T) for part in (directions, origins))
        return Rays(origins, directions, steps, sources, 0.0, axes[2], None)
    plane, across = _plane(width, height, tan(radians(view.fov_deg) / 2))
    directions, steps = plane @ axes, axes.T @ across
    return Rays(eye + directions * near, directions, steps, eye[:, None], float(near), axes[2], eye)


def _axes(view: Camera) -> Floats:
    """Return the rows right, up and forward, shape (3, 3)."""
    pitch, yaw, roll = view.rotation_deg
    right, up, forward = camera_axes(yaw, pitch)
    if roll % 360:
        sine, cosine = heading(roll)
        right, up = cosine * right + sine * up, cosine * up - sine * right
    return np.array([right, up, forward], dtype=np.float32)


@lru_cache(maxsize=8)
def _plane(width: int, height: int, reach: float) -> tuple[Floats, Floats]:
    """Return each pixel's (right, up, 1), shapes (n, 3) and (3, n); up reaches to `reach`."""
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * reach * (width / height)
    y = (1 - (np.arange(height) + 0.5) / height * 2) * reach
    plane = np.empty((height, width, 3), dtype=np.float32)
    plane[..., 0], plane[..., 1], plane[..., 2] = x[None], y[:, None], 1.0
    flat = plane.reshape(-1, 3)
    across = np.ascontiguousarray(flat.T)
    flat.setflags(write=False)
    across.setflags(write=False)
    return flat, across
