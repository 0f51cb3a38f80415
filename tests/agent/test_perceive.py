"""What is read out of a world's event, and what an event did to the things around."""

import pytest

from karma.agent.perceive import cooled, heated, observe, place_of, states_of, to_unit, washed
from karma.contracts import MemoryUnit, SeenObject
from karma.household.places import HAND
from karma.world.sim import EmbeddedWorld


@pytest.fixture
def world():
    return EmbeddedWorld("kitchen_1")


def first(world, kind, place=""):
    return next(
        thing["objectId"]
        for thing in world.last_event.metadata["objects"]
        if thing["objectType"] == kind
        and (not place or (thing["parentReceptacles"] or [""])[0].startswith(place))
    )


def do(world, action, object_id, **arguments):
    event = world.step(action, objectId=object_id, forceAction=True, **arguments)
    assert event.metadata["lastActionSuccess"], event.metadata["errorMessage"]
    return event


def put(world, object_id, receptacle_id):
    do(world, "PickupObject", object_id)
    return do(world, "PutObject", receptacle_id)


def test_observe_returns_only_what_is_visible_and_the_pose(world):
    metadata = world.last_event.metadata
    observation = observe(world.last_event)
    visible = {thing["objectId"] for thing in metadata["objects"] if thing["visible"]}
    assert 0 < len(visible) < len(metadata["objects"])
    assert {sight.object_id for sight in observation.seen} == visible
    assert observation.held is None
    assert (observation.ok, observation.error) == (True, "")
    assert observation.pose.position_m == tuple(metadata["agent"]["position"][k] for k in "xyz")


def test_observe_after_a_refusal_tells_it(world):
    event = world.step("PickupObject", objectId=first(world, "Fridge"))
    assert observe(event).ok is False
    assert observe(event).error == event.metadata["errorMessage"] != ""


def test_observe_gives_what_is_held_apart_and_its_place_is_the_hand(world):
    apple = first(world, "Apple")
    observation = observe(do(world, "PickupObject", apple))
    assert observation.held.object_id == apple
    assert place_of(observation.held) == HAND
    assert apple not in {sight.object_id for sight in observation.seen}


def test_states_follow_the_flags(world):
    apple, fridge, faucet = (first(world, kind) for kind in ("Apple", "Fridge", "Faucet"))

    def get(object_id):
        return world.last_event.get_object(object_id)

    assert states_of(get(apple)) == ()
    assert states_of(get(fridge)) == ("closed",)
    assert states_of(get(faucet)) == ("off",)
    do(world, "OpenObject", fridge)
    do(world, "ToggleObjectOn", faucet)
    assert states_of(get(fridge)) == ("opened",)
    assert states_of(get(faucet)) == ("on",)
    event = do(world, "SliceObject", apple)
    slices = [t for t in event.metadata["objects"] if t["objectId"].startswith(f"{apple}|")]
    assert slices
    assert all(states_of(thing) == ("sliced",) for thing in slices)
    assert states_of(get(apple)) == ("sliced",)


def test_states_of_dirty_filled_and_cooked(world):
    mug, potato = first(world, "Mug"), first(world, "Potato")
    do(world, "FillObjectWithLiquid", mug, fillLiquid="water")
    do(world, "CookObject", potato)
    dirty = states_of(world.last_event.get_object(mug))
    assert "filled" in dirty
    assert "cooked" in states_of(world.last_event.get_object(potato))


def test_burner_is_on_with_its_knob(world):
    knob = first(world, "StoveKnob")
    burner = world.last_event.get_object(knob)["controlledObjects"][0]
    do(world, "ToggleObjectOn", knob)
    assert states_of(world.last_event.get_object(burner)) == ("on",)


def test_washed_is_what_lies_in_the_basin_when_the_tap_is_turned_on(world):
    apple, potato, bowl = (first(world, kind) for kind in ("Apple", "Potato", "Bowl"))
    put(world, potato, bowl)
    put(world, bowl, first(world, "SinkBasin"))
    put(world, apple, first(world, "SinkBasin"))
    assert washed(world.last_event) == frozenset()
    event = do(world, "ToggleObjectOn", first(world, "Faucet"))
    assert {apple, potato, bowl} <= washed(event)
    assert first(world, "Bread") not in washed(event)
    assert not any("Sink" in object_id.split("|")[0] for object_id in washed(event))


def test_washed_after_another_action_is_nothing(world):
    put(world, first(world, "Apple"), first(world, "SinkBasin"))
    do(world, "ToggleObjectOn", first(world, "Faucet"))
    assert washed(world.step("Pass")) == frozenset()
    refused = world.step("ToggleObjectOn", objectId=first(world, "Faucet"), forceAction=True)
    assert washed(refused) == frozenset()


def test_washed_slices_of_what_was_cut_in_the_sink(world):
    apple = first(world, "Apple")
    put(world, apple, first(world, "SinkBasin"))
    do(world, "SliceObject", apple)
    clean = washed(do(world, "ToggleObjectOn", first(world, "Faucet")))
    assert sum(object_id.startswith(f"{apple}|") for object_id in clean) > 1


def test_heated_is_what_a_microwave_holds_when_it_starts(world):
    oven, potato = first(world, "Microwave"), first(world, "Potato")
    do(world, "OpenObject", oven)
    put(world, potato, oven)
    do(world, "CloseObject", oven)
    assert potato not in heated(world.last_event)
    assert potato in heated(do(world, "ToggleObjectOn", oven))
    assert "heated" in states_of(world.last_event.get_object(potato))


def test_cooled_is_what_a_fridge_holds_when_it_closes(world):
    fridge, apple = first(world, "Fridge"), first(world, "Apple")
    do(world, "OpenObject", fridge)
    assert cooled(put(world, apple, fridge)) == frozenset()
    assert apple in cooled(do(world, "CloseObject", fridge))
    assert cooled(world.step("Pass")) == frozenset()


def sight(*parents):
    return SeenObject(
        object_id="Apple|1", object_type="Apple", position_m=(1.0, 2.0, 3.0), pickupable=True,
        box_center_m=(1.0, 2.0, 3.0), box_size_m=(0.1, 0.1, 0.1), parent_ids=parents,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("parents", "place"),
    [
        ((), None),
        (("Floor|0",), "Floor|0"),
        (("Floor|0", "Box|1"), "Box|1"),
        (("Plate|1", "CounterTop|1"), "Plate|1"),
        ((HAND,), HAND),
    ],
)
def test_unit_lies_in_the_nearest_parent_that_is_not_the_floor(parents, place):
    unit = to_unit(sight(*parents), ("cleaned",), handled=True, image=None)
    assert unit.place_id == place


def test_unit_keeps_states_in_order_once_and_without_none():
    states = ("sliced", "none", "cleaned", "sliced")
    assert to_unit(sight(), states, handled=False, image="images/Apple.png") == MemoryUnit(
        object_id="Apple|1", object_type="Apple", position_m=(1.0, 2.0, 3.0),
        states=("sliced", "cleaned"), handled=False, image="images/Apple.png",
    )  # fmt: skip
