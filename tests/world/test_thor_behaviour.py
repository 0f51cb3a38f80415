"""What AI2-THOR's own suite checks of a simulator, told anew for our rooms, on both fronts.

Covered: the 53 behaviours that need no mesh physics, arm, drone or second agent; each test names
the one it stands for. `embedded` is the world in process, `player` the genuine client over it.
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

AS_THEY_ARE = [
    "rectangle_aspect", "small_aspect", "bot_deprecation", "deprecated_segmentation_params",
    "deprecated_segmentation_params2", "reset", "third_party_camera_with_image_synthesis",
    "fast_emit", "fast_emit_disabled", "fifo_large_input", "lookdown", "lookup", "rotate_left",
    "rotate_right", "rotate_look", "no_leak_params", "target_invocation_exception", "simobj_filter",
    "add_third_party_camera", "update_third_party_camera", "open_aabb_cache", "open",
    "action_dispatch_invalid_action", "moveahead", "moveback", "moveleft", "moveright",
    "moveahead_mag", "moveahead_fail", "jsonschema_metadata", "get_scenes_in_build",
    "get_reachable_positions", "per_step_instance_segmentation", "change_resolution",
    "change_resolution_image_synthesis", "segmentation_colors", "invalid_arguments",
]  # fmt: skip
WITH_OUR_ROOMS = [
    "third_party_camera_depth", "toggle_stove", "open_interactable",
    "open_interactable_with_filter", "action_dispatch_missing_args", "teleport",
    "get_interactable_poses", "get_coordinate_from_raycast",
    "get_reachable_positions_with_directions_relative_agent", "set_random_seed",
    "randomize_materials_clearOnReset", "randomize_materials_params", "drop_object", "move_hand",
    "rotate_hand", "fill_liquid",
]  # fmt: skip
TOLD = {}


def behaviour(name):
    """Say which behaviour a test stands for."""

    def tell(test):
        assert name not in TOLD
        TOLD[name] = test
        return test

    return tell


def test_every_portable_behaviour_is_told():
    assert (len(AS_THEY_ARE), len(WITH_OUR_ROOMS)) == (37, 16)
    assert sorted(TOLD) == sorted(AS_THEY_ARE + WITH_OUR_ROOMS)
    assert len({test.__name__ for test in TOLD.values()}) == 53
    assert all(globals()[test.__name__] is test for test in TOLD.values())


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


@behaviour("moveahead")
def test_move_ahead_goes_one_grid_step_along_the_yaw(front):
    assert_steps(front, "MoveAhead", "z", 0.25)


@behaviour("moveback")
def test_move_back_goes_one_grid_step_against_the_yaw(front):
    assert_steps(front, "MoveBack", "z", -0.25)


@behaviour("moveleft")
def test_move_left_goes_one_grid_step_aside_without_turning(front):
    assert_steps(front, "MoveLeft", "x", -0.25)
    assert meta(front, "agent", "rotation", "y") == 0.0


@behaviour("moveright")
def test_move_right_goes_one_grid_step_aside_without_turning(front):
    assert_steps(front, "MoveRight", "x", 0.25)
    assert meta(front, "agent", "rotation", "y") == 0.0


@behaviour("moveahead_mag")
def test_move_goes_as_far_as_its_magnitude_says(front):
    assert_steps(front, "MoveBack", "z", -0.75, moveMagnitude=0.75)
    assert_steps(front, "MoveAhead", "z", 0.5, moveMagnitude=0.5)


@behaviour("moveahead_fail")
def test_move_into_furniture_is_refused_and_leaves_the_agent(front):
    before = pose(front)
    event = front.step("MoveAhead", moveMagnitude=5.0)
    assert not event
    assert "is blocking Agent 0 from moving by" in event.metadata["errorMessage"]
    assert pose(front) == before


@behaviour("lookdown")
def test_look_down_tilts_by_30_degrees_to_60_at_most(front):
    seen = [meta(front, "agent", "cameraHorizon")]
    for _ in range(2):
        assert front.step("LookDown")
        seen.append(meta(front, "agent", "cameraHorizon"))
    assert seen == pytest.approx([0.0, 30.0, 60.0], abs=1e-3)
    assert not front.step("LookDown")
    assert meta(front, "errorCode") == "LookDownCantExceedMin"
    assert meta(front, "errorMessage").startswith("can't look down beyond 60 degrees")
    assert meta(front, "agent", "cameraHorizon") == seen[-1]


@behaviour("lookup")
def test_look_up_tilts_by_30_degrees_to_minus_30_at_most(front):
    assert front.step("LookUp")
    assert meta(front, "agent", "cameraHorizon") == pytest.approx(-30.0, abs=1e-3)
    assert not front.step("LookUp")
    assert meta(front, "errorCode") == "LookDownCantExceedMin"
    assert meta(front, "errorMessage").startswith("can't look up beyond 30 degrees")
    assert front.step("LookDown", degrees=12.5)
    assert meta(front, "agent", "cameraHorizon") == pytest.approx(-17.5, abs=1e-3)


@behaviour("rotate_right")
def test_rotate_right_turns_clockwise_seen_from_above(front):
    yaws = [meta(front, "agent", "rotation", "y")]
    for _ in range(4):
        assert front.step("RotateRight")
        yaws.append(meta(front, "agent", "rotation", "y"))
    assert yaws == [0.0, 90.0, 180.0, 270.0, 0.0]
    assert meta(front, "agent", "rotation") == {"x": 0.0, "y": 0.0, "z": 0.0}


@behaviour("rotate_left")
def test_rotate_left_turns_the_other_way(front):
    assert front.step("RotateLeft")
    assert meta(front, "agent", "rotation", "y") == 270.0
    assert front.step("RotateLeft", degrees=22.5)
    assert meta(front, "agent", "rotation", "y") == pytest.approx(247.5, abs=1e-3)
    assert front.step("RotateLeft", degrees=247.5)
    assert meta(front, "agent", "rotation", "y") % 360 == pytest.approx(0.0, abs=1e-3)


@behaviour("rotate_look")
def test_rotate_look_sets_yaw_and_horizon_at_once(front):
    assert front.step("RotateLook", rotation=90, horizon=31)
    assert meta(front, "agent", "rotation", "y") == pytest.approx(90.0, abs=1e-3)
    assert meta(front, "agent", "cameraHorizon") == pytest.approx(31.0, abs=1e-3)
    assert front.step("RotateLook", rotation={"x": 0, "y": 33, "z": 0}, horizon=-11)
    assert meta(front, "agent", "rotation", "y") == pytest.approx(33.0, abs=1e-3)
    assert meta(front, "agent", "cameraHorizon") == pytest.approx(-11.0, abs=1e-3)
    assert not front.step("RotateLook", rotation=0, horizon=61)


@behaviour("teleport")
def test_teleport_goes_where_it_is_told_and_full_needs_everything(front):
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


@behaviour("get_reachable_positions")
def test_reachable_positions_are_the_action_return_under_both_names(front):
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


@behaviour("get_reachable_positions_with_directions_relative_agent")
def test_reachable_positions_follow_the_room_or_the_agents_own_axes(front):
    ask = {"action": "GetReachablePositions"}
    straight = front.step(ask).metadata["actionReturn"]
    assert front.step("TeleportFull", position=place(front), rotation=49.1, horizon=0,
                      standing=True)  # fmt: skip
    aligned = front.step(ask).metadata["actionReturn"]
    assert sorted(map(str, aligned)) == sorted(map(str, straight))
    turned = front.step(ask, directionsRelativeAgent=True).metadata["actionReturn"]
    assert len(turned) > 10
    assert {(p["x"], p["z"]) for p in turned} != {(p["x"], p["z"]) for p in straight}


@behaviour("get_interactable_poses")
def test_interactable_poses_lead_to_the_object_and_keep_to_what_is_asked(front):
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


@behaviour("rectangle_aspect")
def test_pictures_are_as_wide_and_high_as_asked_for(front):
    event = front.reset(width=600, height=300)
    assert event.frame.shape == (300, 600, 3)
    assert (event.screen_width, event.screen_height) == (600, 300)
    assert event.frame.dtype == np.uint8


@behaviour("small_aspect")
def test_small_pictures_are_drawn_too(front):
    event = front.reset(width=128, height=64)
    assert event.frame.shape == (64, 128, 3)


@behaviour("bot_deprecation")
def test_agent_mode_bot_is_a_locobot(front):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        event = front.reset(agentMode="bot")
    assert event
    if front.name == "player":  # it is the client that renames and warns
        assert front.controller.initialization_parameters["agentMode"] == "locobot"
        assert any("locobot" in str(one.message) for one in said)


@behaviour("deprecated_segmentation_params")
def test_old_names_of_segmentation_work_at_initialize(front):
    event = front.reset(renderObjectImage=True, renderClassImage=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert event.class_segmentation_frame is event.semantic_segmentation_frame
    assert event.semantic_segmentation_frame.shape == (300, 300, 3)
    assert event.instance_segmentation_frame.shape == (300, 300, 3)


@behaviour("deprecated_segmentation_params2")
def test_new_names_of_segmentation_give_the_same(front):
    old = front.reset(renderObjectImage=True, renderClassImage=True)
    new = front.reset(renderInstanceSegmentation=True, renderSemanticSegmentation=True)
    for name in ("instance_segmentation_frame", "semantic_segmentation_frame"):
        assert np.array_equal(getattr(new, name), getattr(old, name))
    assert front.reset().instance_segmentation_frame is None


@behaviour("reset")
def test_reset_sets_size_pictures_and_scene_anew(front):
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


@behaviour("get_scenes_in_build")
def test_scenes_in_build_are_named(front):
    event = front.step("GetScenesInBuild")
    assert event
    names = event.metadata["actionReturn"]
    assert len(names) == len(set(names))
    assert {f"{room}_{n}" for room in ("kitchen", "living", "bedroom", "bathroom")
            for n in range(1, 5)} <= set(names)  # fmt: skip


@behaviour("no_leak_params")
def test_action_given_as_a_dict_is_left_as_it_was(front):
    action = {"action": "RotateLook", "rotation": 0, "horizon": 0}
    before = copy.deepcopy(action)
    assert front.step(action)
    assert action == before
    assert front.step(action, horizon=30)
    assert action == before


@behaviour("fast_emit")
def test_question_is_answered_over_the_same_objects(front):
    letters = "".join(random.Random(7).choices(string.ascii_letters, k=40))
    before = front.step("RotateRight")
    event = front.step("TestFastEmit", rvalue=letters)
    assert event
    assert event.metadata["actionReturn"] == letters
    assert event.metadata["lastAction"] == "TestFastEmit"
    assert event.metadata["objects"] is before.metadata["objects"]
    assert np.array_equal(event.frame, before.frame)


@behaviour("fast_emit_disabled")
def test_question_without_fast_emit_is_answered_in_full(front):
    front.reset(fastActionEmit=False)
    before = front.step("RotateRight")
    event = front.step("TestFastEmit", rvalue="text")
    assert event.metadata["actionReturn"] == "text"
    assert event.metadata["objects"] == before.metadata["objects"]
    if front.name == "player":  # in process there is nothing to send
        assert event.metadata["objects"] is not before.metadata["objects"]


@behaviour("fifo_large_input")
def test_arguments_larger_than_any_pipe_arrive_whole(front):
    text = "".join(random.Random(3).choices(string.ascii_letters, k=1 << 20))
    before = front.step("RotateRight")
    event = front.step("TestActionReflectParam", rvalue=text)
    assert event.metadata["actionReturn"] == text
    assert event.metadata["objects"] is not before.metadata["objects"]


@behaviour("action_dispatch_invalid_action")
def test_unknown_action_raises_and_is_named(front):
    assert_misuse(front, {"action": "FlyToTheMoon"}, "InvalidAction", "FlyToTheMoon")
    assert meta(front, "lastAction") == "FlyToTheMoon"
    assert front.step("Pass")


@behaviour("action_dispatch_missing_args")
def test_missing_argument_raises_and_is_named(front):
    missing = {"action": "ThrowObject", "forceAction": True}
    assert_misuse(front, missing, "MissingArguments", "moveMagnitude", "ThrowObject")
    assert_misuse(front, {"action": "AddThirdPartyCamera"}, "MissingArguments", "position")


@behaviour("invalid_arguments")
def test_argument_that_an_action_does_not_know_raises(front):
    before = world_of(front)
    put = {"action": "PutObject", "x": 0.0, "y": 0.0, "z": 1.0, "placeStationary": True}
    assert_misuse(front, put, "InvalidArgument", "z")
    assert_misuse(front, {"action": "MoveAhead", "moveMagnitude": "far"}, "InvalidArgument")
    assert world_of(front) == before


@behaviour("target_invocation_exception")
def test_place_outside_of_the_picture_is_refused_with_the_exceptions_name(front):
    event = front.step("OpenObject", x=1.5, y=0.5)
    assert not event
    assert event.metadata["errorMessage"].startswith("ArgumentOutOfRangeException: x and y must be")
    assert event.metadata["errorCode"] == "UnhandledException"


@behaviour("jsonschema_metadata")
def test_metadata_has_all_fields_with_their_types(front):
    for event in (front.step("Pass"), front.step("MoveAhead", moveMagnitude=9.0)):
        assert_form(event.metadata, EVENT_FIELDS)
        assert_form(event.metadata["agent"], AGENT_FIELDS)
        assert event.metadata["objects"]
        for thing in event.metadata["objects"]:
            assert_form(thing, OBJECT_FIELDS)
            assert_form(thing["position"], dict.fromkeys("xyz", float))
    json.dumps(event.metadata)


@behaviour("set_random_seed")
def test_random_seed_decides_what_is_drawn_by_lot(front):
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


@behaviour("per_step_instance_segmentation")
def test_segmentation_can_be_asked_for_in_a_single_step(front):
    assert front.step("RotateLeft").instance_segmentation_frame is None
    event = front.step("RotateRight", renderInstanceSegmentation=True)
    assert event.instance_segmentation_frame.shape == (300, 300, 3)
    assert len(event.instance_masks) > 3
    assert front.step("Pass").frame is not None


@behaviour("change_resolution")
def test_resolution_can_be_changed_at_any_time(front):
    assert front.last_event.frame.shape == (300, 300, 3)
    event = front.step("ChangeResolution", x=400, y=320, raise_for_failure=True)
    assert event.frame.shape == (320, 400, 3)
    assert (event.screen_width, event.screen_height) == (400, 320)
    assert (meta(front, "screenWidth"), meta(front, "screenHeight")) == (400, 320)
    assert front.step("MoveAhead").frame.shape == (320, 400, 3)


@behaviour("change_resolution_image_synthesis")
def test_all_pictures_follow_the_resolution_and_come_back_the_same(front):
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


@behaviour("segmentation_colors")
def test_colours_name_objects_and_types_both_ways(front):
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


@behaviour("add_third_party_camera")
def test_third_party_camera_is_where_it_was_put_and_has_pictures(front):
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


@behaviour("update_third_party_camera")
def test_third_party_camera_can_be_moved_by_parts(front):
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


@behaviour("third_party_camera_with_image_synthesis")
def test_third_party_camera_has_every_kind_of_picture_that_is_asked_for(front):
    front.reset(**dict.fromkeys(KINDS, True))
    event = front.step("AddThirdPartyCamera", **CAMERA)
    for _, several in KINDS.values():
        assert len(getattr(event, several)) == 1, several
        assert getattr(event, several)[0].shape[:2] == (300, 300)
    assert event.third_party_depth_frames[0].dtype == np.float32
    assert len(event.third_party_instance_masks[0]) > 3
    assert "Fridge" in event.third_party_class_masks[0]


@behaviour("third_party_camera_depth")
def test_third_party_camera_in_the_agents_eye_sees_what_the_agent_sees(front):
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


@behaviour("get_coordinate_from_raycast")
def test_coordinate_is_what_the_picture_shows_there(front):
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


@behaviour("simobj_filter")
def test_object_filter_lists_only_what_is_asked_for_until_it_is_reset(front):
    everything = sorted(thing["objectId"] for thing in meta(front, "objects"))
    three = everything[:3]
    for wanted in (three, three[:1], []):
        assert front.step("SetObjectFilter", objectIds=wanted)
        assert sorted(thing["objectId"] for thing in meta(front, "objects")) == wanted
        assert front.step("Pass")
        assert sorted(thing["objectId"] for thing in meta(front, "objects")) == wanted
    assert front.step("ResetObjectFilter")
    assert sorted(thing["objectId"] for thing in meta(front, "objects")) == everything


@behaviour("open")
def test_open_sets_the_openness_and_close_takes_it_back(front):
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


@behaviour("open_aabb_cache")
def test_box_of_what_opens_grows_and_comes_back(front):
    fridge = first(front, "Fridge")
    closed = copy.deepcopy(look(front, fridge)["axisAlignedBoundingBox"])
    assert front.step("OpenObject", objectId=fridge, forceAction=True, openness=1.0)
    opened = look(front, fridge)["axisAlignedBoundingBox"]
    assert opened["size"] != closed["size"]
    assert len(opened["cornerPoints"]) == 8
    assert front.step("CloseObject", objectId=fridge, forceAction=True)
    assert look(front, fridge)["axisAlignedBoundingBox"] == closed


@behaviour("open_interactable")
def test_what_is_interactable_opens_and_what_is_not_does_not(front):
    fridge = first(front, "Fridge")
    event = front.step("OpenObject", objectId=fridge)  # the agent looks the other way
    assert not look(front, fridge)["isInteractable"]
    assert not event
    assert "not found within the specified visibility" in event.metadata["errorMessage"]
    reach(front, fridge)
    assert look(front, fridge)["isInteractable"]
    assert front.step("OpenObject", objectId=fridge)
    assert look(front, fridge)["isOpen"]


@behaviour("open_interactable_with_filter")
def test_what_the_filter_leaves_out_can_be_handled_all_the_same(front):
    fridge = first(front, "Fridge")
    reach(front, fridge)
    assert front.step("SetObjectFilter", objectIds=[])
    assert meta(front, "objects") == []
    assert front.step("OpenObject", objectId=fridge)
    assert meta(front, "objects") == []
    assert front.step("ResetObjectFilter", renderImage=False)
    assert look(front, fridge)["isOpen"]


# ----------------------------------------------------------------- handling things


@behaviour("toggle_stove")
def test_burner_is_lit_by_its_knob_and_not_directly(front):
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


@behaviour("drop_object")
@pytest.mark.parametrize("action", ["DropHeldObject", "DropHandObject"])
def test_drop_empties_the_hand_and_says_where_the_thing_came_to_lie(front, action):
    apple = pick_up(front, "Apple")
    high = look(front, apple)["position"]["y"]
    event = front.step(action)
    assert event
    assert event.metadata["inventoryObjects"] == []
    assert not look(front, apple)["isPickedUp"]
    assert look(front, apple)["position"]["y"] < high
    assert event.metadata["actionReturn"] == look(front, apple)["position"]
    assert not front.step(action)


@behaviour("move_hand")
def test_hand_moves_along_the_cameras_axes_and_back(front):
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


@behaviour("rotate_hand")
def test_held_object_turns_by_angles_or_to_a_rotation(front):
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


@behaviour("fill_liquid")
def test_mug_takes_one_liquid_at_a_time(front):
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


@behaviour("randomize_materials_clearOnReset")
def test_materials_are_refused_by_name_and_reset_has_nothing_to_clear(front):
    before, frame = world_of(front), front.last_event.frame.copy()
    for action in ("RandomizeMaterials", "ResetMaterials"):
        event = front.step(action)
        assert not event
        assert action in event.metadata["errorMessage"]
        assert world_of(front) == before
        assert np.array_equal(event.frame, frame)
    assert np.array_equal(front.reset().frame, frame)


@behaviour("randomize_materials_params")
def test_materials_are_refused_whatever_is_asked_of_them(front):
    before = world_of(front)
    flags = ("useTrainMaterials", "useValMaterials", "useTestMaterials", "useExternalMaterials")
    for arguments in (*({flag: True} for flag in flags), {"inRoomTypes": ["Kitchen"]}):
        event = front.step("RandomizeMaterials", **arguments)
        assert not event
        assert "RandomizeMaterials" in event.metadata["errorMessage"]
        assert world_of(front) == before
