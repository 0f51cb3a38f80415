"""Third-party cameras, and questions about what a picture shows."""

import pytest
from support.household import kitchen

from karma.world.sim import EmbeddedWorld

SPOT = {"x": 1.2, "y": 2.3, "z": 3.4}
TURN = {"x": 30.0, "y": 40.0, "z": 50.0}


@pytest.fixture
def world():
    return EmbeddedWorld(kitchen())


def cameras(world):
    return world.last_event.metadata["thirdPartyCameras"]


# ----------------------------------------------------------------- cameras


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


def test_sky_is_named_or_in_hexadecimal(world):
    for sky in ("white", "Black", "#fff", "#80ff00", "#80ff00aa"):
        assert world.step("AddThirdPartyCamera", position=SPOT, rotation=TURN, skyboxColor=sky)
    assert [one.sky for one in world.state.cameras][:2] == ["white", "Black"]
    world.step("UpdateThirdPartyCamera", skyboxColor="default")
    assert world.state.cameras[0].sky == ""
