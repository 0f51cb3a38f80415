"""What is read out of a world's event, and what an event did to the things around."""

import pytest

from karma.agent.seeing.perceive import observe, place_of, refusal, truth_of
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


def states(world, object_id):
    things = truth_of(world.last_event).objects
    return next(thing.states for thing in things if thing.object_id == object_id)


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
    assert observation.reason is None
    assert observation.pose.position_m == tuple(metadata["agent"]["position"][k] for k in "xyz")


def test_observe_after_a_refusal_tells_it(world):
    event = world.step("PickupObject", objectId=first(world, "Fridge"))
    why = observe(event).reason
    assert why is not None
    assert why == refusal(event)
    assert event.metadata["errorMessage"] == f"NullReferenceException: {why.words}"
    assert why.kind == "unreached"


def test_observe_out_of_view_knows_only_of_what_was_touched_and_of_its_pieces(world):
    world.step("RotateRight")
    apple, potato = first(world, "Apple"), first(world, "Potato")
    event = do(world, "SliceObject", apple)
    told = observe(event, touched=[apple])
    assert {sight.object_id for sight in told.pieces} >= {f"{apple}|AppleSliced_1"}
    assert potato not in {sight.object_id for sight in (*told.seen, *told.touched)}
    assert observe(event).touched == observe(event).pieces == ()


def test_observe_tells_of_known_things_only_what_a_tap_has_washed(world):
    apple, potato, tap = (first(world, kind) for kind in ("Apple", "Potato", "Faucet"))
    for thing in (apple, potato):
        put(world, thing, first(world, "SinkBasin"))
    world.step("LookUp")
    event = do(world, "ToggleObjectOn", tap)
    in_view = {sight.object_id for sight in observe(event).seen}
    assert observe(event, touched=[tap], known=[apple]).washed == {apple} | ({potato} & in_view)
    assert observe(event, known=[apple]).washed == frozenset()


def test_a_frame_is_rendered_only_when_it_is_asked_for(world):
    event = world.step("RotateRight")
    observation = observe(event)
    assert "frame" not in vars(event)
    assert (observation.render() == event.frame).all()


def test_observe_gives_what_is_held_apart_and_its_place_is_the_hand(world):
    apple = first(world, "Apple")
    observation = observe(do(world, "PickupObject", apple))
    assert observation.held.object_id == apple
    assert place_of(observation.held) == HAND
    assert apple not in {sight.object_id for sight in observation.seen}


def test_states_follow_the_flags(world):
    apple, fridge, faucet = (first(world, kind) for kind in ("Apple", "Fridge", "Faucet"))

    assert states(world, apple) == ()
    assert states(world, fridge) == ("closed",)
    assert states(world, faucet) == ("off",)
    do(world, "OpenObject", fridge)
    do(world, "ToggleObjectOn", faucet)
    assert states(world, fridge) == ("opened",)
    assert states(world, faucet) == ("on",)
    slices = observe(do(world, "SliceObject", apple), touched=[apple]).pieces
    assert slices
    assert all(sight.states == ("sliced",) for sight in slices)
    assert states(world, apple) == ("sliced",)


def test_washed_is_what_lies_in_the_basin_when_the_tap_is_turned_on(world):
    apple, potato, bowl = (first(world, kind) for kind in ("Apple", "Potato", "Bowl"))
    put(world, potato, bowl)
    put(world, bowl, first(world, "SinkBasin"))
    put(world, apple, first(world, "SinkBasin"))
    assert truth_of(world.last_event).washed == frozenset()
    event = do(world, "ToggleObjectOn", first(world, "Faucet"))
    assert {apple, potato, bowl} <= truth_of(event).washed
    assert first(world, "Bread") not in truth_of(event).washed
    assert not any("Sink" in object_id.split("|")[0] for object_id in truth_of(event).washed)


def test_washed_after_another_action_is_nothing(world):
    put(world, first(world, "Apple"), first(world, "SinkBasin"))
    do(world, "ToggleObjectOn", first(world, "Faucet"))
    assert truth_of(world.step("Pass")).washed == frozenset()
    refused = world.step("ToggleObjectOn", objectId=first(world, "Faucet"), forceAction=True)
    assert truth_of(refused).washed == frozenset()


def test_washed_slices_of_what_was_cut_in_the_sink(world):
    apple = first(world, "Apple")
    put(world, apple, first(world, "SinkBasin"))
    do(world, "SliceObject", apple)
    clean = truth_of(do(world, "ToggleObjectOn", first(world, "Faucet"))).washed
    assert sum(object_id.startswith(f"{apple}|") for object_id in clean) > 1
