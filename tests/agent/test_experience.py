"""From sights to the units of short-term memory."""

import pytest
from support.experiences import experience

from karma.agent.experience import unit_of, units_of
from karma.household.places import HAND
from karma.models.scripted import MetadataVision
from karma.types.memory import MemoryUnit
from karma.types.observation import SeenObject


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
    unit = unit_of(sight(*parents), ("cleaned",), handled=True, image=None)
    assert unit.place_id == place


def test_unit_keeps_states_in_order_once_and_without_none():
    states = ("sliced", "none", "cleaned", "sliced")
    assert unit_of(sight(), states, handled=False, image="images/Apple.png") == MemoryUnit(
        object_id="Apple|1", object_type="Apple", position_m=(1.0, 2.0, 3.0),
        states=("sliced", "cleaned"), handled=False, image="images/Apple.png",
    )  # fmt: skip


def units(told, *before, seen_kept=0):
    return units_of(told, before, MetadataVision(), "go", scene="kitchen", seen_kept=seen_kept)


def thing(object_id, *states, pickupable=True):
    at = (1.0, 1.0, 1.0)
    return SeenObject(
        object_id=object_id, object_type=object_id.rpartition("|")[2].partition("_")[0],
        position_m=at, box_center_m=at, box_size_m=at, pickupable=pickupable, states=states,
    )  # fmt: skip


MUG, SPOON, TABLE = thing("Mug"), thing("Spoon"), thing("Table", pickupable=False)


def test_what_was_handled_comes_last_by_last_use_and_furniture_never():
    told = experience(MUG, SPOON, TABLE, handled=("Mug", "Table", "Spoon", "Mug"))
    assert [unit.object_id for unit in units(told, seen_kept=2)] == ["Spoon", "Mug"]
    told = experience(MUG, SPOON, TABLE, handled=("Mug",))
    assert [unit.object_id for unit in units(told, seen_kept=2)] == ["Spoon", "Mug"]


def test_a_slice_stands_for_the_whole_that_was_cut_and_inherits_its_history():
    slices = [thing(f"Apple|1|1|1|AppleSliced_{number}", "sliced") for number in (1, 2)]
    told = experience(*slices, handled=("Apple|1|1|1",), cut=["Apple|1|1|1"])
    whole = MemoryUnit(
        object_id="Apple|1|1|1", object_type="Apple", position_m=(0, 0, 0), states=("cleaned",)
    )
    (unit,) = units(told, whole)
    assert unit.object_id in {one.object_id for one in slices}
    assert unit.states == ("cleaned", "sliced")
    assert told.gone == {"Apple|1|1|1"}


def test_what_was_missed_is_gone_unless_it_was_seen_again():
    assert experience(MUG, missed=["Mug", "Pot"]).gone == {"Pot"}
