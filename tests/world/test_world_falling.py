"""What sinks through a basin without a floor: how it comes down."""

import pytest
from msgspec.structs import replace
from support.household import find, kitchen, look, thing

from karma.world.sim import EmbeddedWorld

UNDER = thing("Cabinet", (0.0, 0.42, 1.15), (0.6, 0.8, 0.5), suffix="|under")


def world(*extra):
    """A kitchen in which a sponge sinks through the basin."""
    sponge = thing("DishSponge", (0.0, 0.778, 1.15), (0.1, 0.02, 0.06))
    return EmbeddedWorld(kitchen((replace(sponge, is_falling=True), *extra)))


def test_falling_thing_lies_in_nothing_until_it_comes_down_into_the_cabinet_below():
    room = world(UNDER)
    one = find(room, "DishSponge")
    for action in ("RotateRight", "RotateLeft"):
        assert room.step(action)
        assert look(room, one)["parentReceptacles"] is None
    room.step("PickupObject", objectId=find(room, "Apple"), forceAction=True)
    assert look(room, UNDER.id)["receptacleObjectIds"] == []
    assert room.step("DropHandObject")  # waits until all is at rest
    assert look(room, one)["parentReceptacles"] == [UNDER.id]
    assert look(room, UNDER.id)["receptacleObjectIds"] == [one]
    assert look(room, one)["position"]["y"] == pytest.approx(0.04, abs=0.01)
    assert not look(room, one)["visible"]
    assert room.state.falling == frozenset()


def wait(room, actions):
    """Let 0.04 s pass for each action."""
    for _ in range(actions):
        assert room.step("Pass")


def test_falling_takes_as_long_as_it_does_from_that_height():
    room = world(UNDER)
    one = find(room, "DishSponge")
    wait(room, 9)  # 0.36 s: 0.6 m and more
    assert look(room, one)["parentReceptacles"] is None
    wait(room, 1)
    assert look(room, one)["parentReceptacles"] == [UNDER.id]


def test_falling_thing_with_no_cabinet_below_lands_as_what_is_dropped_there_does():
    room = world()
    wait(room, 25)
    assert look(room, find(room, "DishSponge"))["parentReceptacles"][0].startswith("Floor")


def test_falling_thing_that_is_caught_stays_in_the_hand():
    room = world(UNDER)
    one = find(room, "DishSponge")
    assert room.step("PickupObject", objectId=one, forceAction=True)
    wait(room, 25)
    assert look(room, one)["isPickedUp"]
    assert room.state.falling == frozenset()
