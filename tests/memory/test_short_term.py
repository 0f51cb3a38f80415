"""Short-term memory keeps one merged line per object, in the lines its policy grants."""

import json
from dataclasses import replace
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.paths import GOLDEN

from karma import registry
from karma.contracts import MemoryUnit, State
from karma.errors import FileError
from karma.memory.policies import Fifo, FifoMerge, Lru, Unbounded
from karma.memory.short_term import MemoryStatistics, ShortTermMemory, merged_states
from karma.memory.wtinylfu import KarmaWTinyLfu

LISTING = GOLDEN / "listing1.json"
STATES = get_args(State)


def unit(name, **changes):
    fields = {"object_id": f"{name}|1", "object_type": name, "position_m": (0.0, 1.0, 2.0)}
    return MemoryUnit(**{**fields, **changes})


def pear_and_teapot():
    pear = unit(
        "Pear",
        object_id="Pear|+00.75|+00.90|-01.25",
        position_m=(0.75, 0.9, -1.25),
        states=("cleaned", "sliced"),
        place_id="Bowl|+00.75|+00.88|-01.25",
        handled=True,
        image="images/Pear.jpg",
    )
    position = (-2.0, 1.125, 0.5)
    return pear, unit("Teapot", object_id="Teapot|-02.00|+01.13|+00.50", position_m=position)


def test_remembering_again_overwrites_the_place_and_keeps_the_history():
    memory = ShortTermMemory(Lru(3))
    first = unit("Apple", states=("cleaned",), place_id="Sink|1", handled=True, image="a.jpg")
    memory.remember(first)
    memory.remember(replace(first, position_m=(5.0, 5.0, 5.0), states=("sliced",), place_id=None,
                            handled=False, image="b.jpg"))  # fmt: skip
    (apple,) = memory.units()
    assert apple.states == ("cleaned", "sliced")
    assert (apple.position_m, apple.place_id, apple.image) == ((5.0, 5.0, 5.0), None, "b.jpg")
    assert apple.handled


@pytest.mark.parametrize(
    "old, new, expected",
    [
        (("opened",), ("closed",), ("closed",)),
        (("cleaned", "sliced"), ("dirty",), ("sliced", "dirty")),
        (("on",), ("off", "on"), ("on",)),
        (("none",), ("heated",), ("heated",)),
        (("heated",), ("none",), ("heated",)),
        (("none",), (), ("none",)),
        (("heated",), ("heated",), ("heated",)),
    ],
)
def test_states_merge_into_a_history(old, new, expected):
    assert merged_states(old, new) == expected


@given(looks=st.lists(st.lists(st.sampled_from(STATES), max_size=4).map(tuple), max_size=6))
def test_history_is_a_set_without_opposites(looks):
    history = ()
    for look in looks:
        history = merged_states(history, look)
        assert len(set(history)) == len(history)
        for pair in ({"opened", "closed"}, {"on", "off"}, {"dirty", "cleaned"}):
            assert not pair <= set(history)
        assert "none" not in history or history == ("none",)
        assert not look or look[-1] in history or look[-1] == "none"


def test_first_look_is_cleaned_up_too():
    memory = ShortTermMemory(Lru(2))
    memory.remember(unit("Apple", states=("none", "dirty", "cleaned")))
    assert memory.units()[0].states == ("cleaned",)


@pytest.mark.parametrize("name", registry.names("policies"))
@given(touches=st.text("abcdef", max_size=30))
def test_lines_are_those_of_the_policy_by_last_touch(name, touches):
    memory = ShortTermMemory(POLICIES[name](3))
    for at, letter in enumerate(touches):
        memory.remember(unit(letter, position_m=(float(at), 0.0, 0.0)))
        assert len(memory) == len(memory.units()) <= memory.capacity
        ids = [line.object_id for line in memory.units()]
        assert set(ids) == set(memory._policy)
        last = [touches.rindex(line.object_type, 0, at + 1) for line in memory.units()]
        assert last == sorted(last) == [line.position_m[0] for line in memory.units()]


POLICIES = {name: registry.load("policies", name) for name in registry.names("policies")}


def test_refused_newcomer_is_returned_and_not_kept():
    memory = ShortTermMemory(KarmaWTinyLfu.with_segments(1, 1))
    for letter in "aabb":
        assert memory.remember(unit(letter)) is None
    assert memory.remember(unit("c")) == unit("c")
    assert [line.object_type for line in memory.units()] == ["a", "b"]
    assert memory.statistics.left == 1


def test_queries_count_and_change_nothing():
    memory = ShortTermMemory(Lru(2))
    memory.remember(unit("Apple", object_id="Apple|1"))
    memory.remember(unit("Apple", object_id="Apple|2"))
    before = memory.units()
    assert memory.query("Apple").object_id == "Apple|2"
    assert memory.query("Apple|1").object_id == "Apple|1"
    assert memory.query("Pear") is None
    assert memory.find("Pear") is None
    assert memory.units() == before
    memory.remember(unit("Pear"))
    assert "Apple|1" not in memory  # the query was no use
    assert memory.statistics == MemoryStatistics(queries=3, hits=2, remembered=3, left=1)
    assert memory.statistics.hit_rate == 2 / 3
    assert MemoryStatistics().hit_rate is None


def test_forgotten_unit_frees_its_line():
    memory = ShortTermMemory(Lru(2))
    for letter in "ab":
        memory.remember(unit(letter))
    assert memory.forget("a|1")
    assert not memory.forget("a|1")
    assert memory.remember(unit("c")) is None
    assert [line.object_type for line in memory.units()] == ["b", "c"]


class Stubborn:
    """A policy that cannot free a line on request."""

    capacity = 2

    def __init__(self):
        self.lru = Lru(2)

    def touch(self, key):
        return self.lru.touch(key)

    def __contains__(self, key):
        return key in self.lru

    def __len__(self):
        return len(self.lru)

    def __iter__(self):
        return iter(self.lru)


def test_forgotten_unit_of_a_policy_without_discard_stays_forgotten():
    memory = ShortTermMemory(Stubborn())
    for letter in "ab":
        memory.remember(unit(letter))
    memory.forget("a|1")
    assert memory.remember(unit("c")) is None  # the reserved line of "a" left
    assert [line.object_type for line in memory.units()] == ["b", "c"]


def test_cleared_memory_is_as_new():
    memory = ShortTermMemory(Fifo(2))
    for letter in "abc":
        memory.remember(unit(letter))
    memory.query("a")
    memory.clear()
    assert (memory.units(), memory.statistics) == ((), MemoryStatistics())
    for letter in "ab":
        assert memory.remember(unit(letter)) is None


def test_plain_queue_with_duplicates_keeps_the_lines_it_still_has():
    memory = ShortTermMemory(Fifo(3))
    for letter in "aab":
        memory.remember(unit(letter))
    assert memory.remember(unit("c")) is None  # the first of two copies of "a"
    assert memory.remember(unit("d")).object_type == "a"
    assert [line.object_type for line in memory.units()] == ["b", "c", "d"]


def test_json_has_the_form_of_listing_1():
    memory = ShortTermMemory(FifoMerge(10))
    for line in pear_and_teapot():
        memory.remember(line)
    assert memory.to_json() + "\n" == LISTING.read_text()


def test_json_restores_the_units():
    memory = ShortTermMemory.from_json(LISTING.read_bytes(), Lru(10))
    assert memory.units() == pear_and_teapot()
    assert memory.statistics == MemoryStatistics()


def test_json_of_the_paper_needs_no_more_than_its_four_keys():
    line = {
        "objectType": "Pear",
        "position": {"x": 1, "y": 2, "z": 3},
        "objectId": "Pear|1",
        "imagePath": "images/Pear.jpg",
    }
    (pear,) = ShortTermMemory.from_json(json.dumps([line, line]), Lru(10)).units()
    assert pear == unit("Pear", position_m=(1.0, 2.0, 3.0), image="images/Pear.jpg")


UNITS = st.lists(
    st.builds(
        MemoryUnit,
        object_id=st.text(max_size=3),
        object_type=st.sampled_from(["Apple", "Pear"]),
        position_m=st.tuples(*[st.floats(-9, 9)] * 3),
        states=st.lists(st.sampled_from(STATES), max_size=3).map(tuple),
        place_id=st.none() | st.text(max_size=3),
        handled=st.booleans(),
        image=st.none() | st.text(max_size=3),
    ),
    max_size=6,
)


@given(units=UNITS)
def test_json_round_trip_loses_no_unit(units):
    memory = ShortTermMemory(Unbounded())
    for line in units:
        memory.remember(line)
    again = ShortTermMemory.from_json(memory.to_json(), Unbounded())
    assert again.units() == memory.units()


@pytest.mark.parametrize("text", ["[", '[{"objectType": "Pear"}]', '{"a": 1}'])
def test_json_that_does_not_fit_names_its_file(text):
    with pytest.raises(FileError, match=r"run/memory\.json"):
        ShortTermMemory.from_json(text, Lru(3), path="run/memory.json")


def test_json_with_an_unknown_key_is_refused():
    text = LISTING.read_text().replace('"handled"', '"touched"')
    with pytest.raises(FileError, match="touched"):
        ShortTermMemory.from_json(text, Lru(3))
