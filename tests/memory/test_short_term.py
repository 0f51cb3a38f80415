"""Short-term memory keeps one merged line per object, in the lines its policy grants."""

from dataclasses import replace
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma import registry
from karma.memory.policies import Fifo, Lru
from karma.memory.short_term import ShortTermMemory, merged_states
from karma.types.memory import MemoryUnit
from karma.types.observation import State

STATES = get_args(State)


def unit(name, **changes):
    fields = {"object_id": f"{name}|1", "object_type": name, "position_m": (0.0, 1.0, 2.0)}
    return MemoryUnit(**{**fields, **changes})


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


def test_forgotten_unit_frees_its_line():
    memory = ShortTermMemory(Lru(2))
    for letter in "ab":
        memory.remember(unit(letter))
    assert memory.forget("a|1")
    assert not memory.forget("a|1")
    assert memory.remember(unit("c")) is None
    assert [line.object_type for line in memory.units()] == ["b", "c"]


def test_plain_queue_with_duplicates_keeps_the_lines_it_still_has():
    memory = ShortTermMemory(Fifo(3))
    for letter in "aab":
        memory.remember(unit(letter))
    assert memory.remember(unit("c")) is None  # the first of two copies of "a"
    assert memory.remember(unit("d")).object_type == "a"
    assert [line.object_type for line in memory.units()] == ["b", "c", "d"]
