"""Places measured from pixels and depth, held against the boxes that the scene file has."""

import numpy as np
import pytest

from karma.agent.seeing.perceive import camera_of, truth_of
from karma.errors import KarmaError
from karma.plugins.vision.depth import box_round, core_of, gap_m, joined, pixels_of, points_in
from karma.world.sim import EmbeddedWorld

SLACK_M = 0.03  # meshes are not quite their boxes, and strays are left out


@pytest.fixture(scope="module")
def events():
    world = EmbeddedWorld("kitchen_1", renderDepthImage=True, renderInstanceSegmentation=True)
    turns = ("LookDown", "RotateRight", "RotateRight", "RotateRight", "LookUp", "RotateRight")
    return [world.last_event, *(world.step(action) for action in turns)]


def test_points_of_every_mask_lie_in_the_box_that_the_scene_has(events):
    measured = 0
    for event in events:
        pixels, camera = pixels_of(event), camera_of(event)
        true = {one.object_id: one for one in truth_of(event).objects}
        for name, mask in pixels.masks.items():
            if mask.sum() < 100:
                continue
            center, size = box_round(points_in(pixels.depth_m, mask, camera))
            one = true[name]
            outside = np.abs(np.subtract(center, one.box_center_m)) + np.array(size) / 2
            assert (outside <= np.array(one.box_size_m) / 2 + SLACK_M).all(), name
            measured += 1
    assert measured > 50


def test_gap_of_points_is_measured_across_the_floor():
    points = np.array([[3.0, 2.0, 4.0]] * 100 + [[30.0, 0.0, 40.0]] * 100)
    assert gap_m(points, (0.0, 0.9, 0.0)) == pytest.approx(5.0)


def test_core_of_a_box_is_its_middle_and_never_empty():
    mask = core_of((10.0, 20.0, 30.0, 60.0), 100, 100)
    rows, columns = np.nonzero(mask)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (30, 49, 15, 24)
    assert core_of((5.0, 5.0, 5.5, 5.5), 10, 10).sum() == 1


def test_joined_boxes_hold_both():
    both = joined(((0.0, 0.0, 0.0), (2.0, 2.0, 2.0)), ((3.0, 0.0, 0.0), (2.0, 1.0, 4.0)))
    assert both == ((1.5, 0.0, 0.0), (5.0, 2.0, 4.0))


def test_world_without_depth_is_refused_with_what_helps():
    with pytest.raises(KarmaError, match="renderDepthImage"):
        pixels_of(EmbeddedWorld("kitchen_1").last_event)
