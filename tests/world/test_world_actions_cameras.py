"""Third-party cameras, and questions about what a picture shows."""

import pytest
from support.household import find, kitchen, reach

from karma.world.sim import EmbeddedWorld

SPOT = {"x": 1.2, "y": 2.3, "z": 3.4}
TURN = {"x": 30.0, "y": 40.0, "z": 50.0}


@pytest.fixture
def world():
    return EmbeddedWorld(kitchen())


def cameras(world):
    return world.last_event.metadata["thirdPartyCameras"]


def stand(world, **pose):
    usual = {"x": 0.0, "y": 0.9, "z": 0.0, "rotation": 90, "horizon": 30, "standing": True}
    assert world.step("TeleportFull", **{**usual, **pose})


# ----------------------------------------------------------------- cameras


def test_added_camera_has_the_planes_of_the_agent_s(world):
    world.step("Initialize", cameraNearPlane=0.2, cameraFarPlane=7)
    world.step("AddThirdPartyCamera", position=SPOT, rotation=TURN)
    assert (world.state.cameras[0].near_m, world.state.cameras[0].far_m) == (0.2, 7.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"fieldOfView": 0}, "fieldOfView: 0"),
        ({"fieldOfView": 180}, "fieldOfView: 180"),
        ({"fieldOfView": -1}, "fieldOfView: -1"),
        ({"skyboxColor": "sort of blue"}, "Invalid skyboxColor"),
        ({"orthographic": True, "orthographicSize": 0}, "orthographicSize"),
        ({"nearClippingPlane": 0}, "nearClippingPlane"),
        ({"nearClippingPlane": 3, "farClippingPlane": 2}, "nearClippingPlane"),
    ],
)
def test_camera_that_cannot_be_is_refused_and_changes_nothing(world, given, message):
    world.step("AddThirdPartyCamera", position=SPOT, rotation=TURN)
    before = world.state
    assert message in world.step("UpdateThirdPartyCamera", **given).message
    event = world.step("AddThirdPartyCamera", position=SPOT, rotation=TURN, **given)
    assert message in event.message
    assert world.state is before


def test_camera_that_is_not_there_cannot_be_updated(world):
    assert "thirdPartyCameraId: 0" in world.step("UpdateThirdPartyCamera", fieldOfView=40).message


def test_sky_is_named_or_in_hexadecimal(world):
    for sky in ("white", "Black", "#fff", "#80ff00", "#80ff00aa"):
        assert world.step("AddThirdPartyCamera", position=SPOT, rotation=TURN, skyboxColor=sky)
    assert [one.sky for one in world.state.cameras][:2] == ["white", "Black"]
    world.step("UpdateThirdPartyCamera", skyboxColor="default")
    assert world.state.cameras[0].sky == ""


# ----------------------------------------------------------------- what a picture shows


def test_coordinate_in_the_middle_lies_straight_ahead(world):
    stand(world, rotation=0, horizon=0)
    point = world.step("GetCoordinateFromRaycast", x=0.5, y=0.5).metadata["actionReturn"]
    assert point == pytest.approx({"x": 0.0, "y": 1.575, "z": 1.675}, abs=1e-3)  # the window


def test_coordinate_on_the_floor_has_the_floor_s_height(world):
    stand(world, rotation=180, horizon=60)
    point = world.step("GetCoordinateFromRaycast", x=0.5, y=0.5).metadata["actionReturn"]
    assert point["y"] == pytest.approx(0.0, abs=1e-6)
    assert point["x"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("x", "y"), [(1.5, 0.5), (1.1, 0.3), (-0.1, 0.8), (0.5, -0.3)])
def test_place_outside_the_picture_is_refused(world, x, y):
    for action in ("GetCoordinateFromRaycast", "OpenObject", "PickupObject"):
        event = world.step(action, x=x, y=y)
        assert not event
        assert "must be in [0:1]" in event.message


def test_object_opened_by_where_it_is_in_the_picture(world):
    reach(world, "Fridge")
    stand(world, x=-0.75, rotation=270, horizon=0)
    assert world.step("OpenObject", x=0.5, y=0.5)
    assert world.last_event.get_object(find(world, "Fridge"))["isOpen"]
