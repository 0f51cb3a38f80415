"""What every world promises: AI2-THOR 5.0.0's fields and manners.

Covered: the form of metadata, refusals that change nothing, misuse that raises, replay, poses that
lead to what they promise. Each registered world is tested.
"""

import json
import math

import pytest
from support.fronts import player_command
from support.household import kitchen

from karma import registry
from karma.errors import KarmaError
from karma.files import to_json

TEXT, NUMBER, FLAG, LIST, DICT, NULL = str, (int, float), bool, list, dict, type(None)
EVENT_FIELDS = {
    "objects": LIST, "isSceneAtRest": FLAG, "agent": DICT, "heldObjectPose": DICT, "arm": NULL,
    "fov": float, "cameraPosition": DICT, "cameraOrthSize": float,
    "thirdPartyCameras": (LIST, NULL), "collided": FLAG, "collidedObjects": LIST,
    "inventoryObjects": LIST, "sceneName": TEXT, "lastAction": TEXT, "errorMessage": TEXT,
    "errorCode": (TEXT, NULL), "lastActionSuccess": FLAG, "screenWidth": int, "screenHeight": int,
    "agentId": int, "depthFormat": TEXT, "colors": (LIST, NULL), "flatSurfacesOnGrid": LIST,
    "distances": LIST, "normals": LIST, "isOpenableGrid": LIST, "segmentedObjectIds": LIST,
    "objectIdsInBox": LIST, "actionIntReturn": int, "actionFloatReturn": float,
    "actionStringsReturn": (LIST, NULL), "actionFloatsReturn": (LIST, NULL),
    "actionVector3sReturn": (LIST, NULL), "visibleRange": NULL, "currentTime": float,
    "sceneBounds": DICT, "actionReturn": (NULL, TEXT, DICT, LIST),
}  # fmt: skip
OBJECT_FIELDS = {
    "name": TEXT, "position": DICT, "rotation": DICT, "visible": FLAG, "isInteractable": FLAG,
    "receptacle": FLAG, "toggleable": FLAG, "isToggled": FLAG, "breakable": FLAG, "isBroken": FLAG,
    "canFillWithLiquid": FLAG, "isFilledWithLiquid": FLAG, "fillLiquid": (TEXT, NULL),
    "dirtyable": FLAG, "isDirty": FLAG, "canBeUsedUp": FLAG, "isUsedUp": FLAG, "cookable": FLAG,
    "isCooked": FLAG, "temperature": TEXT, "isHeatSource": FLAG, "isColdSource": FLAG,
    "sliceable": FLAG, "isSliced": FLAG, "openable": FLAG, "isOpen": FLAG, "openness": float,
    "pickupable": FLAG, "isPickedUp": FLAG, "moveable": FLAG, "mass": float,
    "salientMaterials": (LIST, NULL), "receptacleObjectIds": (LIST, NULL), "distance": float,
    "objectType": TEXT, "objectId": TEXT, "assetId": TEXT, "parentReceptacles": (LIST, NULL),
    "controlledObjects": (LIST, NULL), "isMoving": FLAG, "axisAlignedBoundingBox": DICT,
    "objectOrientedBoundingBox": (DICT, NULL),
}  # fmt: skip
AGENT_FIELDS = {
    "name": TEXT, "position": DICT, "rotation": DICT, "cameraHorizon": float, "isStanding": FLAG,
    "inHighFrictionArea": FLAG,
}  # fmt: skip
SCRIPT = [
    {"action": "MoveAhead"},
    {"action": "RotateRight"},
    {"action": "LookDown", "degrees": 30},
    {"action": "OpenObject", "objectId": "Fridge", "forceAction": True},
    {"action": "PickupObject", "objectId": "Apple", "forceAction": True},
    {"action": "MoveLeft"},
    {"action": "PutObject", "objectId": "Fridge", "forceAction": True},
    {"action": "SliceObject", "objectId": "Bread", "forceAction": True},
    {"action": "PickupObject", "objectId": "Plate", "forceAction": True},
    {"action": "RotateLeft"},
    {"action": "DropHeldObject"},
    {"action": "GetReachablePositions"},
]


@pytest.fixture(params=[*registry.names("worlds"), "thor by the player"])
def opened(request, tmp_path):
    """A world and what it calls the handmade scene, which is loaded."""
    path = tmp_path / "handmade.json"
    path.write_bytes(to_json(kitchen()))
    try:
        made, scene = open_world(request.param, path)
    except KarmaError as error:  # a world may need what is not installed
        pytest.skip(str(error).partition("\n")[0])
    made.reset(scene)
    yield made, scene
    made.stop()


@pytest.fixture
def world(opened):
    return opened[0]


@pytest.fixture
def scene(opened):
    return opened[1]


def open_world(name, path):
    """Return a world, and what it calls the scene at `path`."""
    if name == "thor by the player":  # AI2-THOR's own client, our world behind its protocol
        made = registry.load("worlds", "thor")(
            player_command(path.parent), folder=path.parent / "thor"
        )
        return made, path.stem
    return registry.load("worlds", name)(), str(path)


def id_of(world, kind):
    objects = world.last_event.metadata["objects"]
    return next(o["objectId"] for o in objects if o["objectType"] == kind)


def do(world, action):
    """Do one action of SCRIPT, in which objectId gives a type."""
    action = dict(action)
    if "objectId" in action:
        action["objectId"] = id_of(world, action["objectId"])
    return world.step(**action)


def truth(world):
    """What may not change: all but the fields that report the last action."""
    report = {"lastAction", "lastActionSuccess", "errorMessage", "errorCode", "actionReturn",
              "actionStringsReturn", "actionFloatsReturn", "actionVector3sReturn"}  # fmt: skip
    metadata = world.last_event.metadata
    return json.dumps({k: v for k, v in metadata.items() if k not in report}, sort_keys=True)


def assert_form(record, fields):
    assert set(record) == set(fields)
    wrong = [
        (key, value)
        for key, value in record.items()
        if not isinstance(value, fields[key]) or (isinstance(value, bool) and fields[key] is int)
    ]
    assert not wrong


def test_fields_listed_here_agree_with_recorded_sessions(shared):
    recorded = json.loads((shared / "data/thor5/metadata_contract.json").read_text())
    assert set(recorded["event_metadata"]) == set(EVENT_FIELDS)
    assert set(recorded["object"]) == set(OBJECT_FIELDS)
    assert set(recorded["nested"]["agent"]) == set(AGENT_FIELDS)


def test_metadata_after_every_action_has_all_fields_with_their_types(world):
    for action in [{"action": "Pass"}, *SCRIPT]:
        metadata = do(world, action).metadata
        assert_form(metadata, EVENT_FIELDS)
        assert_form(metadata["agent"], AGENT_FIELDS)
        for thing in metadata["objects"]:
            assert_form(thing, OBJECT_FIELDS)


def test_metadata_lists_and_capabilities_agree(world):
    for action in SCRIPT:
        for thing in do(world, action).metadata["objects"]:
            assert (thing["receptacleObjectIds"] is not None) == thing["receptacle"]
            assert (thing["controlledObjects"] is not None) == thing["toggleable"]
            loose = thing["pickupable"] or thing["moveable"]
            assert (thing["objectOrientedBoundingBox"] is not None) == loose
            assert not (thing["pickupable"] and thing["moveable"])
            assert thing["parentReceptacles"] != []


def test_metadata_boxes_are_finite_and_hold_their_corners(world):
    for action in SCRIPT:
        for thing in do(world, action).metadata["objects"]:
            box = thing["axisAlignedBoundingBox"]
            assert len(box["cornerPoints"]) == 8
            for corner in box["cornerPoints"]:
                for axis, value in zip("xyz", corner, strict=True):
                    assert math.isfinite(value)
                    far = abs(value - box["center"][axis])
                    assert far == pytest.approx(box["size"][axis] / 2, abs=1e-9)


def test_every_object_has_one_place(world):
    for action in SCRIPT:
        metadata = do(world, action).metadata
        held = [item["objectId"] for item in metadata["inventoryObjects"]]
        by_id = {thing["objectId"]: thing for thing in metadata["objects"]}
        assert [o["objectId"] for o in by_id.values() if o["isPickedUp"]] == held
        assert all(by_id[object_id]["parentReceptacles"] is None for object_id in held)
        for object_id, thing in by_id.items():
            for parent in thing["parentReceptacles"] or ():
                assert object_id in by_id[parent]["receptacleObjectIds"]
            for child in thing["receptacleObjectIds"] or ():
                assert object_id in by_id[child]["parentReceptacles"]


def test_replay_of_the_same_actions_gives_equal_bytes(world, scene):
    def run():
        world.reset(scene)
        return [json.dumps(do(world, action).metadata) for action in SCRIPT]

    assert run() == run()


REFUSED = [
    ({"action": "PickupObject", "objectId": "Nothing|1|2|3"}, "is not the objectId"),
    ({"action": "PickupObject", "objectId": "Candle|+01.85|+00.85|-00.20"}, "visib"),
    ({"action": "PutObject", "objectId": "DiningTable"}, "holding"),
    ({"action": "ToggleObjectOn", "objectId": "StoveBurner", "forceAction": True}, ""),
    ({"action": "ToggleObjectOff", "objectId": "Faucet", "forceAction": True}, "already off"),
    ({"action": "PickupObject", "objectId": "Fridge", "forceAction": True}, ""),
    ({"action": "SliceObject", "objectId": "Mug", "forceAction": True}, ""),
    ({"action": "LookDown", "degrees": 70}, "can't look down beyond 60 degrees"),
    ({"action": "LookUp", "degrees": 31}, "can't look up beyond 30 degrees"),
    ({"action": "Teleport", "x": 9.0}, ""),
    ({"action": "MoveAhead", "moveMagnitude": 5.0}, "is blocking Agent 0 from moving by"),
    ({"action": "DropHeldObject"}, ""),
]


@pytest.mark.parametrize(("action", "message"), REFUSED)
def test_refused_action_says_why_and_changes_nothing(world, action, message):
    before = truth(world)
    if "objectId" in action and "|" not in action["objectId"]:
        action = {**action, "objectId": id_of(world, action["objectId"])}
    event = world.step(**action)
    assert not event
    assert not event.metadata["lastActionSuccess"]
    assert message in event.metadata["errorMessage"] != ""
    assert event.metadata["errorCode"]
    assert truth(world) == before


MISUSED = [
    ({"action": "Fly"}, "InvalidAction", "Invalid action: Fly"),
    ({"action": "ThrowObject"}, "MissingArguments", "moveMagnitude"),
    ({"action": "TeleportFull", "x": 0.0}, "MissingArguments", "rotation"),
    ({"action": "PickupObject"}, "MissingArguments", "objectId"),
    ({"action": "MoveAhead", "speed": 3}, "InvalidArgument", "speed"),
    ({"action": "MoveAhead", "moveMagnitude": "far"}, "InvalidArgument", "moveMagnitude"),
    ({"action": "OpenObject", "objectId": "x", "forceAction": 1}, "InvalidArgument", "forceAction"),
]


@pytest.mark.parametrize(("action", "code", "message"), MISUSED)
def test_misused_action_raises_and_is_reported(world, action, code, message):
    before = truth(world)
    with pytest.raises(ValueError, match=message):
        world.step(**action)
    assert world.last_event.metadata["errorCode"] == code
    assert world.last_event.metadata["lastAction"] == action["action"]
    assert truth(world) == before


def test_unknown_argument_of_a_legacy_action_is_ignored(world):
    assert world.step("LookDown", speed=3)


def test_action_as_a_dict_does_the_same(world):
    world.step(dict(action="MoveAhead", moveMagnitude=0.5))
    assert world.last_event.metadata["agent"]["position"]["z"] == 0.5


def test_refusal_raises_when_asked_to(world):
    with pytest.raises(RuntimeError, match="beyond 60"):
        world.step("LookDown", degrees=90, raise_for_failure=True)


def test_moves_back_and_forth_return_to_the_start(world):
    start = world.last_event.metadata["agent"]
    for action in ("MoveAhead", "MoveRight", "MoveBack", "MoveLeft", "RotateLeft", "RotateRight"):
        assert world.step(action)
    assert world.last_event.metadata["agent"] == start


def test_reachable_positions_can_all_be_stood_on(world):
    event = world.step("GetReachablePositions")
    places = event.metadata["actionReturn"]
    assert event.metadata["reachablePositions"] == places
    assert len(places) == len({(p["x"], p["z"]) for p in places}) == len(kitchen().reachable)
    for place in places:
        assert world.step("Teleport", position=place)
    with pytest.raises(IndexError):
        world.last_event.metadata["reachablePositions"]


def test_interactable_poses_keep_their_promise(world):
    for kind in ("Apple", "Fridge", "StoveKnob", "Mug", "GarbageCan", "Faucet"):
        object_id = id_of(world, kind)
        poses = world.step("GetInteractablePoses", objectId=object_id).metadata["actionReturn"]
        assert poses
        for pose in poses[:: max(len(poses) // 8, 1)]:
            assert world.step("TeleportFull", **pose)
            seen = world.last_event.get_object(object_id)
            assert seen["visible"]
            assert seen["isInteractable"]


def test_shortest_path_leads_from_the_agent_to_the_object(world):
    object_id = id_of(world, "DiningTable")
    corners = world.step("GetShortestPath", objectId=object_id).metadata["actionReturn"]["corners"]
    assert corners[0] == world.last_event.metadata["agent"]["position"]
    assert corners[-1]["x"] == 1.0


def test_picture_size_and_pose_are_the_clients(world):
    event = world.step("RotateRight")
    assert (event.screen_width, event.screen_height) == (300, 300)
    assert event.pose == (0, 0, 90000, 0)
    assert event.pose_discrete == (0, 0, 1, 0)
    assert event.events == [event]
    assert event.metadata["hand"] == event.metadata["heldObjectPose"]
