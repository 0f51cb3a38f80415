"""Goals as answers: the lines of goals mean the goals they are written for."""

import numpy as np
import pytest
from support.random_programs import random_program

from karma.agent.planning.expert import ExpertView
from karma.agent.planning.goal_lines import GOAL_LINES, as_lines, plain_program, program_for
from karma.agent.planning.inspector import narrowed
from karma.agent.planning.planner import Planner
from karma.agent.planning.program import SKILLS, parse_program
from karma.agent.planning.prompt import GOALS
from karma.goals.files import load_said
from karma.goals.goals import parse_goal
from karma.household.ids import short_type
from karma.household.types import object_types
from karma.loading.planner_files import bank_file, read_bank
from karma.models.scripted import ScriptedModel
from karma.types.completion import Decoding
from karma.types.memory import Area, MemoryUnit
from karma.types.planning import PlanRequest, ProgramSpec, WorkedExample

AREAS = (
    Area(name="node_1", position_m=(0.0, 0.9, 0.0), contains=("CounterTop", "Fridge", "Sink")),
    Area(name="node_2", position_m=(1.0, 0.9, 0.0), contains=("Microwave", "Faucet")),
)
UNITS = (
    MemoryUnit(object_id="Mug|1", object_type="Mug", position_m=(0, 0, 0)),
    MemoryUnit(object_id="Mug|2", object_type="Mug", position_m=(0, 0, 0), states=("cleaned",)),
)
FACTS = PlanRequest(instruction="rinse the other mug", areas=AREAS, units=UNITS)
LAST = "# What is to be so (lines only)\n"


def plans(answers, facts=FACTS, **decoding):
    model = ScriptedModel(answers)
    return model, list(Planner(model, GOALS, Decoding(**decoding)).plan(facts))


def text(calls):
    return [str(call) for call in calls]


def test_lines_of_every_written_sentence_lead_to_the_program_of_its_goals():
    said = [one for one in load_said(bank_file()) if one.goals]
    assert len(said) > 600
    for one in said:
        lines = as_lines(one.wanted)
        again = parse_program("\n".join(text(lines)), GOAL_LINES)
        assert text(program_for(again, (), {})) == text(plain_program(one.wanted, ExpertView()))


@pytest.mark.parametrize(
    ("goals", "lines"),
    [
        (["2*ON(Book, Shelf)"], ["Put(robot, 'Book', 'Shelf')"] * 2),
        (
            ["2*STATE(Apple, sliced)", "2*ON(Apple, Plate)"],
            ["Slice(robot, 'Apple')", *["Put(robot, 'Apple', 'Plate')"] * 2],
        ),
        (["STATE(Cup/Mug, filled)", "TOGGLEON(CoffeeMachine)"], ["MakeCoffee(robot, 'Cup')"]),
        (["TOGGLEON(CoffeeMachine)"], ["TurnOn(robot, 'CoffeeMachine')"]),
        (["HOLDON(robot, Pen)", "CLOSED(Box)"], ["Hold(robot, 'Pen')", "Close(robot, 'Box')"]),
        (["STATE(Mug, hot)"], ["Heat(robot, 'Mug')"]),
        (["ON(Mug, Sink)", "STATE(Plate, dirty)"], []),  # nobody makes a thing dirty
    ],
)
def test_goals_are_said_in_lines(goals, lines):
    assert text(as_lines([parse_goal(goal) for goal in goals])) == lines


def test_two_lines_of_the_same_are_two_things_and_near_is_not_on():
    twice = parse_program("Put(robot, 'Book', 'Shelf')\nPut(robot, 'Book', 'Shelf')\n", GOAL_LINES)
    assert [call.skill for call in program_for(twice, (), {})].count("PutObject") == 2
    near = parse_program("Near(robot, 'Book', 'Sofa')\n", GOAL_LINES)
    assert text(program_for(near, (), {}))[-1] == "PutNear(robot, 'Book', 'Sofa')"


def test_answer_of_goals_becomes_a_program_about_the_things_in_memory():
    model, (plan,) = plans(["Clean(robot, 'Mug_2')\nPut(robot, 'Mug_2', 'CounterTop')\n"])
    assert plan.names == {"Mug": "Mug|2", "Mug_2": "Mug|1"}
    assert {name for call in plan.calls for name in call.objects} == {
        "Mug_2", "Sink", "Faucet", "CounterTop",
    }  # fmt: skip
    assert all(call.skill in {skill.name for skill in SKILLS} for call in plan.calls)
    asked = model.prompts[0]
    assert asked.changing.endswith(LAST)
    assert "Put(robot, object, object): " in asked.stable
    assert "PickupObject" not in asked.stable + asked.changing
    assert "node_1" not in asked.stable


@pytest.mark.parametrize("answer", ["Fly(robot, 'Mug')", "PickupObject(robot, 'Mug')", "Sure!"])
def test_answer_that_is_no_line_is_asked_again(answer):
    _, (first, second) = plans([answer, "Hold(robot, 'Mug')\n"], attempts=2)
    assert first.error
    assert not first.calls
    assert text(second.calls)[-1] == "PickupObject(robot, 'Mug')"


def test_examples_are_told_as_lines():
    bank = read_bank(goals=True)
    names = {line.name for line in GOAL_LINES}
    assert {line.partition("(")[0] for one in bank for line in one.program.splitlines()} <= names
    one = WorkedExample(instruction="tidy up", program="Put(robot, 'Pen', 'Drawer')")
    model, _ = plans(
        ["Hold(robot, 'Mug')\n"], PlanRequest(instruction="go", areas=AREAS, examples=(one,))
    )
    assert "# Instruction: tidy up\nPut(robot, 'Pen', 'Drawer')\n" in model.prompts[0].changing


def test_no_line_says_what_no_type_allows():
    """Random answers under the types; without them most say what cannot be."""
    washing = ("Bathtub", "BathtubBasin", "Sink", "SinkBasin")  # they stand for their taps
    names = tuple(sorted({short_type(name) for name in object_types()} - {*washing}))
    spec = ProgramSpec(skills=GOAL_LINES, objects=names, narrowed=narrowed(GOAL_LINES, names))
    needs = {line.name: line.takes for line in GOAL_LINES if line.takes}
    generator = np.random.default_rng(3)
    for _ in range(300):
        (call,) = parse_program(random_program(spec, generator, 1), GOAL_LINES)
        kinds = [object_types().get(name) for name in call.objects]
        if call.skill in needs and kinds[0] is not None:
            assert kinds[0].can(needs[call.skill]), str(call)
        if call.skill == "Put" and None not in kinds:
            assert kinds[0].can("pickupable")
            assert kinds[1].can("receptacle")
