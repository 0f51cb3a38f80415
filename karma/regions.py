"""Where in a picture an object is: its box in the world, projected by the camera's own pose.

This is a perception aid. It needs coordinates and the camera, which AI2-THOR's metadata gives in
every world (KARMA §3.4: "acquired through a simulator"), and no segmentation; it tells nothing of
an object's state.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from karma.contracts import Region

NEAR_M = 0.05
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b).bit_count() == 1]


def region_of(metadata: Mapping[str, Any], box: Mapping[str, Any]) -> Region | None:
    """Return the part of the frame that an object's box takes, None when it is out of the frame.

    Args:
        metadata: of the event that the frame belongs to.
        box: the object's `axisAlignedBoundingBox` then.
    """
    center, size = _vector(box["center"]), _vector(box["size"])
    return project(metadata, center, size)


def project(metadata: Mapping[str, Any], center: Any, size: Any) -> Region | None:
    """Return where an upright box is in the frame: left, top, right, bottom; pixels, clipped.

    Args:
        metadata: of the event that the frame belongs to.
        center: of the box, metres.
        size: along x, y and z, metres.
    """
    agent = metadata["agent"]
    eye = _vector(metadata["cameraPosition"])
    yaw, pitch = np.radians([float(agent["rotation"]["y"]), float(agent["cameraHorizon"])])
    axes = np.array(
        [
            (np.cos(yaw), 0.0, -np.sin(yaw)),
            (np.sin(yaw) * np.sin(pitch), np.cos(pitch), np.cos(yaw) * np.sin(pitch)),
            (np.sin(yaw) * np.cos(pitch), -np.sin(pitch), np.cos(yaw) * np.cos(pitch)),
        ]
    )
    signs = np.array([[(i >> axis) & 1 for axis in range(3)] for i in range(8)]) - 0.5
    corners = (np.asarray(center) + signs * np.asarray(size) - eye) @ axes.T
    points = _before(corners)
    if not len(points):
        return None
    width, height = float(metadata["screenWidth"]), float(metadata["screenHeight"])
    scale = height / 2 / np.tan(np.radians(float(metadata["fov"])) / 2)
    x = width / 2 + points[:, 0] / points[:, 2] * scale
    y = height / 2 - points[:, 1] / points[:, 2] * scale
    left, right = np.clip([x.min(), x.max()], 0, width)
    top, bottom = np.clip([y.min(), y.max()], 0, height)
    if right - left < 1 or bottom - top < 1:
        return None
    return (
        round(float(left), 1),
        round(float(top), 1),
        round(float(right), 1),
        round(float(bottom), 1),
    )


def _before(corners: np.ndarray) -> np.ndarray:
    """Return a box's corners before the camera, and where its edges come through the near plane."""
    found = [corner for corner in corners if corner[2] >= NEAR_M]
    for a, b in _EDGES:
        one, other = corners[a], corners[b]
        if (one[2] < NEAR_M) != (other[2] < NEAR_M):
            share = (NEAR_M - one[2]) / (other[2] - one[2])
            found.append(one + share * (other - one))
    return np.array(found)


def _vector(point: Mapping[str, float]) -> np.ndarray:
    return np.array([point["x"], point["y"], point["z"]], dtype=np.float64)
