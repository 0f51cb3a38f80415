"""The inspector: searches are added, one hand is enough, and what cannot work is named."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma.agent.planning.inspector import mend, objection
from karma.agent.planning.program import SKILLS, parse_program
from karma.contracts import Area, SkillCall
from karma.plugins.training.drawing.memories import KnownRoom
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.samples import draw
from karma.seeds import stream


def lines(calls):
    return [str(call) for call in calls]


def test_unknown_thing_is_explored_before_its_first_use():
    calls = mend(parse_program("GoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')"), known=())
    assert lines(calls) == [
        "Explore(robot, 'Mug')", "GoToObject(robot, 'Mug')", "PickupObject(robot, 'Mug')",
    ]  # fmt: skip


def test_known_thing_is_not_explored():
    program = parse_program("GoToObject(robot, 'Mug_2')\nPickupObject(robot, 'Mug_2')")
    assert mend(program, known={"Mug_2"}) == program


def test_thing_remembered_in_a_closed_container_is_explored_instead():
    program = parse_program("GoToObject(robot, 'Egg')\nPickupObject(robot, 'Egg')")
    assert lines(mend(program, known={"Egg"}, shut={"Egg"}))[0] == "Explore(robot, 'Egg')"


def test_first_thing_put_down_is_what_is_in_the_hand():
    program = parse_program("PutObject(robot, 'Bottle', 'CounterTop')")
    mended = mend(program, known={"Bottle", "CounterTop"}, held="Knife")
    assert lines(mended) == ["PutObject(robot, 'Knife', 'CounterTop')"]


def test_full_hand_is_freed_on_a_known_surface():
    program = parse_program("PickupObject(robot, 'Mug')")
    mended = mend(program, known={"Mug", "DiningTable"}, held="Knife")
    assert lines(mended)[0] == "PutObject(robot, 'Knife', 'DiningTable')"
    assert objection(mended, held="Knife") is None


def test_search_begins_in_the_area_with_the_likeliest_place():
    areas = [
        Area(name="node_1", position_m=(0, 0, 0), contains=("Toilet",)),
        Area(name="node_2", position_m=(1, 0, 0), contains=("CounterTop",)),
    ]
    program = parse_program("PickupObject(robot, 'Mug')")
    assert lines(mend(program, known=(), areas=areas))[0] == "Explore(robot, 'Mug', ['node_2'])"


def test_thing_in_the_hand_is_not_picked_up_again():
    program = parse_program(
        "GoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')\nPutObject(robot, 'Mug', 'Sink')"
    )
    mended = mend(program, known={"Mug", "Sink"}, held="Mug")
    assert lines(mended) == ["PutObject(robot, 'Mug', 'Sink')"]


def test_what_is_cut_already_is_not_cut_again():
    program = parse_program(
        "GoToObject(robot, 'Knife')\nPickupObject(robot, 'Knife')\nGoToObject(robot, 'Apple')\n"
        "SliceObject(robot, 'Apple')\nGoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')"
    )
    known = {"Apple", "Knife"}
    assert lines(mend(program, known=known, cut={"Apple"})) == [
        "GoToObject(robot, 'Apple')", "GoToObject(robot, 'Apple')", "PickupObject(robot, 'Apple')",
    ]  # fmt: skip
    assert program[3] in mend(program, known=known)


def test_thing_in_the_hand_is_put_down_before_it_is_broken():
    mended = mend(parse_program("BreakObject(robot, 'Vase')"), known={"Vase", "Desk"}, held="Vase")
    assert lines(mended) == ["PutObject(robot, 'Vase', 'Desk')", "BreakObject(robot, 'Vase')"]


def test_hand_is_freed_on_a_surface_to_be_found_where_none_is_known():
    mended = mend(parse_program("PickupObject(robot, 'Mug')"), known={"Mug"}, held="Knife")
    assert lines(mended)[:2] == [
        "Explore(robot, 'CounterTop')", "PutObject(robot, 'Knife', 'CounterTop')",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("program", "held", "reason"),
    [
        ("PickupObject(robot, 'Fridge')", None, "cannot be picked up"),
        ("SliceObject(robot, 'Plate')", None, "cannot be sliced"),
        ("ToggleOn(robot, 'Apple')", None, "cannot be switched"),
        ("OpenObject(robot, 'Apple')", None, "cannot be opened"),
        ("PutObject(robot, 'Apple', 'Fridge')", None, "the hand is empty"),
        ("PutObject(robot, 'Apple', 'Fridge')", "Mug", "the hand holds Mug, not Apple"),
        ("PutObject(robot, 'Pillow', 'Toaster')", "Pillow", "cannot be placed in Toaster"),
        ("PickupObject(robot, 'Apple')", "Mug", "the hand holds Mug"),
    ],
)
def test_line_that_cannot_work_is_named(program, held, reason):
    found = str(objection(parse_program(program), held=held))
    assert found.startswith(program) and reason in found


@given(number=st.integers(0, 300))
def test_mending_twice_changes_nothing_more(number):
    room = KnownRoom(name="bare", areas=(), movables=("Apple", "Knife", "Mug", "Plate", "Bread"))
    example = draw(stream(number, "inspector"), room, our_book(), mapped=False)
    once = mend(parse_program(example.program), known=())
    assert mend(once, known=()) == once
    assert {call.skill for call in once} <= {skill.name for skill in SKILLS}


def test_what_runs_is_switched_off_before_its_door_or_lid_is_moved():
    shut = [SkillCall(skill="CloseObject", objects=("Laptop",))]
    lines = [str(call) for call in mend(shut, known={"Laptop"}, running={"Laptop"})]
    assert lines == ["ToggleOff(robot, 'Laptop')", "CloseObject(robot, 'Laptop')"]
    assert mend(shut, known={"Laptop"}) == tuple(shut)
    cook = [SkillCall(skill=one, objects=("Microwave",))
            for one in ("CloseObject", "ToggleOn", "OpenObject", "CloseObject")]  # fmt: skip
    skills = [call.skill for call in mend(cook, known={"Microwave"})]
    assert skills == ["CloseObject", "ToggleOn", "ToggleOff", "OpenObject", "CloseObject"]
    lamp = [SkillCall(skill="ToggleOn", objects=("DeskLamp",)),
            SkillCall(skill="OpenObject", objects=("Fridge",))]  # fmt: skip
    assert mend(lamp, known={"DeskLamp", "Fridge"}) == tuple(lamp)
