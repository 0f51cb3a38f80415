"""What sinks through a basin without a floor: told from a first event, and how it comes down."""

import pytest
from msgspec.structs import replace
from support.household import find, kitchen, look, thing

from karma.plugins.thor_tools.importing.scenes import import_dump
from karma.plugins.thor_tools.recorded import with_falling
from karma.world.core.thing import moved
from karma.world.sim import EmbeddedWorld

BASIN = next(one for one in kitchen().objects if one.type == "SinkBasin")  # its bottom at 0.78
UNDER = thing("Cabinet", (0.0, 0.42, 1.15), (0.6, 0.8, 0.5), suffix="|under")


def sponge(made=0.79, sunk=0.012, **state):
    """A sponge that was made at a height in the basin and has sunk since."""
    one = thing("DishSponge", (0.0, made, 1.15), (0.1, 0.02, 0.06), parents=(BASIN.id,), **state)
    return moved(one, (0.0, -sunk, 0.0))


def falling(*things):
    return [one.id for one in with_falling((BASIN, *things)) if one.is_falling]


def world(*extra):
    return EmbeddedWorld(kitchen((replace(sponge(), parents=(), is_falling=True), *extra)))


def test_what_has_sunk_below_the_basin_that_it_was_made_in_is_falling():
    (found,) = falling(sponge())
    assert found.startswith("DishSponge")
    by_id = {one.id: one for one in with_falling((BASIN, sponge()))}
    assert by_id[found].parents == ()
    assert falling(replace(sponge(sunk=0.3), parents=())) == [found]  # it has left it


@pytest.mark.parametrize(
    "rests",
    [
        sponge(sunk=0.004),  # an id is rounded
        sponge(made=0.83),  # it comes to rest above the floor of the basin
        moved(sponge(made=0.77, sunk=0.0), (0.0, 0.003, 0.0)),  # a basin deeper than its box
        replace(sponge(), parents=("Cabinet|+00.00|+00.42|+01.15",)),
        replace(sponge(sunk=0.3), parents=(), id="DishSponge|surface|1|2"),
        replace(sponge(made=0.4, sunk=0.05), parents=()),  # it was made below
        moved(replace(sponge(), parents=()), (0.5, 0.0, 0.0)),
    ],
)
def test_what_rests_in_or_under_a_basin_is_not_falling(rests):
    assert falling(rests) == []


@pytest.mark.shared
def test_what_sinks_in_recorded_rooms_sinks_through_five_basins_with_all_that_is_in_them(shared):
    found = {}
    for scene in import_dump(shared / "data/thor5/scenes.jsonl.gz"):
        for one in with_falling(scene.objects):
            if one.is_falling:
                found.setdefault(scene.name, []).append(
                    float(one.id.split("|")[2]) - one.position[1]
                )
    assert sorted(found) == [f"FloorPlan{number}" for number in (1, 17, 20, 22, 5)]
    assert all(max(sunk) - min(sunk) < 0.05 for sunk in found.values())


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
