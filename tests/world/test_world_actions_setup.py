"""Actions that set the world up: Initialize, the picture's size, the filter, seeds, time."""

import math

import pytest
from support.household import find, kitchen, look

from karma.world.sim import EmbeddedWorld


@pytest.fixture
def world():
    return EmbeddedWorld(kitchen())


def test_initialize_sets_what_it_says_and_answers_with_the_planes(world):
    event = world.step(
        "Initialize", gridSize=0.5, visibilityDistance=2.0, fieldOfView=60, rotateStepDegrees=180,
        renderDepthImage=True, renderInstanceSegmentation=True, renderImage=False,
        cameraNearPlane=0.1, cameraFarPlane=9, fastActionEmit=False,
    )  # fmt: skip
    assert event.metadata["actionReturn"] == {"cameraNearPlane": 0.1, "cameraFarPlane": 9.0}
    settings = world.state.settings
    assert (settings.grid_m, settings.visibility_m, settings.fov_deg) == (0.5, 2.0, 60.0)
    assert (settings.rotate_deg, settings.near_m, settings.far_m) == (180.0, 0.1, 9.0)
    assert not settings.fast_emit
    images = settings.images
    assert (images.rgb, images.depth, images.instances, images.classes) == (
        False, True, True, False,
    )  # fmt: skip
    assert event.metadata["fov"] == 60.0
    assert world.step("RotateRight").metadata["agent"]["rotation"]["y"] == 180.0


def test_initialize_without_arguments_returns_to_the_defaults(world):
    before = world.state.settings
    world.step("Initialize", gridSize=0.5, fieldOfView=60, renderDepthImage=True)
    event = world.step("Initialize", madeUp=3)  # unknown arguments are ignored
    assert event.metadata["actionReturn"] == {"cameraNearPlane": 0.01, "cameraFarPlane": 20.0}
    assert world.state.settings == before


def test_initialize_keeps_the_picture_s_size_and_the_household(world):
    world.step("ChangeResolution", x=400, y=200)
    fridge = find(world, "Fridge")
    world.step("OpenObject", objectId=fridge, forceAction=True)
    event = world.step("Initialize")
    assert (event.screen_width, event.screen_height) == (400, 200)
    assert look(world, fridge)["isOpen"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gridSize": -0.25}, "gridSize"),
        ({"gridSize": 5.5}, "gridSize"),
        ({"fieldOfView": 0}, "fov"),
        ({"fieldOfView": 180}, "fov"),
        ({"rotateStepDegrees": 45}, "multiples of 90"),
        ({"rotateStepDegrees": -90, "snapToGrid": False}, "rotateStepDegrees"),
        ({"cameraNearPlane": 30}, "cameraNearPlane"),
        ({"cameraFarPlane": -1}, "cameraNearPlane"),
        ({"agentMode": "arm"}, "agentMode arm is not part of the embedded world"),
        ({"agentMode": "drone"}, "agentMode drone"),
        ({"agentMode": "stretch"}, "agentMode stretch"),
        ({"agentMode": "octopus"}, "unsupported agentMode octopus"),
        ({"agentCount": 2}, "agentCount 2"),
    ],
)
def test_initialize_refuses_what_the_world_cannot_be(world, arguments, message):
    before = world.state
    event = world.step("Initialize", **arguments)
    assert message in event.message
    assert world.state is before


def test_resolution_changes_and_impossible_sizes_are_refused(world):
    event = world.step("ChangeResolution", x=400, y=300)
    assert (event.metadata["screenWidth"], event.metadata["screenHeight"]) == (400, 300)
    for x, y in ((0, 300), (300, -1), (100_000, 300)):
        assert "must be in [1," in world.step("ChangeResolution", x=x, y=y).message
    assert world.last_event.metadata["screenWidth"] == 400


def test_wider_picture_shows_more(world):
    world.step("TeleportFull", x=0.0, y=0.9, z=0.0, rotation=0, horizon=30, standing=True)
    few = world.state.sight.visible
    world.step("ChangeResolution", x=900, y=300)
    assert few < world.state.sight.visible


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"width": 0}, "1, 8192"),
        ({"height": 0}, "1, 8192"),
        ({"gridSize": -1.0}, "gridSize"),
        ({"gridSize": math.nan}, "gridSize"),
        ({"fieldOfView": 0.0}, "fov"),
        ({"fieldOfView": math.nan}, "fov"),
        ({"rotateStepDegrees": 45.0}, "multiples of 90"),
    ],
)
def test_world_is_not_made_with_what_initialize_refuses(how, said):
    with pytest.raises(ValueError, match=said):
        EmbeddedWorld(kitchen(), **how)
