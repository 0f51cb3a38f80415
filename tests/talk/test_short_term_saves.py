"""Short-term memory is never dearer than none: a tenth of the sequences that are measured."""

import sys
from importlib.util import module_from_spec, spec_from_file_location

import pytest
from support.paths import ROOT

NUMBERS = (
    2, 7, 14, 17, 21, 24, 26, 32, 36, 46, 49, 50, 102, 107, 113, 117, 120, 140, 149, 152,
)  # of few rooms, and short  # fmt: skip
KEPT = (17, 36, 107)
ROWS = ("memory", "map only")


@pytest.fixture(scope="module")
def measure(tmp_path_factory):
    spec = spec_from_file_location("measure_short_term", ROOT / "scripts/measure_short_term.py")
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    module.MAPS = tmp_path_factory.mktemp("maps")
    return module


@pytest.fixture(scope="module")
def resources(measure):
    return measure.given_planner()


@pytest.fixture(scope="module")
def found(measure, resources):
    """What each sequence cost with short-term memory and without."""
    return {
        number: [measure.done(measure.drawn(number), row, resources) for row in ROWS]
        for number in NUMBERS
    }


def sums(costs):
    return sum(one.places for one in costs), sum(one.steps for one in costs)


def test_sequences_are_of_every_kind(measure):
    assert {measure.drawn(number).kind for number in NUMBERS} == set(measure.KINDS)


@pytest.mark.parametrize("number", NUMBERS)
def test_memory_costs_nothing_but_ways(measure, found, number):
    """No wrong belief and no longer search make a sequence dearer, only the way onward."""
    mine, others = found[number]
    assert [one.right for one in mine] == [one.right for one in others]
    assert sums(mine)[0] <= sums(others)[0]
    assert measure.cheaper(mine, others) >= 0 or measure.explained(mine, others)


def test_memory_saves_places_and_steps(measure, found):
    sides = [measure.cheaper(mine, others) for mine, others in found.values()]
    assert sides.count(-1) <= 5, "all in small bathrooms, by a few steps"
    mine, others = (sums([c for rows in found.values() for c in rows[n]]) for n in (0, 1))
    assert mine[0] < 0.8 * others[0]
    assert mine[1] < 0.8 * others[1]


@pytest.mark.parametrize("number", KEPT)
def test_memory_kept_in_a_home_costs_the_same(measure, resources, found, number):
    kept = measure.done(measure.drawn(number), "home", resources)
    assert [sums([one]) for one in kept] == [sums([one]) for one in found[number][0]]
    assert [one.right for one in kept] == [one.right for one in found[number][0]]


def test_more_searching_is_dearer_and_not_explained(measure, found):
    """The measure itself, with the rows changed over."""
    mine, others = found[32]
    assert measure.cheaper(mine, others) > 0 > measure.cheaper(others, mine)
    assert not measure.explained(others, mine)


def test_what_was_shut_in_a_safe_is_fetched(measure, resources):
    """AI2-THOR lets things into a closed safe: it says of it only that it can be opened."""
    errands = (measure.put("CellPhone", "Safe"), measure.put("CellPhone", "Shelf"))
    drawn = measure.Drawn(number=0, scene="bedroom_1", kind="shut away", errands=errands)
    _, fetched = measure.done(drawn, "memory", resources)
    assert fetched.right
    assert (fetched.refused, fetched.places) == (0, 1)
