"""From a camera to rays, one for each pixel, the top row first."""

from functools import lru_cache
from math import radians, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.world.camera import Camera
from karma.world.objects import heading
from karma.world.render.mesh import Floats
from karma.world.view import camera_axes


class Rays(NamedTuple):
    """Where rays start and point; a ray's length along the view is 1, so distances are depths."""

    origins: Floats  # (n, 3), on the near plane
    ways: Floats  # (n, 3)
    forward: Floats  # (3,)
    eye: Floats | None  # (3,), where all meet; None when they are parallel
    passed: Floats | None = None  # (n,): how far from the near plane origins are; None = there

    def start(self, pixels: NDArray[np.intp]) -> tuple[Floats, Floats, Floats | float]:
        """Return for some rays their origins on the near plane, ways, and what is passed since."""
        origins, ways = self.origins[pixels], self.ways[pixels]
        if self.passed is None:
            return origins, ways, 0.0
        passed = self.passed[pixels]
        return origins - ways * passed[:, None], ways, passed

    def beyond(self, pixels: NDArray[np.intp], far: Floats) -> "Rays":
        """Return some of the rays from further along."""
        ways = self.ways[pixels]
        origins = self.origins[pixels] + ways * far[:, None]
        passed = far if self.passed is None else self.passed[pixels] + far
        return self._replace(origins=origins, ways=ways, passed=passed)


def rays(view: Camera, width: int, height: int) -> Rays:
    """Return the rays of a camera's pixels, row by row."""
    axes = _axes(view)
    eye = np.array(view.position_m, dtype=np.float32)
    near = np.float32(view.near_m)
    if view.orthographic:
        plane = _plane(width, height, view.orthographic_size_m)
        ways = np.empty_like(plane)
        ways[:] = axes[2]
        origins = eye + near * axes[2] + plane[:, :2] @ axes[:2]
        return Rays(origins, ways, axes[2], None)
    ways = _plane(width, height, tan(radians(view.fov_deg) / 2)) @ axes
    return Rays(eye + ways * near, ways, axes[2], eye)


def _axes(view: Camera) -> Floats:
    """Return the rows right, up and forward, shape (3, 3)."""
    pitch, yaw, roll = view.rotation_deg
    right, up, forward = camera_axes(yaw, pitch)
    if roll % 360:
        sine, cosine = heading(roll)
        right, up = cosine * right + sine * up, cosine * up - sine * right
    return np.array([right, up, forward], dtype=np.float32)


@lru_cache(maxsize=8)
def _plane(width: int, height: int, reach: float) -> Floats:
    """Return each pixel's (right, up, 1), shape (H * W, 3); up reaches to `reach`."""
    x = ((np.arange(width) + 0.5) / width * 2 - 1) * reach * (width / height)
    y = (1 - (np.arange(height) + 0.5) / height * 2) * reach
    plane = np.empty((height, width, 3), dtype=np.float32)
    plane[..., 0], plane[..., 1], plane[..., 2] = x[None], y[:, None], 1.0
    flat = plane.reshape(-1, 3)
    flat.setflags(write=False)
    return flat
