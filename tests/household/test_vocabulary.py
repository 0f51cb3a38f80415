"""What is said of parts, uses, places and states fits the table of types."""

import pytest

from karma.household import places, uses
from karma.household.ids import is_part, part_id, root_id, root_type, type_of, whole_id
from karma.household.pieces import base_type, is_piece, piece_type
from karma.household.states import END_STATES, GOAL_STATES, NEEDS, OPPOSITES, canonical_state
from karma.household.types import object_types

TYPES = object_types()
APPLE = "Apple|+01.00|+00.90|-02.00"


@pytest.mark.parametrize("kind", TYPES.values(), ids=lambda kind: kind.name)
def test_pieces_are_what_is_made_by_slicing(kind):
    assert is_piece(kind.name) == kind.made_by_slicing
    assert base_type(piece_type(kind.name)) == base_type(kind.name)
    assert piece_type(kind.name) == (kind.slices_into or kind.name)


def test_id_of_a_piece_leads_back_to_its_whole():
    piece = part_id(APPLE, "AppleSliced_2")
    assert (whole_id(piece), root_id(piece), root_id(APPLE)) == (APPLE, APPLE, APPLE)
    assert (type_of(piece), root_type(piece)) == ("AppleSliced", "Apple")
    assert is_part(piece, of=APPLE)
    assert not is_part(APPLE, of=APPLE)
    assert not is_part("Apple|+01.00|+00.90|-02.005", of=APPLE)


@pytest.mark.parametrize(
    "names",
    [uses.TAPS, uses.BASINS, uses.KNIVES, uses.LAMPS, uses.MOMENTARY, uses.COOKED,
     places.SURFACES, places.LIKELY, places.BESIDE_A_DOOR, places.STAND_CLOSED, places.SEVERAL,
     places.OVERLOOKED, uses.CHANGED_IN.values(), (places.FLOOR, uses.BIN, uses.COFFEE_CUP)],
)  # fmt: skip
def test_names_are_types(names):
    assert set(names) <= set(TYPES)


def test_places_can_do_what_is_said_of_them():
    fixed = (*places.SURFACES, *places.LIKELY, *places.BESIDE_A_DOOR)
    assert all(TYPES[name].can("receptacle") for name in fixed)
    assert all(TYPES[name].can("openable") for name in places.STAND_CLOSED)
    must_be_open = {name for name, kind in TYPES.items() if kind.must_be_open}
    assert must_be_open ^ set(places.STAND_CLOSED) == {"Box", "Safe"}


def test_opposites_are_mutual_and_are_states():
    assert all(OPPOSITES[other] == one for one, other in OPPOSITES.items())
    assert {*OPPOSITES, *END_STATES.values(), *NEEDS} <= GOAL_STATES
    assert all(canonical_state(state) == state for state in GOAL_STATES)
