"""Every design of a home's memory, by one contract; then what makes each what it is."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma.plugins.homes.lived.designs import DESIGNS
from tests.support.lived import PLACES, made, moment, put, seen, where

KINDS = ("Mug", "Book", "Apple")
EVERY = pytest.mark.parametrize("name", list(DESIGNS))
SHORT = ("none", "karma-fifo", "karma-lru", "karma-wtinylfu")  # may not know what was only seen


@st.composite
def lives(draw):
    """Draw moments in the order of their times."""
    found, time_s = [], 0.0
    for _ in range(draw(st.integers(0, 25))):
        time_s += draw(st.floats(1.0, 20_000.0))
        ids = draw(st.lists(st.sampled_from(range(6)), max_size=4, unique=True))
        sights = [
            seen(f"{KINDS[n % 3]}|{n}", draw(st.sampled_from(list(PLACES))), time_s,
                 draw(st.sampled_from(((), ("dirty",)))))
            for n in ids
        ]  # fmt: skip
        places = draw(st.lists(st.sampled_from(list(PLACES)), max_size=2, unique=True))
        if sights and draw(st.booleans()):
            who = draw(st.sampled_from(("Ann", "robot")))
            one = put(sights[0].object_id, sights[0].place_id, time_s, who)
            found.append(replace(one, seen=(sights[0],)))
        else:
            found.append(moment(time_s, *sights, looked_over=places))
    return found


@EVERY
@settings(max_examples=25, deadline=None)
@given(moments=lives(), k=st.integers(1, 12))
def test_facts_are_of_what_was_seen_and_the_same_again(name, moments, k):
    told = []
    for _ in range(2):
        memory = made(name)
        for one in moments:
            memory.take_in(one)
        now_s = (moments[-1].time_s if moments else 0.0) + 10.0
        facts = list(memory.recall(where("Mug", now_s), k))
        places = list(memory.likely_places(where("Mug", now_s)))
        told.append((facts, places, memory.size_bytes()))
        memory.close()
    assert told[0] == told[1]
    facts, places, size = told[0]
    sights = {one for each in moments for one in each.seen}
    known = {(one.object_id, one.place_id, one.states) for one in sights}
    assert len(facts) <= k
    for fact in facts:
        found = fact.sighting
        assert (found.object_id, found.place_id, found.states) in known
        assert fact.holds is None or 0.0 <= fact.holds <= 1.0
    assert math.fsum(one.chance for one in places) <= 1.0 + 1e-9
    assert all(one.place_id in PLACES and one.chance >= 0.0 for one in places)
    assert size >= 0


@EVERY
def test_an_empty_memory_knows_nothing(name):
    assert list(made(name).recall(where("Mug", 10.0), 5)) == []


@pytest.mark.parametrize("name", [name for name in DESIGNS if name not in SHORT])
def test_what_was_just_seen_is_told(name):
    memory = made(name)
    memory.take_in(moment(1.0, seen("Mug|1", "CounterTop|1", 1.0)))
    memory.take_in(moment(2.0, seen("Book|1", "Desk|1", 2.0)))
    best = memory.recall(where("Mug", 3.0), 1)[0]
    assert (best.sighting.object_id, best.sighting.place_id) == ("Mug|1", "CounterTop|1")


def moved(name, *, missed=False):
    """Return a memory that saw a mug at the counter, and then not, or on the desk."""
    memory = made(name)
    memory.take_in(put("Mug|1", "CounterTop|1", 1.0))
    missing = moment(90_000.0, looked_over=("CounterTop|1",))
    memory.take_in(missing if missed else put("Mug|1", "Desk|1", 90_000.0))
    return memory


def places_told(memory, time_s=90_001.0, **said):
    return [fact.sighting.place_id for fact in memory.recall(where("Mug", time_s, **said), 9)
            if fact.ended_s is None]  # fmt: skip


@pytest.mark.parametrize(
    "name",
    ["mem0", "temporal-graph", "last-seen", "ours", "karma-fifo", "karma-lru", "karma-wtinylfu"],
)
def test_an_update_replaces_the_old_place(name):
    assert places_told(moved(name)) == ["Desk|1"]


@pytest.mark.parametrize("name", ["append-only", "mem0", "temporal-graph", "last-seen",
                                  "karma-fifo", "memgpt", "remembr"])  # fmt: skip
def test_foreign_designs_keep_what_is_no_more_there(name):
    assert "CounterTop|1" in places_told(moved(name, missed=True))


def test_ten_units_are_ten_things():
    memory = made("ours-units", units=3)
    for number in range(9):
        memory.take_in(put(f"Mug|{number}", "Desk|1", float(number)))
    assert len(memory.recall(where("Mug", 20.0), 20)) == 3


@pytest.mark.parametrize("name", ["ours", "ours-units"])
def test_ours_evicts_what_is_no_more_there(name):
    assert places_told(moved(name, missed=True)) == []


@pytest.mark.parametrize("name", ["temporal-graph", "ours", "append-only"])
def test_the_past_is_told_where_a_design_keeps_it(name):
    told = places_told(moved(name), after_s=0.0, before_s=80_000.0)
    assert "CounterTop|1" in told


def test_a_question_for_another_time_changes_nothing():
    memory = moved("ours")
    before = memory.recall(where("Mug", 90_001.0), 5)
    memory.recall(replace(where("Mug", 90_001.0), asked="who"), 5)
    assert memory.recall(where("Mug", 90_001.0), 5) == before
