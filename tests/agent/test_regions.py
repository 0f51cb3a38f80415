"""The projected box of an object lies where the renderer draws it."""

import numpy as np
import pytest

from karma.agent.projection import project, region_of, silhouette_of
from karma.world.sim import EmbeddedWorld

METADATA = {
    "agent": {"rotation": {"x": 0, "y": 0.0, "z": 0}, "cameraHorizon": 0.0},
    "cameraPosition": {"x": 0.0, "y": 1.5, "z": 0.0},
    "screenWidth": 300,
    "screenHeight": 300,
    "fov": 90.0,
}


def test_a_box_straight_ahead_is_in_the_middle():
    # its near side is 1 m away and 1 m wide: half of the 2 m that 90 degrees take in there
    assert project(METADATA, (0, 1.5, 1.5), (1, 1, 1)) == (75.0, 75.0, 225.0, 225.0)


def test_what_is_behind_or_beside_has_no_region():
    assert project(METADATA, (0, 1.5, -2), (1, 1, 1)) is None
    assert project(METADATA, (5, 1.5, 1), (1, 1, 1)) is None


def test_a_box_that_the_camera_stands_in_fills_the_frame():
    assert project(METADATA, (0, 1.5, 0.4), (2, 2, 1)) == (0.0, 0.0, 300.0, 300.0)


@pytest.mark.parametrize(("yaw", "horizon"), [(0, 0), (90, 30), (180, 60), (270, -30), (45, 10)])
def test_pixels_of_an_object_lie_in_its_region(yaw, horizon):
    world = EmbeddedWorld("kitchen_1")
    event = world.step(
        "TeleportFull", rotation={"x": 0, "y": yaw, "z": 0}, horizon=horizon, standing=True,
        position=event_position(world), forceAction=True,
    )  # fmt: skip
    rows = event.picture.rows
    for row, object_id in enumerate(event.state.objects):
        thing = event.get_object(object_id)
        ys, xs = np.nonzero(rows == row)
        if not len(xs) or thing["isOpen"] or thing["objectType"] in ("Floor", "Faucet"):
            continue
        left, top, right, bottom = region_of(event.metadata, thing["axisAlignedBoundingBox"])
        assert left - 3 <= xs.min() and xs.max() <= right + 3, object_id
        assert top - 3 <= ys.min() and ys.max() <= bottom + 3, object_id
        corners = silhouette_of(event.metadata, thing["axisAlignedBoundingBox"])
        assert farthest_outside(corners, np.stack([xs + 0.5, ys + 0.5], axis=1)) < 3, object_id


def farthest_outside(corners, points):
    """Return how far the farthest point lies beyond an edge of a convex polygon, pixels."""
    corners = np.array(corners)
    edges = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    return float((-((points[:, None] - corners) * inward).sum(axis=-1)).max())


def test_silhouette_of_a_box_straight_ahead_is_its_near_side():
    box = {"center": {"x": 0, "y": 1.5, "z": 1.5}, "size": {"x": 1, "y": 1, "z": 1}}
    assert silhouette_of(METADATA, box) == (
        (75.0, 75.0), (225.0, 75.0), (225.0, 225.0), (75.0, 225.0),
    )  # fmt: skip


def test_silhouette_of_what_is_behind_is_empty_and_of_what_is_beside_lies_out_of_the_frame():
    box = {"center": {"x": 0, "y": 1.5, "z": -2}, "size": {"x": 1, "y": 1, "z": 1}}
    assert silhouette_of(METADATA, box) == ()
    box["center"] = {"x": 5, "y": 1.5, "z": 1}
    assert min(x for x, _ in silhouette_of(METADATA, box)) > 300


def event_position(world):
    position = world.last_event.metadata["agent"]["position"]
    return {axis: position[axis] for axis in "xyz"}
