"""Compute what the agent sees: reach, field of view and rays, over boxes instead of meshes.

As AI2-THOR's default scheme: an object counts when its box is within `visibility_m` of the agent's
axis, measured across the floor, and a ray from the camera meets one of its sample points inside
the picture before anything else. Simplified: the held object and the agent's body hide nothing,
doors do not swing, and hollow furniture hides only the part of its box that `rules.toml` names.
"""

import math
from collections.abc import Iterable
from functools import cached_property
from itertools import compress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from karma.types.space import Pose, Vec3
from karma.world.core.boxes import Flags, Floats
from karma.world.core.hiding import blocking, hidden_rows, solid_boxes
from karma.world.core.objects import Derived, Objects
from karma.world.core.rays import NO_SHELL, RoomShell, farthest, stopped
from karma.world.core.rules import rules
from karma.world.core.thing import heading

CAMERA_M = 0.675  # above the agent's origin
CROUCH_M = 0.22  # lower when crouching
BEYOND_M = 0.5  # how much farther than its reach across the floor the agent sees things
_BODY_TOP_M = 0.9  # of the agent's capsule, above its origin
_MOST_VANTAGES = 256  # places remembered of one moment; a few kilobytes each
_PULL = (-0.85, 0.0, 0.85)
SAMPLES = np.array([(x, y, z) for x in _PULL for y in _PULL for z in _PULL])  # of the half sizes


class InView:
    """What is in view, and what of it is not only seen through glass."""

    def __init__(self, ids: Iterable[str], visible: Flags, interactable: Flags) -> None:
        self._ids = ids
        self.visible_rows = visible  # shape (objects,)
        self.interactable_rows = interactable

    @cached_property
    def visible(self) -> frozenset[str]:
        """Ids in view."""
        return frozenset(compress(self._ids, self.visible_rows))

    @cached_property
    def interactable(self) -> frozenset[str]:
        """Ids in view that are not only seen through glass."""
        return frozenset(compress(self._ids, self.interactable_rows))


_Place = tuple[Vec3, Vec3, float]  # of the eye and the agent, and the reach


class _Vantage(NamedTuple):
    """What can be seen from one place, whichever way one looks: points that nothing hides."""

    offsets: Floats  # of the points from the eye, shape (points, 3)
    rows: NDArray[np.intp]  # of the objects that the points are on
    clear: Flags  # whether no glass is in between


# filled as places are looked from
_vantages: Derived[dict[_Place, _Vantage]] = Derived(
    lambda objects: {}, "place", "parents", "inert", "open", "held"
)


def camera(pose: Pose) -> Vec3:
    """Return the camera's place, metres."""
    x, y, z = pose.position_m
    return (x, y + CAMERA_M - (0.0 if pose.standing else CROUCH_M), z)


def camera_axes(yaw_deg: float, horizon_deg: float) -> Floats:
    """Return the rows right, up and forward of a camera, shape (3, 3)."""
    sine, cosine = heading(yaw_deg)
    dip_sine, dip_cosine = heading(horizon_deg)
    return np.array(
        [
            (cosine, 0.0, -sine),
            (sine * dip_sine, dip_cosine, cosine * dip_sine),
            (sine * dip_cosine, -dip_sine, cosine * dip_cosine),
        ]
    )


def in_picture(offsets: Floats, axes: Floats, fov_deg: float, aspect: float) -> Flags:
    """Return which points fall inside the picture; aspect is its width over height.

    Offsets from the camera have shape (..., points, 3), axes (3, 3) or what broadcasts with them.
    """
    turned = offsets @ axes.swapaxes(-1, -2)
    right, up, forward = turned[..., 0], turned[..., 1], turned[..., 2]
    reach = forward * math.tan(math.radians(fov_deg) / 2)
    inside: Flags = (forward > 0) & (abs(right) < reach * aspect) & (abs(up) < reach)
    return inside


def across(objects: Objects, x: float, z: float) -> Floats:
    """Return each box's distance from a vertical axis, shape (n,), metres."""
    gap_x = np.maximum(np.abs(objects.boxes.center[:, 0] - x) - objects.boxes.half[:, 0], 0.0)
    gap_z = np.maximum(np.abs(objects.boxes.center[:, 2] - z) - objects.boxes.half[:, 2], 0.0)
    return np.hypot(gap_x, gap_z)


def sight(
    objects: Objects,
    pose: Pose,
    *,
    held: frozenset[str] = frozenset(),
    visibility_m: float = 1.5,
    fov_deg: float = 90.0,
    aspect: float = 1.0,
    shell: RoomShell = NO_SHELL,
) -> InView:
    """Return what is in view from a pose; what is held, with its contents, is: it hides nothing."""
    visible, interactable = np.zeros((2, len(objects)), dtype=bool)
    if len(objects):
        seen = _vantage(objects, pose, held, visibility_m, shell)
        axes = camera_axes(pose.yaw_deg, pose.horizon_deg)
        inside = in_picture(seen.offsets, axes, fov_deg, aspect)
        visible[seen.rows[inside]] = True
        interactable[seen.rows[inside & seen.clear]] = True
        for object_id in held:
            visible[objects.rows[object_id]] = interactable[objects.rows[object_id]] = True
    return InView(objects, visible, interactable)


def _vantage(
    objects: Objects, pose: Pose, held: frozenset[str], visibility_m: float, shell: RoomShell
) -> _Vantage:
    """Return what can be seen from the camera's place; known places are looked up."""
    eye = camera(pose)
    key = (eye, pose.position_m, visibility_m)
    known = _vantages(objects)
    found = known.get(key)
    if found is None:
        found = _look_round(objects, pose, held, visibility_m, shell)
        if len(known) >= _MOST_VANTAGES:  # the oldest makes room
            del known[next(iter(known))]
        known[key] = found
    return found


def _look_round(
    objects: Objects, pose: Pose, held: frozenset[str], visibility_m: float, shell: RoomShell
) -> _Vantage:
    x, y, z = pose.position_m
    near = across(objects, x, z) <= visibility_m
    near &= objects.boxes.low[:, 1] <= y + _BODY_TOP_M + visibility_m
    near &= ~hidden_rows(objects)
    for object_id in held:
        near[objects.rows[object_id]] = False
    candidates = np.flatnonzero(near)
    eye = np.array(camera(pose))
    points = sample_points(objects, candidates, eye, visibility_m)
    targets = np.repeat(candidates, points.shape[1])
    points = points.reshape(-1, 3)
    offsets = points - eye
    solid, glass = blocked(objects, eye, points, targets, held, shell)
    return _Vantage(offsets[~solid], targets[~solid], ~glass[~solid])


def sample_points(
    objects: Objects, targets: np.ndarray, eye: Floats, visibility_m: float
) -> Floats:
    """Return points of some boxes, the one nearest to the eye last, shape (targets, 28, 3).

    Of a long counter, or the floor, they are spread over the part within reach and a little more.
    """
    reach = np.array((visibility_m + BEYOND_M, np.inf, visibility_m + BEYOND_M))
    low, high = objects.boxes.low[targets], objects.boxes.high[targets]
    low, high = (
        np.minimum(np.maximum(low, eye - reach), high),
        np.maximum(np.minimum(high, eye + reach), low),
    )
    center, half = ((low + high) / 2)[:, None], ((high - low) / 2)[:, None]
    nearest = np.clip(eye, center - half * 0.95, center + half * 0.95)
    return np.concatenate([center + half * SAMPLES, nearest], axis=1)


def blocked(
    objects: Objects,
    eye: Floats,
    ends: Floats,
    targets: np.ndarray,
    held: frozenset[str],
    shell: RoomShell,
) -> tuple[Flags, Flags]:
    """Return per ray whether something solid, or something see-through, is in its way."""
    hiding, glass = occluders(objects, held)
    # L-shaped counters and open doors that the agent stands in hide nothing
    hiding &= ~boxes_round(objects, eye[0], eye[2])
    hiding &= across(objects, eye[0], eye[2]) <= farthest(eye, ends)  # others cut no segment
    rows = np.flatnonzero(hiding)
    things, which = np.unique(targets, return_inverse=True)
    ray, row = stopped(objects, eye, ends, rows, blocking(objects, things)[:, rows][which], shell)
    clear = glass[row]
    solid, through_glass = np.zeros((2, len(ends)), dtype=bool)
    solid[ray[~clear]] = True
    solid |= shell.hides(eye, ends)
    through_glass[ray[clear]] = True
    return solid, through_glass


def occluders(objects: Objects, held: frozenset[str]) -> tuple[Flags, Flags]:
    """Return which objects hide others, and which of them are see-through, each shape (n,)."""
    low, high = solid_boxes(objects)
    hiding = (high[:, 1] - low[:, 1] > 1e-6) & ~hidden_rows(objects)
    for object_id in held:
        hiding[objects.rows[object_id]] = False
    glass = np.zeros(len(objects), dtype=bool)
    glass[[objects.rows[one.id] for one in objects.of_types(*rules().view.see_through)]] = True
    return hiding, glass


def boxes_round(objects: Objects, x: float, z: float) -> Flags:
    """Return whether each box has a vertical line through it, shape (n,)."""
    boxes = objects.boxes
    inside: Flags = np.all(
        np.abs(boxes.center[:, [0, 2]] - (x, z)) <= boxes.half[:, [0, 2]], axis=1
    )
    return inside
