"""What AI2-THOR's own suite checks of a simulator, told anew for our rooms, on both fronts.

Covered: the 53 behaviours that need no mesh physics, arm, drone or second agent; each test has the
name of AI2-THOR's. `embedded` is the world in process, `player` the genuine client over it.
Materials are not ours to randomise: those two behaviours are a refusal by name.
"""

import contextlib
import copy
import itertools
import json
import random
import string
import warnings

import numpy as np
import pytest
from support.fronts import FRONTS, choose, open_fronts
from support.household import kitchen
from test_world_contract import AGENT_FIELDS, EVENT_FIELDS, OBJECT_FIELDS, assert_form


@pytest.fixture(scope="module")
def fronts(tmp_path_factory):
    with contextlib.ExitStack() as stack:
        yield open_fronts(stack, tmp_path_factory.mktemp("behaviour"))


@pytest.fixture(params=FRONTS)
def front(fronts, request):
    """A front in the handmade kitchen, at its start."""
    one = choose(fronts, request.param)
    one.reset()
    return one


def meta(front, *keys):
    """A value deep in the last event's metadata."""
    value = front.last_event.metadata
    for key in keys:
        value = value[key]
    return value


def place(front):
    return dict(meta(front, "agent", "position"))


def pose(front):
    agent = meta(front, "agent")
    return json.dumps([agent["position"], agent["rotation"], agent["cameraHorizon"]])


def first(front, kind):
    return front.last_event.objects_by_type(kind)[0]["objectId"]


def look(front, object_id):
    return front.last_event.get_object(object_id)


def reach(front, object_id):
    """Stand where an object can be handled, asking the world itself where that is."""
    poses = front.step("GetInteractablePoses", objectId=object_id, maxPoses=1)
    assert front.step("TeleportFull", **poses.metadata["actionReturn"][0])


def world_of(front):
    """Everything but what the last action said of itself, as text."""
    said = ("lastAction", "error", "action")
    rest = {k: v for k, v in front.last_event.metadata.items() if not k.startswith(said)}
    return json.dumps(rest, sort_keys=True)


def assert_misuse(front, action, code, *words):
    """The action raises ValueError, says the words, and reports itself."""
    action = dict(action)
    with pytest.raises(ValueError) as raised:
        front.step(action.pop("action"), **action)
    assert not meta(front, "lastActionSuccess")
    assert meta(front, "errorCode") == code
    assert meta(front, "errorMessage") == str(raised.value)
    assert all(word in str(raised.value) for word in words)


def assert_near(one, other, most):
    """Two pictures differ by at most so much per value, on average."""
    assert one.shape == other.shape
    assert np.abs(one.astype(float) - other.astype(float)).mean() <= most


# ----------------------------------------------------------------- walking, turning, looking


def assert_steps(front, action, axis, metres, **arguments):
    before = place(front)
    assert front.step(action, **arguments)
    by = {**dict.fromkeys("xyz", 0.0), axis: metres}
    assert place(front) == {key: pytest.approx(before[key] + by[key], abs=1e-4) for key in "xyz"}
    assert meta(front, "lastAction") == action


@pytest.mark.parametrize(
    ("action", "axis", "metres", "arguments"),
    [
        pytest.param("MoveAhead", "z", 0.25, {}, id="moveahead"),
        pytest.param("MoveBack", "z", -0.25, {}, id="moveback"),
        pytest.param("MoveLeft", "x", -0.25, {}, id="moveleft"),
        pytest.param("MoveRight", "x", 0.25, {}, id="moveright"),
        pytest.param("MoveBack", "z", -0.75, {"moveMagnitude": 0.75}, id="moveahead_mag"),
    ],
)
def test_move(front, action, axis, metres, arguments):
    assert_steps(front, action, axis, metres, **arguments)
    assert meta(front, "agent", "rotation", "y") == 0.0


def test_moveahead_fail(front):
    before = pose(front)
    event = front.step("MoveAhead", moveMagnitude=5.0)
    assert not event
    assert "is blocking Agent 0 from moving by" in event.metadata["errorMessage"]
    assert pose(front) == before


def test_lookdown(front):
    seen = [meta(front, "agent", "cameraHorizon")]
    for _ in range(2):
        assert front.step("LookDown")
        seen.append(meta(front, "agent", "cameraHorizon"))
    assert seen == pytest.approx([0.0, 30.0, 60.0], abs=1e-3)
    assert not front.step("LookDown")
    assert meta(front, "errorCode") == "LookDownCantExceedMin"
    assert meta(front, "errorMessage").startswith("can't look down beyond 60 degrees")
    assert meta(front, "agent", "cameraHorizon") == seen[-1]


def test_lookup(front):
    assert front.step("LookUp")
    assert meta(front, "agent", "cameraHorizon") == pytest.approx(-30.0, abs=1e-3)
    assert not front.step("LookUp")
    assert meta(front, "errorCode") == "LookDownCantExceedMin"
    assert meta(front, "errorMessage").startswith("can't look up beyond 30 degrees")
    assert front.step("LookDown", degrees=12.5)
    assert meta(front, "agent", "cameraHorizon") == pytest.approx(-17.5, abs=1e-3)


def test_rotate_right(front):
    yaws = [meta(front, "agent", "rotation", "y")]
    for _ in range(4):
        assert front.step("RotateRight")
        yaws.append(meta(front, "agent", "rotation", "y"))
    assert yaws == [0.0, 90.0, 180.0, 270.0, 0.0]
    assert meta(front, "agent", "rotation") == {"x": 0.0, "y": 0.0, "z": 0.0}


def test_rotate_left(front):
    assert front.step("RotateLeft")
    assert meta(front, "agent", "rotation", "y") == 270.0
    assert front.step("RotateLeft", degrees=22.5)
    assert meta(front, "agent", "rotation", "y") == pytest.approx(247.5, abs=1e-3)
    assert front.step("RotateLeft", degrees=247.5)
    assert meta(front, "agent", "rotation", "y") % 360 == pytest.approx(0.0, abs=1e-3)


def test_rotate_look(front):
    assert front.step("RotateLook", rotation=90, horizon=31)
    assert meta(front, "agent", "rotation", "y") == pytest.approx(90.0, abs=1e-3)
    assert meta(front, "agent", "cameraHorizon") == pytest.approx(31.0, abs=1e-3)
    assert front.step("RotateLook", rotation={"x": 0, "y": 33, "z": 0}, horizon=-11)
    assert meta(front, "agent", "rotation", "y") == pytest.approx(33.0, abs=1e-3)
    assert meta(front, "agent", "cameraHorizon") == pytest.approx(-11.0, abs=1e-3)
    assert not front.step("RotateLook", rotation=0, horizon=61)


def test_teleport(front):
    here = place(front)
    full = {"position": here, "rotation": {"x": 0, "y": 90, "z": 0}, "horizon": 30}
    full |= {"standing": True}
    for left_out in full:
        some = {key: value for key, value in full.items() if key != left_out}
        assert_misuse(front, {"action": "TeleportFull", **some}, "MissingArguments")
    assert front.step("TeleportFull", **full)
    assert meta(front, "agent", "rotation", "y") == pytest.approx(90.0)
    assert meta(front, "agent", "cameraHorizon") == pytest.approx(30.0)
    assert front.step("Teleport", position={**here, "x": 0.5})
    assert place(front) == {**here, "x": pytest.approx(0.5)}
    assert meta(front, "agent", "rotation", "y") == pytest.approx(90.0)  # as it was
    assert front.step("Teleport", rotation=180, horizon=0, standing=False)
    assert meta(front, "agent", "isStanding") is False
    assert meta(front, "agent", "rotation", "y") == pytest.approx(180.0)
    before = pose(front)
    for wrong in (
        {"position": {**here, "x": 3000.0}},  # outside of the room
        {"position": {**here, "z": 1.2}},  # in the counter
        {"position": {**here, "y": 5.0}},  # in the air
        {"horizon": 80.0},
    ):
        event = front.step("Teleport", **wrong)
        assert not event
        assert event.metadata["errorMessage"]
        assert pose(front) == before


def test_get_reachable_positions(front):
    event = front.step("GetReachablePositions")
    places = event.metadata["actionReturn"]
    assert len(places) == len(kitchen().reachable)
    assert "reachablePositions" not in event.metadata
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert event.metadata["reachablePositions"] == places
    assert set(places[0]) == set("xyz")
    event = front.step("Pass")
    with pytest.raises(IndexError):
        event.metadata["reachablePositions"]
    assert_misuse(
        front, {"action": "GetReachablePositions", "gridsize": 1}, "InvalidArgument", "gridsize"
    )


def test_get_reachable_positions_with_directions_relative_agent(front):
    ask = {"action": "GetReachablePositions"}
    straight = front.step(ask).metadata["actionReturn"]
    assert front.step("TeleportFull", position=place(front), rotation=49.1, horizon=0,
                      standing=True)  # fmt: skip
    aligned = front.step(ask).metadata["actionReturn"]
    assert sorted(map(str, aligned)) == sorted(map(str, straight))
    turned = front.step(ask, directionsRelativeAgent=True).metadata["actionReturn"]
    assert len(turned) > 10
    assert {(p["x"], p["z"]) for p in turned} != {(p["x"], p["z"]) for p in straight}


def test_get_interactable_poses(front):
    fridge = first(front, "Fridge")

    def poses(**asked):
        event = front.step("GetInteractablePoses", objectId=fridge, **asked)
        assert event, event.metadata["errorMessage"]
        return event.metadata["actionReturn"]

    everything = poses()
    assert len(everything) > 10
    assert {tuple(sorted(one)) for one in everything} == {
        ("horizon", "rotation", "standing", "x", "y", "z")
    }
    for one in everything[:: len(everything) // 10]:
        assert front.step("TeleportFull", **one)
        assert look(front, fridge)["visible"]
    assert {one["standing"] for one in everything} == {True, False}
    assert all(one["standing"] for one in poses(standings=[True]))
    assert {one["horizon"] for one in poses(horizons=[0, 30])} <= {0.0, 30.0}
    assert {one["rotation"] for one in poses(rotations=[270])} == {270.0}
    here = [{"x": -0.5, "y": 0.9, "z": 0.0}, {"x": -1.0, "y": 0.9, "z": 0.0}]
    assert {one["x"] for one in poses(positions=here)} <= {-0.5, -1.0}
    assert len(poses(maxPoses=7)) == 7
    assert len(poses(maxDistance=1.0)) < len(everything)
    assert not front.step("GetInteractablePoses", objectId="Sofa|+00.00|+00.00|+00.00")
    for few in (0, -1):
        assert not front.step("GetInteractablePoses", objectId=fridge, maxPoses=few)


# ----------------------------------------------------------------- the client's ways


@pytest.mark.parametrize(
    ("width", "height"), [(600, 300), (128, 64)], ids=["rectangle_aspect", "small_aspect"]
)
def test_aspect(front, width, height):
    event = front.reset(width=width, height=height)
    assert event.frame.shape == (height, width, 3)
    assert (event.screen_width, event.screen_height) == (width, height)
    assert event.frame.dtype == np.uint8


def test_bot_deprecation(front):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        event = front.reset(agentMode="bot")
    assert event
    if front.name == "player":  # it is the client that renames and warns
        assert front.controller.initialization_parameters["agentMode"] == "locobot"
        assert any("locobot" in str(one.message) for one in said)


def test_deprecated_segmentation_params(front):
    event = front.reset(renderObjectImage=True, renderClassImage=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert event.class_segmentation_frame is event.semantic_segmentation_frame
    assert event.semantic_segmentation_frame.shape == (300, 300, 3)
    assert event.instance_segmentation_frame.shape == (300, 300, 3)


def test_deprecated_segmentation_params2(front):
    old = front.reset(renderObjectImage=True, renderClassImage=True)
    new = front.reset(renderInstanceSegmentation=True, renderSemanticSegmentation=True)
    for name in ("instance_segmentation_frame", "semantic_segmentation_frame"):
        assert np.array_equal(getattr(new, name), getattr(old, name))
    assert front.reset().instance_segmentation_frame is None


def test_reset(front):
    event = front.reset(width=111, height=111, renderDepthImage=True)
    assert event.frame.shape == (111, 111, 3)
    assert event.depth_frame.shape == (111, 111)
    assert front.step("MoveAhead")
    event = front.reset("kitchen_1", renderDepthImage=False)
    assert event.frame.shape == (300, 300, 3)
    assert event.depth_frame is None
    assert event.metadata["sceneName"] == "kitchen_1"
    assert front.reset(gridSize=0.5).metadata["sceneName"] == "handmade"
    assert place(front) == {"x": 0.0, "y": 0.9, "z": 0.0}
    assert_steps(front, "MoveAhead", "z", 0.5)


def test_get_scenes_in_build(front):
    event = front.step("GetScenesInBuild")
    assert event
    names = event.metadata["actionReturn"]
    assert len(names) == len(set(names))
    assert {f"{room}_{n}" for room in ("kitchen", "living", "bedroom", "bathroom")
            for n in range(1, 5)} <= set(names)  # fmt: skip


def test_no_leak_params(front):
    action = {"action": "RotateLook", "rotation": 0, "horizon": 0}
    before = copy.deepcopy(action)
    assert front.step(action)
    assert action == before
    assert front.step(action, horizon=30)
    assert action == before


def test_fast_emit(front):
    letters = "".join(random.Random(7).choices(string.ascii_letters, k=40))
    before = front.step("RotateRight")
    event = front.step("TestFastEmit", rvalue=letters)
    assert event
    assert event.metadata["actionReturn"] == letters
    assert event.metadata["lastAction"] == "TestFastEmit"
    assert event.metadata["objects"] is before.metadata["objects"]
    assert np.array_equal(event.frame, before.frame)


def test_fast_emit_disabled(front):
    front.reset(fastActionEmit=False)
    before = front.step("RotateRight")
    event = front.step("TestFastEmit", rvalue="text")
    assert event.metadata["actionReturn"] == "text"
    assert event.metadata["objects"] == before.metadata["objects"]
    if front.name == "player":  # in process there is nothing to send
        assert event.metadata["objects"] is not before.metadata["objects"]


def test_fifo_large_input(front):
    text = "".join(random.Random(3).choices(string.ascii_letters, k=1 << 20))
    before = front.step("RotateRight")
    event = front.step("TestActionReflectParam", rvalue=text)
    assert event.metadata["actionReturn"] == text
    assert event.metadata["objects"] is not before.metadata["objects"]


def test_action_dispatch_invalid_action(front):
    assert_misuse(front, {"action": "FlyToTheMoon"}, "InvalidAction", "FlyToTheMoon")
    assert meta(front, "lastAction") == "FlyToTheMoon"
    assert front.step("Pass")


def test_action_dispatch_missing_args(front):
    missing = {"action": "ThrowObject", "forceAction": True}
    assert_misuse(front, missing, "MissingArguments", "moveMagnitude", "ThrowObject")
    assert_misuse(front, {"action": "AddThirdPartyCamera"}, "MissingArguments", "position")


def test_invalid_arguments(front):
    before = world_of(front)
    put = {"action": "PutObject", "x": 0.0, "y": 0.0, "z": 1.0, "placeStationary": True}
    assert_misuse(front, put, "InvalidArgument", "z")
    assert_misuse(front, {"action": "MoveAhead", "moveMagnitude": "far"}, "InvalidArgument")
    assert world_of(front) == before


def test_target_invocation_exception(front):
    event = front.step("OpenObject", x=1.5, y=0.5)
    assert not event
    assert event.metadata["errorMessage"].startswith("ArgumentOutOfRangeException: x and y must be")
    assert event.metadata["errorCode"] == "UnhandledException"


def test_jsonschema_metadata(front):
    for event in (front.step("Pass"), front.step("MoveAhead", moveMagnitude=9.0)):
        assert_form(event.metadata, EVENT_FIELDS)
        assert_form(event.metadata["agent"], AGENT_FIELDS)
        assert event.metadata["objects"]
        for thing in event.metadata["objects"]:
            assert_form(thing, OBJECT_FIELDS)
            assert_form(thing["position"], dict.fromkeys("xyz", float))
    json.dumps(event.metadata)


def test_set_random_seed(front):
    def layout(seed):
        front.reset()
        assert front.step("SetRandomSeed", seed=seed)
        assert front.step("InitialRandomSpawn", placeStationary=True)
        objects = meta(front, "objects")
        return {thing["objectId"]: str(thing["position"]) for thing in objects}

    a, b, again = layout(41), layout(42), layout(41)
    assert a == again
    assert a != b
    assert set(a) == set(b)


# ----------------------------------------------------------------- pictures and cameras

KINDS = {
    "renderDepthImage": ("depth_frame", "third_party_depth_frames"),
    "renderInstanceSegmentation": (
        "instance_segmentation_frame",
        "third_party_instance_segmentation_frames",
    ),
    "renderSemanticSegmentation": (
        "semantic_segmentation_frame",
        "third_party_semantic_segmentation_frames",
    ),
    "renderNormalsImage": ("normals_frame", "third_party_normals_frames"),
}
CAMERA = {
    "position": {"x": -1.0, "y": 1.9, "z": -1.0},
    "rotation": {"x": 30.0, "y": 45.0, "z": 0.0},
}


def test_per_step_instance_segmentation(front):
    assert front.step("RotateLeft").instance_segmentation_frame is None
    event = front.step("RotateRight", renderInstanceSegmentation=True)
    assert event.instance_segmentation_frame.shape == (300, 300, 3)
    assert len(event.instance_masks) > 3
    assert front.step("Pass").frame is not None


def test_change_resolution(front):
    assert front.last_event.frame.shape == (300, 300, 3)
    event = front.step("ChangeResolution", x=400, y=320, raise_for_failure=True)
    assert event.frame.shape == (320, 400, 3)
    assert (event.screen_width, event.screen_height) == (400, 320)
    assert (meta(front, "screenWidth"), meta(front, "screenHeight")) == (400, 320)
    assert front.step("MoveAhead").frame.shape == (320, 400, 3)


def test_change_resolution_image_synthesis(front):
    front.reset(**dict.fromkeys(KINDS, True))
    assert front.step("AddThirdPartyCamera", **CAMERA)
    start = front.step("Pass")
    changed = front.step("ChangeResolution", x=200, y=150)
    back = front.step("ChangeResolution", x=300, y=300)
    names = [("frame", "third_party_camera_frames"), *KINDS.values()]
    for one, several in names:
        for event, size in ((start, (300, 300)), (changed, (150, 200)), (back, (300, 300))):
            pictures = [getattr(event, one), *getattr(event, several)]
            assert [picture.shape[:2] for picture in pictures] == [size, size], one
        assert np.array_equal(getattr(start, one), getattr(back, one)), one
        assert np.array_equal(getattr(start, several)[0], getattr(back, several)[0]), several
    assert set(start.instance_masks) == set(back.instance_masks)


def test_segmentation_colors(front):
    event = front.reset(renderSemanticSegmentation=True, renderInstanceSegmentation=True)
    fridge = first(front, "Fridge")
    for name in ("Fridge", fridge):
        assert event.color_to_object_id[event.object_id_to_color[name]] == name
    colours = event.object_id_to_color.values()
    assert len(set(colours)) == len(colours)
    reach(front, fridge)
    event = front.step("Pass")
    shown = event.instance_masks[fridge]
    assert np.all(event.instance_segmentation_frame[shown] == event.object_id_to_color[fridge])
    shown = event.class_masks["Fridge"]
    assert np.all(event.semantic_segmentation_frame[shown] == event.object_id_to_color["Fridge"])
    x0, y0, x1, y1 = event.instance_detections2D[fridge]
    rows, columns = np.nonzero(event.instance_masks[fridge])
    assert (x0, y0, x1, y1) == (columns.min(), rows.min(), columns.max(), rows.max())


def test_add_third_party_camera(front):
    assert meta(front, "thirdPartyCameras") == []
    event = front.step("AddThirdPartyCamera", **CAMERA, fieldOfView=45.0)
    assert event
    assert meta(front, "thirdPartyCameras", 0, "fieldOfView") == pytest.approx(45.0)
    assert event.third_party_camera_frames[0].shape == (300, 300, 3)
    assert front.step("AddThirdPartyCamera", **CAMERA)
    assert len(front.last_event.third_party_camera_frames) == 2
    assert meta(front, "thirdPartyCameras", 1, "fieldOfView") == 90.0
    for number, camera in enumerate(meta(front, "thirdPartyCameras")):
        assert camera["thirdPartyCameraId"] == number
        for key, given in CAMERA.items():
            assert camera[key] == pytest.approx(given, abs=1e-3)
    for fov in (0.0, 180.0, -1.0):
        assert not front.step("AddThirdPartyCamera", **CAMERA, fieldOfView=fov)
        assert "180" in meta(front, "errorMessage")
    assert len(meta(front, "thirdPartyCameras")) == 2
    event = front.step("Pass", renderImage=False)
    assert event.metadata["thirdPartyCameras"] is None
    front.reset()
    assert meta(front, "thirdPartyCameras") == []


def test_update_third_party_camera(front):
    front.step("AddThirdPartyCamera", **CAMERA, fieldOfView=60.0)
    start = front.last_event.third_party_camera_frames[0].copy()
    wanted = {key: dict(value) for key, value in CAMERA.items()} | {"fieldOfView": 60.0}

    def assert_is(**changes):
        assert front.step("UpdateThirdPartyCamera", thirdPartyCameraId=0, **changes)
        for key, change in changes.items():
            wanted[key] = {**wanted[key], **change} if isinstance(change, dict) else change
        camera = meta(front, "thirdPartyCameras", 0)
        for key, value in wanted.items():
            assert camera[key] == pytest.approx(value, abs=1e-3), key

    assert_is(position={"x": -0.5, "y": 1.5, "z": -0.75})
    assert_is(position={"y": 1.8})
    assert_is(rotation={"x": 10.0, "y": 90.0, "z": 0.0})
    assert_is(rotation={"y": 20.0})
    assert_is(fieldOfView=80.0)
    assert not np.array_equal(front.last_event.third_party_camera_frames[0], start)
    for fov in (-1.0, 181.0):
        update = {"thirdPartyCameraId": 0, "fieldOfView": fov}
        assert not front.step("UpdateThirdPartyCamera", **update)
    assert meta(front, "thirdPartyCameras", 0, "fieldOfView") == pytest.approx(80.0)
    assert not front.step("UpdateThirdPartyCamera", thirdPartyCameraId=3, position={"x": 0.0})


def test_third_party_camera_with_image_synthesis(front):
    front.reset(**dict.fromkeys(KINDS, True))
    event = front.step("AddThirdPartyCamera", **CAMERA)
    for _, several in KINDS.values():
        assert len(getattr(event, several)) == 1, several
        assert getattr(event, several)[0].shape[:2] == (300, 300)
    assert event.third_party_depth_frames[0].dtype == np.float32
    assert len(event.third_party_instance_masks[0]) > 3
    assert "Fridge" in event.third_party_class_masks[0]


def test_third_party_camera_depth(front):
    front.reset(renderDepthImage=True)
    assert front.step("RotateRight")
    event = front.step(
        "AddThirdPartyCamera",
        position=meta(front, "cameraPosition"),
        rotation={"x": 0.0, "y": 90.0, "z": 0.0},
        fieldOfView=meta(front, "fov"),
    )
    own, other = event.depth_frame, event.third_party_depth_frames[0]
    assert own.dtype == other.dtype == np.float32
    assert np.mean((own - other) ** 2) < 1e-4
    assert 0.2 < np.median(own) < 4.0
    assert_near(event.frame, event.third_party_camera_frames[0], 1.0)


def test_get_coordinate_from_raycast(front):
    front.reset(renderDepthImage=True)
    eye = meta(front, "cameraPosition")
    for x, y in itertools.product((0.25, 0.5, 0.75), (0.3, 0.5, 0.8)):
        event = front.step("GetCoordinateFromRaycast", x=x, y=y)
        assert event
        point = event.metadata["actionReturn"]
        assert set(point) == set("xyz")
        away = point["z"] - eye["z"]  # the agent faces +z
        assert away > 0
        assert point["x"] - eye["x"] == pytest.approx((2 * x - 1) * away, abs=0.02)
        assert point["y"] - eye["y"] == pytest.approx((1 - 2 * y) * away, abs=0.02)
    down = front.step("GetCoordinateFromRaycast", x=0.5, y=0.95).metadata["actionReturn"]
    assert down["y"] < eye["y"]
    for wrong in ({"x": 1.5, "y": 0.5}, {"x": 0.5, "y": -0.1}):
        event = front.step("GetCoordinateFromRaycast", **wrong)
        assert not event
        assert event.metadata["errorMessage"].startswith("ArgumentOutOfRangeException: x and y")


# ----------------------------------------------------------------- what metadata lists


def test_simobj_filter(front):
    everything = sorted(thing["objectId"] for thing in meta(front, "objects"))
    three = everything[:3]
    for wanted in (three, three[:1], []):
        assert front.step("SetObjectFilter", objectIds=wanted)
        assert sorted(thing["objectId"] for thing in meta(front, "objects")) == wanted
        assert front.step("Pass")
        assert sorted(thing["objectId"] for thing in meta(front, "objects")) == wanted
    assert front.step("ResetObjectFilter")
    assert sorted(thing["objectId"] for thing in meta(front, "objects")) == everything


def test_open(front):
    fridge = first(front, "Fridge")
    reach(front, fridge)
    for openness in (1.0, 0.5, 0.25):
        assert front.step("OpenObject", objectId=fridge, openness=openness)
        assert look(front, fridge)["openness"] == pytest.approx(openness, abs=1e-3)
        assert look(front, fridge)["isOpen"] is True
    assert front.step("CloseObject", objectId=fridge)
    assert look(front, fridge)["openness"] == pytest.approx(0.0, abs=1e-3)
    assert look(front, fridge)["isOpen"] is False
    for wrong in (-0.5, 1.5):
        assert not front.step("OpenObject", objectId=fridge, openness=wrong)
    assert look(front, fridge)["isOpen"] is False


def test_open_aabb_cache(front):
    fridge = first(front, "Fridge")
    closed = copy.deepcopy(look(front, fridge)["axisAlignedBoundingBox"])
    assert front.step("OpenObject", objectId=fridge, forceAction=True, openness=1.0)
    opened = look(front, fridge)["axisAlignedBoundingBox"]
    assert opened["size"] != closed["size"]
    assert len(opened["cornerPoints"]) == 8
    assert front.step("CloseObject", objectId=fridge, forceAction=True)
    assert look(front, fridge)["axisAlignedBoundingBox"] == closed


def test_open_interactable(front):
    fridge = first(front, "Fridge")
    event = front.step("OpenObject", objectId=fridge)  # the agent looks the other way
    assert not look(front, fridge)["isInteractable"]
    assert not event
    assert "not found within the specified visibility" in event.metadata["errorMessage"]
    reach(front, fridge)
    assert look(front, fridge)["isInteractable"]
    assert front.step("OpenObject", objectId=fridge)
    assert look(front, fridge)["isOpen"]


def test_open_interactable_with_filter(front):
    fridge = first(front, "Fridge")
    reach(front, fridge)
    assert front.step("SetObjectFilter", objectIds=[])
    assert meta(front, "objects") == []
    assert front.step("OpenObject", objectId=fridge)
    assert meta(front, "objects") == []
    assert front.step("ResetObjectFilter", renderImage=False)
    assert look(front, fridge)["isOpen"]


# ----------------------------------------------------------------- handling things


def test_toggle_stove(front):
    knob = first(front, "StoveKnob")
    (burner,) = look(front, knob)["controlledObjects"]
    assert look(front, burner)["objectType"] == "StoveBurner"
    assert not front.step("ToggleObjectOn", objectId=burner, forceAction=True)
    reach(front, knob)
    assert front.step("ToggleObjectOn", objectId=knob)
    assert look(front, knob)["isToggled"]
    assert look(front, burner)["isToggled"]
    assert not front.step("ToggleObjectOn", objectId=knob)
    assert not front.step("ToggleObjectOff", objectId=burner, forceAction=True)
    assert look(front, burner)["isToggled"]
    assert front.step("ToggleObjectOff", objectId=knob)
    assert not look(front, knob)["isToggled"]
    assert not look(front, burner)["isToggled"]


def pick_up(front, kind):
    thing = first(front, kind)
    reach(front, thing)
    event = front.step("PickupObject", objectId=thing)
    assert event, event.metadata["errorMessage"]
    assert event.metadata["inventoryObjects"] == [{"objectId": thing, "objectType": kind}]
    return thing


@pytest.mark.parametrize("action", ["DropHeldObject", "DropHandObject"])
def test_drop_object(front, action):
    apple = pick_up(front, "Apple")
    high = look(front, apple)["position"]["y"]
    event = front.step(action)
    assert event
    assert event.metadata["inventoryObjects"] == []
    assert not look(front, apple)["isPickedUp"]
    assert look(front, apple)["position"]["y"] < high
    assert event.metadata["actionReturn"] == look(front, apple)["position"]
    assert not front.step(action)


def test_move_hand(front):
    apple = pick_up(front, "Apple")
    assert front.step("TeleportFull", position={"x": 0.0, "y": 0.9, "z": -0.25}, rotation=0,
                      horizon=0, standing=True)  # fmt: skip

    def hand():
        pose = meta(front, "heldObjectPose")
        return np.array(
            [[pose[key][axis] for axis in "xyz"] for key in ("localPosition", "position")]
        )

    start = hand()
    assert start[0] == pytest.approx([0.0, -0.16, 0.38], abs=1e-3)
    for word, by in (("right", (1, 0, 0)), ("up", (0, 1, 0)), ("ahead", (0, 0, 1))):
        for sign in (0.1, -0.1):
            before = hand()
            assert front.step("MoveHeldObject", **{word: sign}), meta(front, "errorMessage")
            assert hand() - before == pytest.approx(np.array([by, by]) * sign, abs=1e-3)
        assert hand() == pytest.approx(start, abs=1e-3)
    for name, back in (("Ahead", "Back"), ("Up", "Down"), ("Left", "Right")):
        assert front.step(f"MoveHeldObject{name}", moveMagnitude=0.1)
        assert np.abs(hand() - start).max() == pytest.approx(0.1, abs=1e-3)
        assert front.step(f"MoveHeldObject{back}", moveMagnitude=0.1)
        assert hand() == pytest.approx(start, abs=1e-3)
    held = [look(front, apple)["position"][axis] for axis in "xyz"]
    assert held == pytest.approx(start[1], abs=0.02)
    assert not front.step("MoveHeldObject", ahead=30.0)
    assert hand() == pytest.approx(start, abs=1e-3)


def test_rotate_hand(front):
    pick_up(front, "Apple")
    for turn in ({"x": 90, "y": 0, "z": 0}, {"x": 0, "y": 90, "z": 0}, {"x": 0, "y": 0, "z": 90}):
        assert front.step("RotateHeldObject", rotation=turn), meta(front, "errorMessage")
        local = meta(front, "heldObjectPose", "localRotation")
        assert {axis: local[axis] % 360 for axis in "xyz"} == pytest.approx(turn, abs=1e-2)
    assert front.step("RotateHeldObject", rotation={"x": 0, "y": 0, "z": 0})
    for word, axis in (("pitch", "x"), ("yaw", "y")):
        assert front.step("RotateHeldObject", **{word: 30})
        assert meta(front, "heldObjectPose", "localRotation", axis) == pytest.approx(30, abs=1e-2)
        assert front.step("RotateHeldObject", **{word: -30})
    local = meta(front, "heldObjectPose", "localRotation")
    assert all(local[axis] % 360 == pytest.approx(0.0, abs=1e-2) for axis in "xyz")


def test_fill_liquid(front):
    mug = pick_up(front, "Mug")
    assert look(front, mug)["canFillWithLiquid"]
    assert not look(front, mug)["isFilledWithLiquid"]
    for liquid in ("water", "coffee", "wine"):
        assert front.step("FillObjectWithLiquid", objectId=mug, fillLiquid=liquid)
        assert look(front, mug)["isFilledWithLiquid"]
        assert look(front, mug)["fillLiquid"] == liquid
        assert front.step("EmptyLiquidFromObject", objectId=mug)
        assert not look(front, mug)["isFilledWithLiquid"]
        assert look(front, mug)["fillLiquid"] is None
    assert not front.step("FillObjectWithLiquid", objectId=mug, fillLiquid="gin")
    assert not look(front, mug)["isFilledWithLiquid"]


# ----------------------------------------------------------------- out of scope, by name


@pytest.mark.parametrize("action", ["RandomizeMaterials", "ResetMaterials"])
@pytest.mark.parametrize(
    "arguments", [{}, {"useTrainMaterials": True}, {"inRoomTypes": ["Kitchen"]}]
)
def test_randomize_materials(front, action, arguments):
    """Two of AI2-THOR's tests: of the parameters, and that a reset clears materials."""
    before, frame = world_of(front), front.last_event.frame.copy()
    event = front.step(action, **arguments)
    assert not event
    assert action in event.metadata["errorMessage"]
    assert world_of(front) == before
    assert np.array_equal(front.reset().frame, frame)
