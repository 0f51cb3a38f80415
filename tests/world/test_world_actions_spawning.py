"""Objects in places drawn by lot."""

import pytest
from support.household import find, kitchen, reach

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


def test_spawn_moves_only_what_it_is_told_to(world):
    before = world.state.objects
    apple, bowl = find(world, "Apple"), find(world, "Bowl")
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


def test_spawn_empties_the_hand(world):
    world.step("PickupObject", objectId=reach(world, "Apple"))
    assert world.step("InitialRandomSpawn", randomSeed=1)
    assert world.last_event.metadata["inventoryObjects"] == []
