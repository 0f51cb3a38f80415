"""Short-term memory is never dearer than none: a few of the sequences that are measured."""

import pytest
from support.errand_sequences import (
    KINDS,
    Drawn,
    cheaper,
    done,
    drawn,
    explained,
    given_planner,
    put,
)

NUMBERS = (7, 14, 17, 21, 24, 32, 36, 50, 107, 113, 117, 140)  # of few rooms, and short
KEPT = (17, 36, 107)
ROWS = ("memory", "map only")


@pytest.fixture(scope="module")
def resources(tmp_path_factory):
    return given_planner(tmp_path_factory.mktemp("maps"))


@pytest.fixture(scope="module")
def found(resources):
    """What each sequence cost with short-term memory and without."""
    return {n: [done(drawn(n), row, resources) for row in ROWS] for n in NUMBERS}


def sums(costs):
    return sum(one.places for one in costs), sum(one.steps for one in costs)


def test_sequences_are_of_every_kind():
    assert {drawn(number).kind for number in NUMBERS} == set(KINDS)


@pytest.mark.parametrize("number", NUMBERS)
def test_memory_costs_nothing_but_ways(found, number):
    """No wrong belief and no longer search make a sequence dearer, only the way onward."""
    mine, others = found[number]
    assert [one.right for one in mine] == [one.right for one in others]
    assert sums(mine)[0] <= sums(others)[0]
    assert cheaper(mine, others) >= 0 or explained(mine, others)


def test_memory_saves_places_and_steps(found):
    sides = [cheaper(mine, others) for mine, others in found.values()]
    assert sides.count(-1) <= 5, "all in small bathrooms, by a few steps"
    mine, others = (sums([c for rows in found.values() for c in rows[n]]) for n in (0, 1))
    assert mine[0] < 0.8 * others[0]
    assert mine[1] < 0.8 * others[1]


@pytest.mark.parametrize("number", KEPT)
def test_memory_kept_in_a_home_costs_the_same(resources, found, number):
    kept = done(drawn(number), "home", resources)
    assert [sums([one]) for one in kept] == [sums([one]) for one in found[number][0]]
    assert [one.right for one in kept] == [one.right for one in found[number][0]]


def test_more_searching_is_dearer_and_not_explained(found):
    """The measure itself, with the rows changed over."""
    mine, others = found[32]
    assert cheaper(mine, others) > 0 > cheaper(others, mine)
    assert not explained(others, mine)


def test_what_was_shut_in_a_safe_is_fetched(resources):
    """AI2-THOR lets things into a closed safe: it says of it only that it can be opened."""
    errands = (put("CellPhone", "Safe"), put("CellPhone", "Shelf"))
    sequence = Drawn(number=0, scene="bedroom_1", kind="shut away", errands=errands)
    _, fetched = done(sequence, "memory", resources)
    assert fetched.right
    assert (fetched.refused, fetched.places) == (0, 1)
