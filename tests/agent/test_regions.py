"""The projected box of an object lies where the renderer draws it."""

import numpy as np
import pytest

from karma.agent.seeing.perceive import camera_of, pose_of, truth_of
from karma.agent.seeing.projection import placed, region_of, silhouette_of
from karma.types.space import CameraPose
from karma.world.sim import EmbeddedWorld

CAMERA = CameraPose(
    position_m=(0.0, 1.5, 0.0), yaw_deg=0.0, horizon_deg=0.0, fov_deg=90.0,
    width_px=300, height_px=300,
)  # fmt: skip


def test_a_box_straight_ahead_is_in_the_middle():
    # its near side is 1 m away and 1 m wide: half of the 2 m that 90 degrees take in there
    assert region_of(CAMERA, (0, 1.5, 1.5), (1, 1, 1)) == (75.0, 75.0, 225.0, 225.0)


def test_what_is_behind_or_beside_has_no_region():
    assert region_of(CAMERA, (0, 1.5, -2), (1, 1, 1)) is None
    assert region_of(CAMERA, (5, 1.5, 1), (1, 1, 1)) is None


def test_a_box_that_the_camera_stands_in_fills_the_frame():
    assert region_of(CAMERA, (0, 1.5, 0.4), (2, 2, 1)) == (0.0, 0.0, 300.0, 300.0)


@pytest.mark.parametrize(("yaw", "horizon"), [(0, 0), (90, 30), (180, 60), (270, -30), (45, 10)])
def test_pixels_of_an_object_lie_in_its_region(yaw, horizon):
    world = EmbeddedWorld("kitchen_1")
    event = world.step(
        "TeleportFull", rotation={"x": 0, "y": yaw, "z": 0}, horizon=horizon, standing=True,
        position=event_position(world), forceAction=True,
    )  # fmt: skip
    rows = event.picture.rows
    things = {thing.object_id: thing for thing in truth_of(event).objects}
    for row, object_id in enumerate(event.state.objects):
        ys, xs = np.nonzero(rows == row)
        if not len(xs) or object_id not in things:
            continue
        thing = placed(things[object_id], camera_of(event))
        if "opened" in thing.states or thing.object_type in ("Floor", "Faucet"):
            continue
        left, top, right, bottom = thing.region
        assert left - 3 <= xs.min() and xs.max() <= right + 3, object_id
        assert top - 3 <= ys.min() and ys.max() <= bottom + 3, object_id
        assert farthest_outside(thing.silhouette, np.stack([xs + 0.5, ys + 0.5], axis=1)) < 3, (
            object_id
        )


def farthest_outside(corners, points):
    """Return how far the farthest point lies beyond an edge of a convex polygon, pixels."""
    corners = np.array(corners)
    edges = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    return float((-((points[:, None] - corners) * inward).sum(axis=-1)).max())


def test_silhouette_of_a_box_straight_ahead_is_its_near_side():
    assert silhouette_of(CAMERA, (0, 1.5, 1.5), (1, 1, 1)) == (
        (75.0, 75.0), (225.0, 75.0), (225.0, 225.0), (75.0, 225.0),
    )  # fmt: skip


def test_silhouette_of_what_is_behind_is_empty_and_of_what_is_beside_lies_out_of_the_frame():
    assert silhouette_of(CAMERA, (0, 1.5, -2), (1, 1, 1)) == ()
    assert min(x for x, _ in silhouette_of(CAMERA, (5, 1.5, 1), (1, 1, 1))) > 300


def event_position(world):
    return dict(zip("xyz", pose_of(world.last_event).position_m, strict=True))
