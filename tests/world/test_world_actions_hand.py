"""Moving and turning what is in the hand."""

import pytest
from support.household import find, kitchen, look, reach

from karma.world.sim import EmbeddedWorld

REST = {"x": 0.0, "y": -0.16, "z": 0.38}


@pytest.fixture
def world():
    return EmbeddedWorld(kitchen())


def hand(world):
    return world.last_event.metadata["heldObjectPose"]


def take(world, kind, yaw=180):
    """Pick something up and stand in the middle of the room with it."""
    object_id = reach(world, kind)
    assert world.step("PickupObject", objectId=object_id), world.last_event.message
    world.step("TeleportFull", x=0.0, y=0.9, z=0.0, rotation=yaw, horizon=0, standing=True)
    return object_id


# ----------------------------------------------------------------- moving the hand


def test_hand_rests_again_after_letting_go_and_after_picking_up(world):
    take(world, "Apple")
    world.step("MoveHeldObject", ahead=0.2)
    world.step("RotateHeldObject", yaw=30)
    assert world.step("DropHeldObject")
    assert hand(world)["localPosition"] == REST
    assert set(hand(world)["localRotation"].values()) == {0.0}


def test_contents_move_with_the_hand(world):
    plate = take(world, "Plate")
    tomato = find(world, "Tomato")
    gap = [
        a - b
        for a, b in zip(*(world.state.objects[i].center for i in (plate, tomato)), strict=True)
    ]
    world.step("MoveHeldObject", ahead=0.2, right=0.1)
    after = [
        a - b
        for a, b in zip(*(world.state.objects[i].center for i in (plate, tomato)), strict=True)
    ]
    assert after == pytest.approx(gap, abs=1e-5)


def test_hand_does_not_leave_reach_view_or_room(world):
    take(world, "Apple")
    before = world.state
    assert "out of range" in world.step("MoveHeldObject", ahead=1.2).message
    assert "viewport" in world.step("MoveHeldObject", up=0.9).message
    assert "viewport" in world.step("MoveHeldObjectBack", moveMagnitude=0.5).message
    assert "negative" in world.step("MoveHeldObjectUp", moveMagnitude=-0.5).message
    assert world.state is before
    assert world.step("MoveHeldObject", up=0.9, forceVisible=True)


# ----------------------------------------------------------------- turning the hand


@pytest.mark.parametrize(
    ("turn", "rotation"),
    [
        ({"pitch": 90}, (90, 180, 0)),
        ({"yaw": 90}, (0, 270, 0)),
        ({"roll": 90}, (0, 180, 270)),
        ({"pitch": 90, "yaw": 90, "roll": 90}, (90, 0, 0)),  # as Unity writes it
    ],
)
def test_hand_s_rotation_in_the_room_adds_the_agent_s_yaw(world, turn, rotation):
    take(world, "SoapBottle", yaw=180)
    world.step("RotateHeldObject", **turn)
    assert tuple(hand(world)["rotation"].values()) == rotation


def test_vessel_turned_upside_down_is_empty(world):
    mug = take(world, "Mug")
    world.step("FillObjectWithLiquid", objectId=mug, forceAction=True)
    world.step("RotateHeldObject", pitch=80)
    assert look(world, mug)["isFilledWithLiquid"]
    world.step("RotateHeldObject", pitch=80)
    assert not look(world, mug)["isFilledWithLiquid"]
