"""What the first program was to bring about, and what is left of it."""

import pytest

from karma.agent.planning.first_program import (
    aims_of,
    left_undone,
    replaces_first,
    substitution,
)
from karma.agent.planning.program import OUR_SKILLS, SKILLS, parse_program
from karma.types.planning import PlanRequest


def program(*lines):
    """Calls in short: "Put Apple Fridge" is PutObject(robot, 'Apple', 'Fridge')."""
    full = {"Pick": "PickupObject", "Put": "PutObject", "Slice": "SliceObject",
            "Open": "OpenObject", "Go": "GoToObject", "Throw": "ThrowObject"}  # fmt: skip
    text = ""
    for line in lines:
        skill, *names = line.split()
        text += f"{full.get(skill, skill)}(robot, {', '.join(map(repr, names))})\n"
    return parse_program(text, (*SKILLS, *OUR_SKILLS))


HEAT = ("Explore Lettuce", "Pick Lettuce", "Put Lettuce Microwave", "ToggleOn Microwave")
BIN = ("Go CellPhone", "Pick CellPhone", "Put CellPhone GarbageCan")
CUT = ("Pick Knife", "Go Tomato", "Slice Tomato", "Put Knife CounterTop")
FILL = ("Pick Mug", "Put Mug Sink", "ToggleOn Faucet", "Pick Mug", "Put Mug SideTable_2")


def objection_to(first, later):
    request = PlanRequest(instruction="do what I said", first=program(*first))
    return substitution(program(*later), request)


def about(calls):
    aims = aims_of(calls)
    return {*aims.moved, *(kind for _, kind in aims.deeds)}


def test_what_is_left_undone_is_what_the_first_program_has_and_nobody_did():
    first = program(*CUT, "Pick Plate", "Put Plate Fridge", "ToggleOn DeskLamp", "Pick Mug")
    done = program("Pick Knife", "Slice Tomato_2", "Pick Plate", "Put Plate CounterTop", "Pick Mug")
    assert left_undone(first, first) == ()
    assert left_undone(first, done) == ("DeskLamp", "Plate")
    assert left_undone(program("ToggleOn DeskLamp"), ()) == ("DeskLamp",)
    assert left_undone(program("Explore Mug"), program("Explore Cup")) == ("Mug",)
    assert left_undone(program("Go Fridge", "Explore Mug"), program("Go Mug")) == ()
    assert left_undone(program(*CUT), program("Pick Knife", "Slice Tomato")) == ()


@pytest.mark.parametrize(
    ("instruction", "replaced"),
    [
        ("bring me the pan", True),  # nobody spoke of a pot
        ("bring me the pot, or a pan if there is none", True),
        ("bring me the pot beside the pan", False),
        ("bring me something to fry with", False),
    ],
)
def test_first_program_is_replaced_by_one_that_the_instruction_names(instruction, replaced):
    first, later = program("Explore Pot", "Pick Pot"), program("Explore Pan", "Pick Pan")
    assert replaces_first(first, later, instruction) is replaced


@pytest.mark.parametrize(("types", "replaced"), [(("Pot", "Pan"), True), (("Pan",), False)])
def test_first_program_is_replaced_where_a_word_means_either_object(types, replaced):
    first, later = program("Explore Pot", "Pick Pot"), program("Explore Pan", "Pick Pan")
    assert replaces_first(first, later, "bring me the vessel", {"vessel": types}) is replaced


def test_knives_taps_and_doors_are_no_aim_beside_others():
    assert about(program(*CUT)) == {"Tomato"}
    assert about(program(*FILL)) == {"Mug"}
    assert about(program("Open Fridge", "Pick Egg", "Put Egg Pan")) == {"Egg"}
    assert about(program("Pick Knife", "Put Knife Drawer")) == {"Knife"}


@pytest.mark.parametrize(
    ("first", "later"),
    [
        (HEAT, ("Pick Knife", "Put Knife Microwave", "ToggleOn Microwave")),  # another object
        (BIN, ("Pick Laptop", "Put Laptop GarbageCan")),
        (BIN, ("Pick Laptop", "Put Laptop GarbageCan", *BIN[1:])),
        (BIN, ("Pick Laptop", "Throw Laptop")),
        (CUT, ("Pick Knife", "Slice Potato")),
        (("ToggleOn FloorLamp",), ("ToggleOn Television",)),
        (("Open Fridge",), ("Open Microwave",)),
        (BIN, ("Pick CellPhone", "Put CellPhone Drawer")),  # another place
        (FILL, ("Put Mug Sink", "ToggleOn Faucet", "Pick Mug", "Put Mug Shelf")),
        (("Pick CD", "PutNear CD Laptop"), ("Pick CD", "PutNear CD Box")),
    ],
)
def test_later_program_that_substitutes_an_object_or_place_is_objected_to(first, later):
    assert objection_to(first, later) is not None


@pytest.mark.parametrize(
    ("first", "later"),
    [
        (HEAT, HEAT),
        (HEAT, ("Explore Lettuce", "Pick Lettuce_2", "Put Lettuce_2 Microwave")),  # any will do
        (HEAT, ("Open Microwave", "Pick Bread", "Put Bread CounterTop", *HEAT[1:])),  # in the way
        (HEAT, ("Open Microwave", "Put Lettuce Microwave")),  # what is left
        (HEAT, ("Go Fridge", "Explore Egg")),  # nothing is done to it
        (CUT, ("Explore ButterKnife", "Pick ButterKnife", "Slice Tomato_2")),  # another tool
        (
            ("Pick Laptop", "Put Laptop Cabinet"),
            ("Pick Laptop", "Put Laptop Box", "Pick Box", "Put Box Cabinet"),  # in a container
        ),
        (("Pick Apple", "Put Apple Sofa"), ("Pick Apple", "Put Apple CounterTop")),  # no apple goes
        ((), ("Pick Laptop",)),
    ],
)
def test_later_program_that_goes_on_with_the_same_objects_passes(first, later):
    assert objection_to(first, later) is None
