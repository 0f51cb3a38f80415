"""Third-party cameras, the map view, and questions about what a picture shows."""

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


def test_map_view_takes_in_the_whole_room(world):
    for width, height in ((300, 300), (600, 300), (200, 500)):
        world.step("ChangeResolution", x=width, y=height)
        view = world.step("GetMapViewCameraProperties").metadata["actionReturn"]
        assert view["rotation"] == {"x": 90.0, "y": 0.0, "z": 0.0}
        assert view["orthographic"] is True
        bounds = world.last_event.metadata["sceneBounds"]
        half_high, half_wide = view["orthographicSize"], view["orthographicSize"] * width / height
        for corner in bounds["cornerPoints"]:
            assert abs(corner[0] - view["position"]["x"]) <= half_wide + 1e-9
            assert abs(corner[2] - view["position"]["z"]) <= half_high + 1e-9
            assert corner[1] <= view["position"]["y"] + 1e-9
        assert world.step("AddThirdPartyCamera", **view, skyboxColor="white")
    assert all(one.orthographic for one in world.state.cameras)


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
    for action in ("GetCoordinateFromRaycast", "GetObjectInFrame", "OpenObject", "PickupObject"):
        event = world.step(action, x=x, y=y)
        assert not event
        assert "must be in [0:1]" in event.message


def test_object_in_frame_is_the_first_in_the_way(world):
    stand(world, rotation=270, horizon=0)
    fridge = find(world, "Fridge")
    assert world.step("GetObjectInFrame", x=0.5, y=0.5).metadata["actionReturn"] == fridge
    seen = world.step("GetObjectInFrame", x=0.5, y=0.5, checkVisible=True)
    assert seen.metadata["actionReturn"] == fridge
    stand(world, rotation=180, horizon=0)
    assert not world.step("GetObjectInFrame", x=0.5, y=0.5)


def test_object_in_frame_out_of_reach_is_not_visible(world):
    stand(world, x=1.0, rotation=270, horizon=0)
    fridge = find(world, "Fridge")
    assert world.step("GetObjectInFrame", x=0.5, y=0.5).metadata["actionReturn"] == fridge
    assert not world.step("GetObjectInFrame", x=0.5, y=0.5, checkVisible=True)


def test_object_opened_by_where_it_is_in_the_picture(world):
    reach(world, "Fridge")
    stand(world, x=-0.75, rotation=270, horizon=0)
    assert world.step("OpenObject", x=0.5, y=0.5)
    assert world.last_event.get_object(find(world, "Fridge"))["isOpen"]


def test_visible_objects_are_those_of_the_metadata(world):
    reach(world, "Apple")
    seen = world.step("GetVisibleObjects").metadata["actionReturn"]
    listed = world.last_event.metadata["objects"]
    assert seen == [thing["objectId"] for thing in listed if thing["visible"]]
    assert set(seen) < set(world.step("GetVisibleObjects", maxDistance=4.0).value)
    assert world.step("GetVisibleObjects", maxDistance=0.0).value == [find(world, "Floor")]


def test_visible_objects_of_another_camera(world):
    table = find(world, "DiningTable")
    stand(world, rotation=270, horizon=0)
    assert table not in world.step("GetVisibleObjects").value
    world.step(
        "AddThirdPartyCamera", position={"x": 1, "y": 1.6, "z": -0.4}, rotation={"x": 40, "y": 90}
    )
    assert table in world.step("GetVisibleObjects", thirdPartyCameraIndex=0).value
    assert not world.step("GetVisibleObjects", thirdPartyCameraIndex=1)
    assert not world.step("GetVisibleObjects", visibilityScheme="Sonar")
    world.step("UpdateThirdPartyCamera", orthographic=True)
    assert "orthographic" in world.step("GetVisibleObjects", thirdPartyCameraIndex=0).message


def test_held_thing_is_in_another_camera_s_view_only_when_it_is(world):
    apple = reach(world, "Apple")
    world.step("PickupObject", objectId=apple)
    x, y, z = world.state.objects[apple].center
    spot = {"x": x, "y": y, "z": z - 0.5}
    world.step("AddThirdPartyCamera", position=spot, rotation={"y": 0})
    assert apple in world.step("GetVisibleObjects", thirdPartyCameraIndex=0).value
    world.step("UpdateThirdPartyCamera", rotation={"y": 180})
    assert apple not in world.step("GetVisibleObjects", thirdPartyCameraIndex=0).value


def test_questions_change_nothing_and_share_the_objects(world):
    before = world.step("RotateRight")
    for action, arguments in (
        ("GetVisibleObjects", {}),
        ("GetCoordinateFromRaycast", {"x": 0.5, "y": 0.5}),
        ("GetMapViewCameraProperties", {}),
        ("GetReachablePositions", {"gridSize": 0.1}),
        ("GetReachablePositions", {"directionsRelativeAgent": True}),
    ):
        event = world.step(action, **arguments)
        assert event
        assert event.state is before.state
        assert event.metadata["objects"] is before.metadata["objects"]
