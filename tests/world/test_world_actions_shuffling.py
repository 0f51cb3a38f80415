"""Objects in places and states drawn by lot, and states given to many at once."""

import pytest
from support.household import find, kitchen, look, reach

from karma.household.types import object_types
from karma.world.sim import EmbeddedWorld


@pytest.fixture
def world():
    return EmbeddedWorld(kitchen())


# ----------------------------------------------------------------- by lot


def test_spawn_keeps_every_id_and_puts_things_where_their_type_may_be(world):
    before = world.state.objects
    assert world.step("InitialRandomSpawn", randomSeed=7)
    after = world.state.objects
    assert list(after) == list(before)
    moved = [i for i in before if after[i].center != before[i].center]
    assert len(moved) >= 8
    for object_id in moved:
        if "pickupable" in after[object_id].capabilities and after[object_id].parents:
            kind, holder = after[object_id].type, after[after[object_id].parents[0]].type
            same = after[object_id].parents[0] in before[object_id].parents
            assert same or object_types()[kind].fits(object_types()[holder])
    assert all(before[i] == after[i] for i in before if "pickupable" not in before[i].capabilities)


def test_spawn_depends_on_the_seed_alone():
    def run(seed, **arguments):
        world = EmbeddedWorld(kitchen())
        world.step("InitialRandomSpawn", randomSeed=seed, **arguments)
        return dict(world.state.objects)

    assert run(1) == run(1)
    assert run(1) != run(2)
    world = EmbeddedWorld(kitchen())
    world.step("SetRandomSeed", seed=2)
    world.step("InitialRandomSpawn")
    assert dict(world.state.objects) == run(2)


def test_spawn_spares_what_it_is_told_to_spare(world):
    before = world.state.objects
    apple, bowl = find(world, "Apple"), find(world, "Bowl")
    world.step("InitialRandomSpawn", randomSeed=5, excludedObjectIds=[apple])
    assert world.state.objects[apple] == before[apple]
    world.reset(kitchen())
    world.step("InitialRandomSpawn", randomSeed=5, objectIds=[apple, bowl])
    changed = {i for i in before if world.state.objects[i] != before[i]}
    assert changed <= {apple, bowl}


def test_spawn_uses_only_the_receptacles_it_may(world):
    counter, fridge = find(world, "CounterTop"), find(world, "Fridge")
    before = world.state.objects
    world.step("InitialRandomSpawn", randomSeed=1, receptacleObjectIds=[counter])
    after = world.state.objects
    for object_id in before:
        if after[object_id].center != before[object_id].center:
            assert counter in after[object_id].parents
    world.reset(kitchen())
    world.step("InitialRandomSpawn", randomSeed=1, forceVisible=True)
    assert not [i for i, t in world.state.objects.items() if fridge in t.parents
                and fridge not in before[i].parents]  # fmt: skip
    assert "positive" in world.step("InitialRandomSpawn", numPlacementAttempts=0).message


def test_spawn_makes_copies_up_to_the_count_asked_for(world):
    wanted = [{"objectType": "Apple", "count": 4}, {"objectType": "Yacht", "count": 2}]
    assert world.step("InitialRandomSpawn", randomSeed=1, numDuplicatesOfType=wanted)
    apples = world.last_event.objects_by_type("Apple")
    assert len(apples) == len({one["objectId"] for one in apples}) == 4
    assert all(one["parentReceptacles"] for one in apples)


def test_spawn_empties_the_hand(world):
    world.step("PickupObject", objectId=reach(world, "Apple"))
    assert world.step("InitialRandomSpawn", randomSeed=1)
    assert world.last_event.metadata["inventoryObjects"] == []


def test_random_states_follow_the_seed_and_keep_the_microwave_s_rule(world):
    def flags(seed):
        world.reset(kitchen())
        assert world.step("RandomToggleStateOfAllObjects", randomSeed=seed)
        return {i: (t.openness, t.is_toggled, t.is_dirty, t.is_filled, t.is_broken, t.is_sliced)
                for i, t in world.state.objects.items()}  # fmt: skip

    assert flags(1) == flags(1) != flags(2)
    for seed in range(20):
        state = flags(seed)
        opened, on, *_ = state[find(world, "Microwave")]
        assert not (on and opened)
        assert not any(one[4] or one[5] for one in state.values())


def test_random_specific_state_changes_no_other(world):
    before = world.state.objects
    assert world.step("RandomToggleSpecificState", randomSeed=1, StateChange="CanBreak")
    after = world.state.objects
    broken = [i for i in before if after[i].is_broken]
    assert 0 < len(broken) < len([1 for t in before.values() if "breakable" in t.capabilities])
    assert "StateChange" in world.step("RandomToggleSpecificState", StateChange="CanSing").message


# ----------------------------------------------------------------- states of many


@pytest.mark.parametrize(
    ("change", "flag"),
    [
        ("openable", "isOpen"), ("toggleable", "isToggled"), ("breakable", "isBroken"),
        ("canFillWithLiquid", "isFilledWithLiquid"), ("dirtyable", "isDirty"),
        ("cookable", "isCooked"), ("sliceable", "isSliced"), ("canBeUsedUp", "isUsedUp"),
    ],
)  # fmt: skip
def test_state_is_given_to_all_that_can_have_it(world, change, flag):
    able = [o["objectId"] for o in world.last_event.metadata["objects"] if o[change]]
    assert able
    event = world.step("SetObjectStates", SetObjectStates={"stateChange": change, flag: True})
    assert event, event.message
    assert all(look(world, object_id)[flag] for object_id in able)


def test_state_is_given_to_one_type_and_taken_back(world):
    fridge, drawer = find(world, "Fridge"), find(world, "Drawer")
    ask = {"objectType": "Fridge", "stateChange": "openable"}
    world.step("SetObjectStates", SetObjectStates={**ask, "isOpen": True})
    assert look(world, fridge)["isOpen"]
    assert not look(world, drawer)["isOpen"]
    world.step("SetObjectStates", SetObjectStates={**ask, "isOpen": False})
    assert not look(world, fridge)["isOpen"]


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"stateChange": "danceable", "isOpen": True}, "stateChange must be one of"),
        ({"stateChange": "openable", "isToggled": True}, "needs isOpen"),
        ({"stateChange": "openable", "isOpen": True, "objectType": "Yacht"}, "No object of type"),
        ({}, "stateChange must be one of"),
    ],
)
def test_states_that_make_no_sense_are_refused(world, asked, message):
    assert message in world.step("SetObjectStates", SetObjectStates=asked).message


def test_what_cannot_be_undone_is_not(world):
    world.step("BreakObject", objectId=find(world, "Plate"), forceAction=True)
    asked = {"stateChange": "breakable", "isBroken": False}
    assert "cannot be undone" in world.step("SetObjectStates", SetObjectStates=asked).message
