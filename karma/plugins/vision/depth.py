"""Pictures with depth: where in the world the pixels of an object are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from karma.agent.seeing.projection import axes_of
from karma.errors import KarmaError
from karma.types.roles import Event
from karma.types.space import CameraPose, Frame, Region, Vec3

_STRAYS = 2.0  # percent of the points on each side that are left out of a box
_CORE = 0.25  # of a box without a mask: the share on each side that may show something else

Points = NDArray[np.float64]  # (n, 3), metres
Box = tuple[Vec3, Vec3]  # centre and size, metres


@dataclass(frozen=True, slots=True, kw_only=True)
class Capture:
    """What a camera takes in of one moment, with the simulator's own instance masks."""

    rgb: Frame
    depth_m: NDArray[np.float32]  # (H, W), metres along the camera's forward axis
    masks: Mapping[str, NDArray[np.bool_]]  # object id -> where it shows, (H, W)


def pixels_of(event: Event) -> Capture:
    """Return the picture of an event, with depth and instance masks; KarmaError for none."""
    frame = event.frame
    depth: Any = getattr(event, "depth_frame", None)
    masks: Any = getattr(event, "instance_masks", None)
    if frame is None or depth is None or masks is None:
        raise KarmaError(
            "perception = 'pictures': the world draws no pictures with depth and instance masks\n"
            "  To fix: make it with renderDepthImage and renderInstanceSegmentation, as `karma run "
            "--perception pictures` and `karma eval` do"
        )
    return Capture(rgb=frame, depth_m=depth, masks=masks)


def points_in(depth_m: NDArray[np.float32], mask: NDArray[np.bool_], camera: CameraPose) -> Points:
    """Return where in the world the pixels of a mask are, shape (n, 3), metres.

    `depth_m`, along the camera's forward axis, and `mask` have the shape (H, W).
    """
    rows, columns = np.nonzero(mask)
    forward = depth_m[rows, columns].astype(np.float64)
    scale = 2 * np.tan(np.radians(camera.fov_deg) / 2) / camera.height_px
    right = (columns + 0.5 - camera.width_px / 2) * scale * forward
    up = (camera.height_px / 2 - rows - 0.5) * scale * forward
    from_eye = np.stack([right, up, forward], axis=1) @ axes_of(camera)
    return np.asarray(from_eye + np.asarray(camera.position_m))


def box_round(points: Points) -> Box:
    """Return the upright box round points, strays left out: the sides of a thing that were seen."""
    low, high = np.percentile(points, [_STRAYS, 100 - _STRAYS], axis=0)
    return _vector((low + high) / 2), _vector(high - low)


def gap_m(points: Points, from_m: Vec3) -> float:
    """Return how far across the floor the nearest of the points is, strays left out."""
    gaps = np.hypot(points[:, 0] - from_m[0], points[:, 2] - from_m[2])
    return float(np.percentile(gaps, _STRAYS))


def core_of(region: Region, height: int, width: int) -> NDArray[np.bool_]:
    """Return the middle of a box as a mask, for a detector that gives none, shape (H, W)."""
    left, top, right, bottom = region
    aside, above = (right - left) * _CORE, (bottom - top) * _CORE
    mask = np.zeros((height, width), dtype=bool)
    rows = slice(int(top + above), max(int(bottom - above), int(top + above) + 1))
    mask[rows, int(left + aside) : max(int(right - aside), int(left + aside) + 1)] = True
    return mask


def joined(one: Box, other: Box) -> Box:
    """Return the box round two boxes."""
    lows, highs = zip(*(_sides(box) for box in (one, other)), strict=True)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    return _vector((low + high) / 2), _vector(high - low)


def _sides(box: Box) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    center, size = np.asarray(box[0]), np.asarray(box[1])
    return center - size / 2, center + size / 2


def _vector(row: NDArray[np.float64]) -> Vec3:
    x, y, z = (round(float(value), 3) for value in row)
    return x, y, z
