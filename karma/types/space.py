"""Scenes, poses and cameras.

World coordinates follow AI2-THOR: metres, y up; yaw in degrees, 0 = +z, 90 = +x; horizon in
degrees, down positive.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

Vec3 = tuple[float, float, float]


def outside_m(point: Vec3, center: Vec3, size: Vec3) -> Vec3:
    """Return how far a point is outside a box along each axis; 0 inside.

    >>> outside_m((2.0, 0.0, 0.5), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    (1.5, 0.0, 0.0)
    """
    box = zip(point, center, size, strict=True)
    x, y, z = (max(abs(at - middle) - length / 2, 0.0) for at, middle, length in box)
    return x, y, z


Frame = NDArray[np.uint8]  # (H, W, 3) RGB


Vectors = NDArray[np.float32]  # (n, d), rows of length 1


Region = tuple[float, float, float, float]  # left, top, right, bottom; pixels of a frame


Point = tuple[float, float]  # x, y; pixels of a frame


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRef:
    """A room: its name, which maps, memory and records use, and its file."""

    name: str
    path: str = ""  # "" for a room that the world knows by its name

    @classmethod
    def of(cls, source: str) -> Self:
        """Return the room that a name or a path means.

        >>> SceneRef.of("kitchen_1"), SceneRef.of("rooms/loft.json").name
        (SceneRef(name='kitchen_1', path=''), 'loft')
        """
        path = Path(source)
        is_file = path.suffix == ".json" or path.name != source
        return cls(name=path.stem, path=source) if is_file else cls(name=source)

    @property
    def source(self) -> str:
        """What `World.reset` takes."""
        return self.path or self.name


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Where the agent stands and looks."""

    position_m: Vec3
    yaw_deg: float
    horizon_deg: float
    standing: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraPose:
    """Where the agent's camera is and how it maps the world to a frame."""

    position_m: Vec3
    yaw_deg: float
    horizon_deg: float
    fov_deg: float  # vertical
    width_px: int
    height_px: int
