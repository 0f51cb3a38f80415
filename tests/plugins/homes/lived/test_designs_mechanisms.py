"""The mechanism of each foreign design, held against the plainest way to say what it does."""

import os
import subprocess
import sys
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma.memory.policies import make_policy
from karma.plugins.homes.lived.designs import CAPTIONS, DESIGNS, query_text
from karma.plugins.homes.memory.setting import sighting_text
from tests.support.lived import PLACES, LetterEmbedder, made, moment, put, seen, where
from tests.support.paths import ROOT

KINDS = ("Mug", "Book", "Apple")
FOREIGN = [name for name in DESIGNS if not name.startswith("ours")]
OPEN_ENDED = 10_000  # facts: all there are


def told(name, moments, question, k=OPEN_ENDED, **given_setting):
    memory = made(name, **given_setting)
    for one in moments:
        memory.take_in(one)
    return list(memory.recall(question, k))


@st.composite
def rounds(draw, most=20):
    """Draw moments a minute apart, of up to four things in view, nobody doing anything."""
    found = []
    for number in range(draw(st.integers(1, most))):
        ids = draw(st.lists(st.sampled_from(range(6)), max_size=4, unique=True))
        sights = [
            seen(f"{KINDS[n % 3]}|{n}", draw(st.sampled_from(list(PLACES))), 60.0 * number,
                 draw(st.sampled_from(((), ("dirty",)))))
            for n in ids
        ]  # fmt: skip
        found.append(moment(60.0 * number, *sights))
    return found


def sights_of(moments):
    return [one for each in moments for one in each.seen]


def cosine(sighting, question):
    """Return the nearness of a sighting's words to the question, by one pair of texts."""
    rows = LetterEmbedder().embed([sighting_text(sighting, PLACES), query_text(question)])
    return float(rows[0] @ rows[1])


def shown(facts):
    return [fact.sighting for fact in facts]


def falls(values):
    return all(a >= b - 1e-6 for a, b in pairwise(values))


QUESTION = where("Mug", 1e6)


# ----------------------------------------------------------------- all of them


@pytest.mark.parametrize("name", FOREIGN)
@settings(max_examples=20, deadline=None)
@given(moments=rounds())
def test_to_ask_changes_nothing_and_fewer_facts_are_the_first_of_more(name, moments):
    memory = made(name)
    for one in moments:
        memory.take_in(one)
    size, more = memory.size_bytes(), list(memory.recall(QUESTION, 9))
    for k in range(1, 9):
        assert list(memory.recall(QUESTION, k)) == more[:k]
    assert memory.size_bytes() == size


@pytest.mark.parametrize("name", FOREIGN)
def test_no_foreign_design_has_chances_or_an_order_of_places(name):
    memory = made(name)
    for one in (put("Mug|1", "Desk|1", 1.0), moment(2.0, seen("Book|1", "Shelf|1", 2.0))):
        memory.take_in(one)
    assert all(fact.holds is None for fact in memory.recall(QUESTION, 9))
    assert list(memory.likely_places(QUESTION)) == []


HASHED = """
from tests.plugins.homes.lived.test_designs_mechanisms import *
moments = [put(f"{KINDS[n % 3]}|{n % 7}", list(PLACES)[n * n % 5], 60.0 * n) for n in range(60)]
for name in DESIGNS:
    print(name, shown(told(name, moments, QUESTION)))
"""


def test_what_is_told_does_not_hang_on_the_seed_of_hashes():
    outputs = [
        subprocess.run(
            [sys.executable, "-c", HASHED], capture_output=True, text=True, check=True, cwd=ROOT,
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)},
        ).stdout
        for seed in ("1", "2")
    ]  # fmt: skip
    assert outputs[0] == outputs[1]
    assert len(outputs[0].splitlines()) == len(DESIGNS)


# ----------------------------------------------------------------- append-only


@settings(max_examples=40, deadline=None)
@given(moments=rounds())
def test_append_only_ranks_every_row_by_cosine_and_the_newest_of_equal_texts_first(moments):
    found = shown(told("append-only", moments, QUESTION))
    assert sorted(map(repr, found)) == sorted(map(repr, sights_of(moments)))
    assert falls([cosine(one, QUESTION) for one in found])
    for a, b in pairwise(found):
        if sighting_text(a, PLACES) == sighting_text(b, PLACES):
            assert a.time_s >= b.time_s


# ----------------------------------------------------------------- mem0


@settings(max_examples=40, deadline=None)
@given(moments=rounds())
def test_mem0_keeps_one_fact_a_thing_from_when_it_last_changed(moments):
    kept = {}
    for one in sights_of(moments):
        old = kept.get(one.object_id)
        if old is None or (old.place_id, old.states) != (one.place_id, one.states):
            kept[one.object_id] = one
    found = shown(told("mem0", moments, QUESTION))
    assert {one.object_id: one for one in found} == kept
    assert len(found) == len(kept)
    assert falls([cosine(one, QUESTION) for one in found])


# ----------------------------------------------------------------- temporal graph


def intervals(moments):
    """Return (thing, place, states, from, to) of each unbroken run of equal sightings."""
    edges, current = [], {}
    for one in sights_of(moments):
        said = (one.object_id, one.place_id, one.states)
        if one.object_id in current and edges[current[one.object_id]][0] == said:
            continue
        if one.object_id in current:
            edges[current[one.object_id]][2] = one.time_s
        current[one.object_id] = len(edges)
        edges.append([said, one.time_s, float("inf")])
    return edges


@settings(max_examples=60, deadline=None)
@given(moments=rounds(), window=st.tuples(st.integers(0, 20), st.integers(0, 20)))
def test_the_graph_tells_the_edges_whose_interval_meets_the_time_that_was_said(moments, window):
    after, before = 60.0 * min(window), 60.0 * max(window)
    found = shown(
        told("temporal-graph", moments, where("Mug", 1e6, after_s=after, before_s=before))
    )
    wanted = [(said, start) for said, start, end in intervals(moments)
              if start <= before and end > after]  # fmt: skip
    got = [((one.object_id, one.place_id, one.states), one.time_s) for one in found]
    assert sorted(got) == sorted(wanted)


@settings(max_examples=30, deadline=None)
@given(moments=rounds())
def test_of_now_the_graph_tells_only_edges_that_have_not_ended(moments):
    found = told("temporal-graph", moments, QUESTION)
    wanted = [said for said, _, end in intervals(moments) if end == float("inf")]
    got = [(one.object_id, one.place_id, one.states) for one in shown(found)]
    assert sorted(got) == sorted(wanted)


# ----------------------------------------------------------------- ReMEmbR


def hourly(odd=None):
    """Return the same mug on the desk at each of 40 hours, or at one of them elsewhere."""
    return [
        moment(3600.0 * hour, seen("Mug|1", "CoffeeTable|1" if hour == odd else "Desk|1", time_s))
        for hour, time_s in ((hour, 3600.0 * hour) for hour in range(40))
    ]


@pytest.mark.parametrize("hour", [3, 11, 29])
def test_only_the_search_by_time_finds_one_hour_of_equal_views(hour):
    span = {"after_s": 3600.0 * hour - 60, "before_s": 3600.0 * hour + 60}
    timed = [one.time_s for one in shown(told("remembr", hourly(), where("Mug", 2e5, **span)))]
    untimed = [one.time_s for one in shown(told("remembr", hourly(), where("Mug", 2e5)))]
    assert 3600.0 * hour in timed
    assert untimed == [3600.0 * late for late in range(39, 39 - CAPTIONS, -1)]


def test_the_search_by_place_finds_a_room_that_the_text_does_not():
    near = shown(told("remembr", hourly(odd=4), where("Mug", 2e5)))
    there = shown(told("remembr", hourly(odd=4), where("Mug", 2e5, room="living")))
    assert "CoffeeTable|1" not in [one.place_id for one in near]
    assert "CoffeeTable|1" in [one.place_id for one in there]


# ----------------------------------------------------------------- MemGPT


@settings(max_examples=40, deadline=None)
@given(moments=rounds(), units=st.integers(1, 5))
def test_memgpt_tells_its_context_first_then_the_archive(moments, units):
    found = shown(told("memgpt", moments, QUESTION, units=units))
    last = {}
    for one in sights_of(moments):
        last.pop(one.object_id, None)  # the order of the last sightings, not of the first
        last[one.object_id] = one
    context = list(last.values())[-units:]
    head, archive = found[: len(context)], found[len(context) :]
    assert {one.object_id: one for one in head} == {one.object_id: one for one in context}
    assert falls([cosine(one, QUESTION) for one in head])
    assert falls([cosine(one, QUESTION) for one in archive])
    words = {(one.object_id, sighting_text(one, PLACES)) for one in sights_of(moments)}
    assert {(one.object_id, sighting_text(one, PLACES)) for one in found} == words


# ----------------------------------------------------------------- KARMA's units


@pytest.mark.parametrize(
    ("name", "policy"),
    [
        ("karma-fifo", "fifo-merge[{0}]"),
        ("karma-lru", "lru[{0}]"),
        ("karma-wtinylfu", "wtinylfu-karma[{1},1]"),
    ],
)
@settings(max_examples=40, deadline=None)
@given(handled=st.lists(st.sampled_from(range(9)), max_size=40), units=st.integers(2, 5))
def test_units_are_what_the_policy_keeps_of_what_was_handled(name, policy, handled, units):
    keys, moments = make_policy(policy.format(units, units - 1)), []
    for time_s, number in enumerate(handled):
        keys.touch(f"Mug|{number}")
        moments.append(put(f"Mug|{number}", "Desk|1", float(time_s)))
        moments.append(moment(float(time_s), seen("Book|1", "Shelf|1", float(time_s))))
    memory, single = made(name, units=units), made(name, units=units)
    for one in moments:
        memory.take_in(one)
    single.take_in(put("Mug|0", "Desk|1", 0.0))
    found = [one.object_id for one in shown(memory.recall(QUESTION, OPEN_ENDED))]
    assert sorted(found) == sorted(keys)
    assert memory.size_bytes() == len(keys) * single.size_bytes()


@pytest.mark.parametrize("name", ["karma-fifo", "karma-lru", "karma-wtinylfu"])
def test_a_unit_that_became_false_stays(name):
    moments = [put("Mug|1", "CounterTop|1", 1.0), moment(2.0, looked_over=("CounterTop|1",)),
               moment(3.0, seen("Mug|1", "Desk|1", 3.0))]  # fmt: skip
    assert [one.place_id for one in shown(told(name, moments, QUESTION))] == ["CounterTop|1"]


# ----------------------------------------------------------------- controls


@settings(max_examples=30, deadline=None)
@given(moments=rounds())
def test_last_seen_is_a_dictionary_of_the_things_of_the_type(moments):
    last = {one.object_id: one for one in sights_of(moments) if one.object_type == "Mug"}
    found = shown(told("last-seen", moments, QUESTION))
    assert {one.object_id: one for one in found} == last
    assert [one.time_s for one in found] == sorted((one.time_s for one in found), reverse=True)
