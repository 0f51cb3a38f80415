"""How a request was read first: later programs do not act on another thing, nor elsewhere."""

import pytest

from karma.agent.planning.first_program import astray, left_undone, put_right, reading_of
from karma.agent.planning.planner import Planner
from karma.agent.planning.program import OUR_SKILLS, SKILLS, parse_program
from karma.contracts import Area, Decoding, PlanRequest
from karma.models.scripted import ScriptedModel


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

SWAPS = [
    (HEAT, ("Pick Knife", "Put Knife Microwave", "ToggleOn Microwave")),  # another thing
    (BIN, ("Pick Laptop", "Put Laptop GarbageCan")),
    (BIN, ("Pick Laptop", "Put Laptop GarbageCan", "Pick CellPhone", "Put CellPhone GarbageCan")),
    (BIN, ("Pick Laptop", "Throw Laptop")),
    (CUT, ("Pick Knife", "Slice Potato")),
    (CUT, ("Pick Potato", "Put Potato Fridge")),
    (("Pick Newspaper", "Put Newspaper Sofa"), ("Pick Pillow_2", "Put Pillow_2 Sofa")),
    (("ToggleOn FloorLamp",), ("ToggleOn Television",)),
    (("Open Fridge",), ("Open Microwave",)),
    (("Pick Vase",), ("Pick Statue",)),
    (("Explore Laptop",), ("Explore Apple", "Pick Apple")),
    (BIN, ("Pick CellPhone", "Put CellPhone Drawer")),  # another place
    (BIN, ("Put CellPhone Drawer",)),  # it is in the hand by now
    (FILL, ("Put Mug Sink", "ToggleOn Faucet", "Pick Mug", "Put Mug Shelf")),
    (("Pick Pan", "Put Pan StoveBurner_1"), ("Pick Pan", "Put Pan Fridge")),
    (("Pick CD", "PutNear CD Laptop"), ("Pick CD", "PutNear CD Box")),
]


@pytest.mark.parametrize(("first", "later"), SWAPS)
def test_later_program_about_another_thing_or_place_is_astray(first, later):
    assert astray(program(*first), program(*later), "do what I said") is not None


@pytest.mark.parametrize(
    ("first", "later"),
    [
        (HEAT, HEAT),
        (HEAT, ("Explore Lettuce", "Pick Lettuce_2", "Put Lettuce_2 Microwave")),  # any will do
        (HEAT, ("Open Microwave", "Pick Bread", "Put Bread CounterTop", *HEAT[1:])),  # in the way
        (HEAT, ("Open Microwave", "Put Lettuce Microwave")),  # what is left
        (HEAT, ("Go Fridge", "Explore Egg")),  # nothing is done to it
        (CUT, ("Explore ButterKnife", "Pick ButterKnife", "Slice Tomato_2")),  # another tool
        (FILL, ("Put Mug SideTable",)),
        (("Pick Laptop", "Put Laptop Cabinet"),
         ("Pick Laptop", "Put Laptop Box", "Pick Box", "Put Box Cabinet")),  # by a vessel
        (("Pick Apple", "Put Apple Sofa"), ("Pick Apple", "Put Apple CounterTop")),  # no apple goes
        (BIN, ("Pick CellPhone", "Throw CellPhone")),
        (("Pick Apple", "Slice Apple"), ("Put Apple CounterTop", "Pick Knife", "Slice Apple")),
        ((), ("Pick Laptop",)),
    ],
)  # fmt: skip
def test_later_program_that_goes_on_with_the_same_is_not_astray(first, later):
    assert astray(program(*first), program(*later), "do what I said") is None


@pytest.mark.parametrize(
    ("instruction", "right"),
    [
        ("bring me the pan", True),  # nobody spoke of a pot
        ("bring me the pot, or a pan if there is none", True),
        ("bring me the pot beside the pan", False),
        ("bring me something to fry with", False),
    ],
)
def test_first_reading_is_put_right_only_by_what_the_words_name(instruction, right):
    first, later = program("Explore Pot", "Pick Pot"), program("Explore Pan", "Pick Pan")
    assert put_right(first, later, instruction) is right
    assert (astray(first, later, instruction) is None) is right


@pytest.mark.parametrize(
    ("instruction", "first", "later", "meant"),
    [
        ("Switch off the light.", "ToggleOff DeskLamp", "ToggleOff LightSwitch", True),
        ("Switch off the desk lamp.", "ToggleOff DeskLamp", "ToggleOff LightSwitch", False),
        ("Bring the cleaning tool.", "Pick ScrubBrush", "Pick DishSponge", True),
        ("Bring the cleaning tool.", "Pick ScrubBrush", "Pick Knife", False),
        ("Hang up the towel", "Pick Towel", "Pick HandTowel", True),
    ],
)
def test_word_that_may_mean_either_thing_lets_a_later_program_take_the_other(
    instruction, first, later, meant
):
    assert (astray(program(first), program(later), instruction) is None) is meant


def test_what_is_left_undone_is_what_the_first_program_has_and_nobody_did():
    first = program(*CUT, "Pick Plate", "Put Plate Fridge", "ToggleOn DeskLamp", "Pick Mug")
    done = program("Pick Knife", "Slice Tomato_2", "Pick Plate", "Put Plate CounterTop", "Pick Mug")
    assert left_undone(first, first) == ()
    assert left_undone(first, done) == ("DeskLamp", "Plate")
    assert left_undone(program("ToggleOn DeskLamp"), ()) == ("DeskLamp",)
    assert left_undone(program("Explore Mug"), program("Explore Cup")) == ("Mug",)
    assert left_undone(program("Go Fridge", "Explore Mug"), program("Go Mug")) == ()
    assert left_undone(program(*CUT), program("Pick Knife", "Slice Tomato")) == ()


def test_knives_taps_and_doors_are_no_aim_beside_others():
    assert reading_of(program(*CUT)).things == {"Tomato"}
    assert reading_of(program(*FILL)).things == {"Mug"}
    assert reading_of(program("Open Fridge", "Pick Egg", "Put Egg Pan")).things == {"Egg"}
    assert reading_of(program("Pick Knife", "Put Knife Drawer")).things == {"Knife"}


# ----------------------------------------------------------------- refused like other answers


def answers(lines):
    return "\n".join(map(str, program(*lines))) + "\n"


@pytest.mark.parametrize(("first", "later"), [SWAPS[0], SWAPS[-1]])
def test_planner_asks_again_and_never_hands_on_a_program_that_is_astray(first, later):
    model = ScriptedModel([answers(later)] * 2)
    types = ("CounterTop", "Fridge", "GarbageCan", "Microwave", "Sink", "Faucet", "Sofa")
    request = PlanRequest(
        instruction="do what I said",
        areas=(Area(name="node_1", position_m=(0, 0, 0), contains=types),),
        first=program(*first),
        error="Explore: not found",
    )
    plans = list(Planner(model, "full", Decoding(attempts=2, constraint="free")).plan(request))
    assert len(plans) == 2
    assert all(plan.calls == () and plan.error for plan in plans)
    assert "than asked for" in model.prompts[1].changing
