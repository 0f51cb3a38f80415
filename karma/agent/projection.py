"""Where in a picture an object is: its box in the world, projected by the camera's own pose.

This is a perception aid. It needs coordinates and the camera, which AI2-THOR's metadata gives in
every world (KARMA §3.4: "acquired through a simulator"), and no segmentation; it tells nothing of
an object's state.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from karma.contracts import Point, Region

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


def silhouette_of(metadata: Mapping[str, Any], box: Mapping[str, Any]) -> tuple[Point, ...]:
    """Return the corners of what an object's box covers in the frame, in order; pixels, unclipped.

    Args:
        metadata: of the event that the frame belongs to.
        box: the object's `axisAlignedBoundingBox` then.
    """
    points = _points(metadata, _vector(box["center"]), _vector(box["size"]))
    ordered = sorted({(round(float(x), 1), round(float(y), 1)) for x, y in points})
    return (*_chain(ordered), *_chain(ordered[::-1]))


def project(metadata: Mapping[str, Any], center: Any, size: Any) -> Region | None:
    """Return where an upright box is in the frame: left, top, right, bottom; pixels, clipped.

    Args:
        metadata: of the event that the frame belongs to.
        center: of the box, metres.
        size: along x, y and z, metres.
    """
    points = _points(metadata, center, size)
    if not len(points):
        return None
    width, height = float(metadata["screenWidth"]), float(metadata["screenHeight"])
    left, right = np.clip([points[:, 0].min(), points[:, 0].max()], 0, width)
    top, bottom = np.clip([points[:, 1].min(), points[:, 1].max()], 0, height)
    if right - left < 1 or bottom - top < 1:
        return None
    return (
        round(float(left), 1),
        round(float(top), 1),
        round(float(right), 1),
        round(float(bottom), 1),
    )


def _points(metadata: Mapping[str, Any], center: Any, size: Any) -> np.ndarray:
    """Return where a box's corners are in the frame, shape (n, 2), pixels."""
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
    points = _before(corners).reshape(-1, 3)
    width, height = float(metadata["screenWidth"]), float(metadata["screenHeight"])
    scale = height / 2 / np.tan(np.radians(float(metadata["fov"])) / 2)
    x = width / 2 + points[:, 0] / points[:, 2] * scale
    y = height / 2 - points[:, 1] / points[:, 2] * scale
    return np.stack([x, y], axis=1)


def _chain(points: Sequence[Point]) -> list[Point]:
    """Return one side of the hull of ordered points, without its last point (Andrew, 1979)."""
    found: list[Point] = []
    for x, y in points:
        while len(found) > 1:
            (x0, y0), (x1, y1) = found[-2:]
            if (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0):
                break
            found.pop()
        found.append((x, y))
    return found[:-1]


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
