"""Putting objects elsewhere without a hand: by pose, by lot, in and out of the world, by state."""

import msgspec
import pytest
from support.household import bring, find, kitchen, look, reach

from karma.world.core.thing import bottom, top
from karma.world.sim import EmbeddedWorld


@pytest.fixture
def world():
    return EmbeddedWorld(kitchen())


def xyz(point):
    return dict(zip("xyz", point, strict=True))


def poses(world, kinds=None):
    """What SetObjectPoses needs to leave the loose objects as they are."""
    return [
        {"objectName": o["name"], "position": o["position"], "rotation": o["rotation"]}
        for o in world.last_event.metadata["objects"]
        if (o["pickupable"] or o["moveable"]) and (kinds is None or o["objectType"] in kinds)
    ]


# ----------------------------------------------------------------- one object


def test_thing_placed_at_a_point_stands_on_what_is_there(world):
    apple, counter = find(world, "Apple"), find(world, "CounterTop")
    event = world.step(
        "PlaceObjectAtPoint", objectId=apple, position={"x": -0.3, "y": 0.92, "z": 1.35}
    )
    assert event, event.message
    placed = world.state.objects[apple]
    assert placed.parents == (counter,)
    assert bottom(placed) == pytest.approx(0.9, abs=0.03)
    assert placed.center[::2] == pytest.approx((-0.3, 1.35))


def test_thing_placed_in_the_air_falls_unless_it_is_held_there(world):
    apple, table = find(world, "Apple"), find(world, "DiningTable")
    spot = {"x": 1.6, "y": 1.4, "z": 0.1}
    assert world.step("PlaceObjectAtPoint", objectId=apple, position=spot)
    assert world.state.objects[apple].parents == (table,)
    assert bottom(world.state.objects[apple]) == pytest.approx(0.8, abs=0.01)
    assert world.step("PlaceObjectAtPoint", objectId=apple, position=spot, forceKinematic=True)
    assert bottom(world.state.objects[apple]) == pytest.approx(1.4)
    assert world.state.objects[apple].parents == ()


def test_thing_is_not_placed_into_another_or_outside_the_room(world):
    apple = find(world, "Apple")
    before = world.state
    machine = {"x": -0.7, "y": 1.0, "z": 1.3}  # it takes mugs only
    for action in ("PlaceObjectAtPoint", "TeleportObject"):
        event = world.step(action, objectId=apple, position={"x": 9, "y": 1, "z": 0})
        assert "outside the scene's bounds" in event.message
        event = world.step(action, objectId=apple, position=machine)
        assert "is colliding with CoffeeMachine" in event.message
    assert world.state is before
    assert world.step("TeleportObject", objectId=apple, position=machine, forceAction=True)


def test_fixed_thing_is_not_placed_at_a_point(world):
    for kind in ("Fridge", "CounterTop"):
        event = world.step(
            "PlaceObjectAtPoint", objectId=find(world, kind), position={"x": 0, "y": 1, "z": 0}
        )
        assert "neither pickupable nor moveable" in event.message


def test_teleported_object_takes_position_rotation_and_contents(world):
    plate, tomato = find(world, "Plate"), find(world, "Tomato")
    spot = {"x": 0.9, "y": 0.95, "z": 1.3}
    rise = world.state.objects[tomato].center[1] - world.state.objects[plate].center[1]
    event = world.step(
        "TeleportObject", objectId=plate, position=spot, rotation={"y": 90}, forceAction=True,
        forceKinematic=True,
    )  # fmt: skip
    assert event, event.message
    assert look(world, plate)["position"] == spot
    assert look(world, plate)["rotation"]["y"] == 90.0
    after = world.state.objects
    assert after[tomato].center[1] - after[plate].center[1] == pytest.approx(rise)
    assert plate in after[tomato].parents


def test_teleport_out_of_the_hand_must_be_allowed(world):
    apple = reach(world, "Apple")
    world.step("PickupObject", objectId=apple)
    where = {"objectId": apple, "x": 1.6, "y": 0.9, "z": 0.1}
    assert world.step("TeleportObject", **where).message == "Cannot teleport object in hand."
    assert world.step("TeleportObject", **where, allowTeleportOutOfHand=True)
    assert world.last_event.metadata["inventoryObjects"] == []
    assert look(world, apple)["parentReceptacles"] == [find(world, "DiningTable")]


def test_fixed_object_is_teleported_by_force_only(world):
    faucet = find(world, "Faucet")
    where = {"objectId": faucet, "position": {"x": 0.5, "y": 1.05, "z": 1.42}}
    assert "forceAction" in world.step("TeleportObject", **where).message
    assert world.step("TeleportObject", **where, forceAction=True)
    assert look(world, faucet)["position"]["x"] == 0.5
    with pytest.raises(ValueError, match="position"):
        world.step("TeleportObject", objectId=faucet, forceAction=True)


def test_teleport_takes_the_first_of_several_positions_that_is_free(world):
    apple = find(world, "Apple")
    places = [{"x": 9, "y": 1, "z": 9}, {"x": 1.6, "y": 0.9, "z": 0.1}]
    assert world.step("TeleportObject", objectId=apple, positions=places, makeUnbreakable=True)
    assert look(world, apple)["position"]["x"] == 1.6


# ----------------------------------------------------------------- all poses


def test_poses_as_they_are_change_nothing_but_the_time(world):
    world.step("OpenObject", objectId=find(world, "Fridge"), forceAction=True)
    before = world.state
    event = world.step("SetObjectPoses", objectPoses=poses(world))
    assert event, event.message
    assert dict(world.state.objects) == dict(before.objects)


def test_poses_bring_a_shuffled_room_back(world):
    before, wanted = world.state.objects, poses(world)
    world.step("InitialRandomSpawn", randomSeed=3)
    moved = [i for i in before if before[i].center != world.state.objects[i].center]
    assert moved
    assert world.step("SetObjectPoses", objectPoses=wanted)
    after = world.state.objects
    for object_id in before:
        assert after[object_id].position == pytest.approx(before[object_id].position, abs=1e-5)
        assert before[object_id].parents[:1] == after[object_id].parents[:1], object_id


def test_objects_without_a_pose_are_removed_and_fixed_ones_stay(world):
    fixed = [o["objectId"] for o in world.last_event.metadata["objects"]
             if not (o["pickupable"] or o["moveable"])]  # fmt: skip
    assert world.step("SetObjectPoses", objectPoses=poses(world, {"Apple", "Bowl"}))
    left = world.last_event.metadata["objects"]
    assert {o["objectType"] for o in left if o["pickupable"]} == {"Apple", "Bowl"}
    assert [o["objectId"] for o in left if o["objectId"] in fixed] == fixed


def test_names_given_again_are_copied_under_new_ids_and_names(world):
    wanted = poses(world)
    apple = next(one for one in wanted if one["objectName"].startswith("Apple"))
    for x, z in ((-0.3, 1.35), (0.9, 1.0)):
        wanted.append({**apple, "position": {"x": x, "y": 0.96, "z": z}})
    assert world.step("SetObjectPoses", objectPoses=wanted)
    apples = world.last_event.objects_by_type("Apple")
    assert len({one["objectId"] for one in apples}) == len({one["name"] for one in apples}) == 3
    assert [one["parentReceptacles"] for one in apples[1:]] == [[find(world, "CounterTop")]] * 2
    assert world.step("PickupObject", objectId=apples[2]["objectId"], forceAction=True)


def test_poses_of_what_is_not_there_are_refused(world):
    before = world.state
    wanted = poses(world)
    event = world.step("SetObjectPoses", objectPoses=[{**wanted[0], "objectName": "Yacht_1"}])
    assert event.message == "No Pickupable or Moveable object of name Yacht_1 found in scene."
    assert "at least one" in world.step("SetObjectPoses", objectPoses=[]).message
    assert not world.step("SetObjectPoses", objectPoses=[{"objectName": wanted[0]["objectName"]}])
    assert world.state is before


def test_pose_in_the_air_stays_there_or_falls(world):
    wanted = poses(world)
    apple = next(one for one in wanted if one["objectName"].startswith("Apple"))
    apple["position"] = {"x": 1.6, "y": 1.5, "z": 0.1}
    world.step("SetObjectPoses", objectPoses=wanted)
    assert look(world, find(world, "Apple"))["position"]["y"] == 1.5
    world.step("SetObjectPoses", objectPoses=wanted, placeStationary=False)
    assert look(world, find(world, "Apple"))["parentReceptacles"] == [find(world, "DiningTable")]


def test_held_object_with_a_pose_leaves_the_hand(world):
    wanted = poses(world)
    apple = reach(world, "Apple")
    world.step("PickupObject", objectId=apple)
    assert world.step("SetObjectPoses", objectPoses=wanted)
    assert world.last_event.metadata["inventoryObjects"] == []
    assert look(world, apple)["parentReceptacles"] == [find(world, "DiningTable")]


# ----------------------------------------------------------------- in and out of the world


def test_removed_object_is_gone_and_its_contents_fall(world):
    table, apple = find(world, "DiningTable"), find(world, "Apple")
    assert world.step("RemoveFromScene", objectId=table)
    assert world.last_event.get_object(table) is None
    fallen = world.state.objects[apple]
    assert bottom(fallen) == pytest.approx(0.0, abs=0.01)
    assert fallen.parents == (find(world, "Floor"),)
    assert "is not the objectId" in world.step("RemoveFromScene", objectId=table).message


def test_removed_objects_may_be_several_or_in_the_hand(world):
    apple, bowl = reach(world, "Apple"), find(world, "Bowl")
    world.step("PickupObject", objectId=apple)
    assert world.step("RemoveFromScene", objectIds=[apple, bowl])
    assert world.last_event.metadata["inventoryObjects"] == []
    assert {apple, bowl}.isdisjoint(world.state.objects)
    with pytest.raises(ValueError, match="objectId"):
        world.step("RemoveFromScene")


def test_knob_of_a_removed_burner_controls_nothing(world):
    knob = world.state.objects[find(world, "StoveKnob")]
    world.step("RemoveFromScene", objectId=knob.controls[0])
    assert look(world, knob.id)["controlledObjects"] == []
    assert world.step("ToggleObjectOn", objectId=knob.id, forceAction=True)


def test_disabled_object_is_out_of_the_world_until_it_is_enabled(world):
    bowl = find(world, "Bowl")
    before = look(world, bowl)
    assert world.step("DisableObject", objectId=bowl)
    assert world.last_event.get_object(bowl) is None
    assert "is not the objectId" in world.step("PickupObject", objectId=bowl).message
    assert world.step("EnableObject", objectId=bowl)
    assert look(world, bowl) == before
    assert world.step("EnableObject", objectId=bowl)
    assert not world.step("EnableObject", objectId="Yacht|1|2|3")


def test_enabled_object_whose_place_is_gone_falls(world):
    apple = find(world, "Apple")
    world.step("DisableObject", objectId=apple)
    world.step("RemoveFromScene", objectId=find(world, "DiningTable"))
    assert world.step("EnableObject", objectId=apple)
    assert look(world, apple)["parentReceptacles"] == [find(world, "Floor")]


# ----------------------------------------------------------------- and by hand


def test_opened_by_the_old_name_of_openness(world):
    fridge = find(world, "Fridge")
    for magnitude, openness in ((0, 1.0), (0.65, 0.65)):
        world.step("OpenObject", objectId=fridge, forceAction=True, moveMagnitude=magnitude)
        assert look(world, fridge)["openness"] == pytest.approx(openness)


def test_contents_of_a_bowl_put_down_lie_where_it_lies(world):
    event, _, table = bring(world, "Plate", "CounterTop")
    assert event
    tomato = world.state.objects[find(world, "Tomato")]
    assert find(world, "Plate") in tomato.parents
    assert find(world, "DiningTable") not in tomato.parents
    assert top(world.state.objects[table]) < bottom(tomato) + 0.05
    assert msgspec.to_builtins(tomato)
