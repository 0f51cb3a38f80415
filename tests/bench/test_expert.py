"""The expert: goals and a view become programs; every task is solvable."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.paths import ROOT

from karma import registry
from karma.agent.goals.files import load_tasks
from karma.agent.goals.goals import parse_goal
from karma.agent.planning.expert import ExpertView, NamedThing, solve
from karma.agent.planning.program import SKILLS, parse_program
from karma.bench.engine.episode import run_episode
from karma.bench.rows.expert import ExpertMethod
from karma.contracts import Area, Goal, SceneRef, SubTask, Task
from karma.household.pieces import base_type
from karma.household.places import STAND_CLOSED
from karma.household.types import object_types
from karma.household.uses import KNIVES
from karma.world.sim import EmbeddedWorld

TASKS = load_tasks(ROOT / "eval" / "alfred_l" / "tasks.jsonl")
KITCHEN = (
    Area(name="node_1", position_m=(0.0, 0.9, 0.0), contains=("CounterTop", "Fridge", "Microwave")),
    Area(
        name="node_2", position_m=(1.0, 0.9, 0.0),
        contains=("CoffeeMachine", "DiningTable", "Faucet", "Sink", "Toaster"),
    ),
)  # fmt: skip
APPLE = NamedThing(name="Apple", object_type="Apple")
MUG = NamedThing(name="Mug", object_type="Mug")
KNIFE = NamedThing(name="Knife", object_type="Knife")


def program(goals, things=(), *, held=None, areas=KITCHEN):
    view = ExpertView(things=tuple(things), areas=areas, held=held)
    return [str(call) for call in solve([parse_goal(goal) for goal in goals], view)]


def lines(text):
    return [str(call) for call in parse_program(text)]


# ----------------------------------------------------------------- views made by hand


def test_solve_puts_into_a_fridge_opened_before_and_closed_after():
    assert program(["INSIDE(Apple, Fridge)"], [APPLE]) == lines("""
        GoToObject(robot, 'Apple')
        PickupObject(robot, 'Apple')
        GoToObject(robot, 'Fridge')
        OpenObject(robot, 'Fridge')
        PutObject(robot, 'Apple', 'Fridge')
        CloseObject(robot, 'Fridge')
    """)


def test_solve_takes_out_of_a_closed_place_and_shuts_it():
    inside = NamedThing(name="Apple", object_type="Apple", place="Fridge_2", place_type="Fridge")
    assert program(["HOLDON(robot, Apple)"], [inside]) == lines("""
        GoToObject(robot, 'Fridge_2')
        OpenObject(robot, 'Fridge_2')
        PickupObject(robot, 'Apple')
        CloseObject(robot, 'Fridge_2')
    """)


def test_solve_fetches_a_knife_to_slice_and_puts_it_down_before_carrying():
    goals = ["STATE(Apple, sliced)", "ON(Apple, DiningTable)"]
    assert program(goals, [APPLE, KNIFE]) == lines("""
        GoToObject(robot, 'Knife')
        PickupObject(robot, 'Knife')
        GoToObject(robot, 'Apple')
        SliceObject(robot, 'Apple')
        GoToObject(robot, 'CounterTop')
        PutObject(robot, 'Knife', 'CounterTop')
        GoToObject(robot, 'Apple')
        PickupObject(robot, 'Apple')
        GoToObject(robot, 'DiningTable')
        PutObject(robot, 'Apple', 'DiningTable')
    """)


def test_solve_uses_the_knife_that_is_held_or_known():
    butter = NamedThing(name="ButterKnife", object_type="ButterKnife")
    held = program(["STATE(Apple, sliced)"], [APPLE], held=butter)
    assert held == lines("GoToObject(robot, 'Apple')\nSliceObject(robot, 'Apple')")
    known = program(["STATE(Apple, sliced)"], [APPLE, butter])
    assert known[1] == "PickupObject(robot, 'ButterKnife')"


def test_solve_explores_for_the_unknown_at_a_likely_area_node():
    assert program(["HOLDON(robot, Apple)"]) == lines("""
        Explore(robot, 'Apple', ['node_1'])
        GoToObject(robot, 'Apple')
        PickupObject(robot, 'Apple')
    """)


def test_solve_without_a_map_explores_without_nodes():
    first = program(["HOLDON(robot, Apple)"], areas=())[0]
    assert first == "Explore(robot, 'Apple')"


def test_solve_puts_what_is_held_down_first():
    assert program(["HOLDON(robot, Apple)"], [APPLE, MUG], held=MUG) == lines("""
        GoToObject(robot, 'CounterTop')
        PutObject(robot, 'Mug', 'CounterTop')
        GoToObject(robot, 'Apple')
        PickupObject(robot, 'Apple')
    """)


def test_solve_goes_nowhere_for_what_is_in_the_hand():
    assert program(["ON(Mug, DiningTable)"], [MUG], held=MUG) == lines("""
        GoToObject(robot, 'DiningTable')
        PutObject(robot, 'Mug', 'DiningTable')
    """)
    assert program(["HOLDON(robot, Mug)"], [MUG], held=MUG) == []


def test_solve_washes_and_then_places_elsewhere():
    goals = ["STATE(Apple, clean)", "INSIDE(Apple, Fridge)"]
    assert program(goals, [APPLE]) == lines("""
        GoToObject(robot, 'Apple')
        PickupObject(robot, 'Apple')
        GoToObject(robot, 'Sink')
        PutObject(robot, 'Apple', 'Sink')
        ToggleOn(robot, 'Faucet')
        ToggleOff(robot, 'Faucet')
        GoToObject(robot, 'Apple')
        PickupObject(robot, 'Apple')
        GoToObject(robot, 'Fridge')
        OpenObject(robot, 'Fridge')
        PutObject(robot, 'Apple', 'Fridge')
        CloseObject(robot, 'Fridge')
    """)


def test_solve_does_not_place_again_where_washing_leaves_it():
    said = program(["INSIDE(Apple, Sink)", "TOGGLEON(Faucet)", "STATE(Apple, clean)"], [APPLE])
    assert said.count("PutObject(robot, 'Apple', 'Sink')") == 1
    assert said[4:6] == ["ToggleOn(robot, 'Faucet')", "ToggleOff(robot, 'Faucet')"]


def test_solve_cracks_an_egg_in_the_microwave():
    egg = NamedThing(name="Egg", object_type="Egg")
    assert program(["STATE(Egg, cooked)"], [egg])[-6:] == lines("""
        OpenObject(robot, 'Microwave')
        PutObject(robot, 'Egg', 'Microwave')
        BreakObject(robot, 'Egg')
        CloseObject(robot, 'Microwave')
        ToggleOn(robot, 'Microwave')
        ToggleOff(robot, 'Microwave')
    """)


def test_solve_slices_bread_before_it_is_toasted_and_only_once():
    whole = NamedThing(name="Bread", object_type="Bread")
    said = program(["STATE(Bread, cooked)"], [whole, KNIFE])
    assert "SliceObject(robot, 'Bread')" in said
    assert said[-4:] == lines("""
        GoToObject(robot, 'Toaster')
        PutObject(robot, 'Bread', 'Toaster')
        ToggleOn(robot, 'Toaster')
        ToggleOff(robot, 'Toaster')
    """)
    slice_ = NamedThing(name="Bread", object_type="BreadSliced", states=("sliced",))
    assert "SliceObject(robot, 'Bread')" not in program(["STATE(Bread, cooked)"], [slice_])


def test_solve_makes_coffee_where_the_goals_name_the_machine():
    goals = ["STATE(Mug, filled)", "TOGGLEON(CoffeeMachine)"]
    assert program(goals, [MUG])[2:5] == lines("""
        GoToObject(robot, 'CoffeeMachine')
        PutObject(robot, 'Mug', 'CoffeeMachine')
        ToggleOn(robot, 'CoffeeMachine')
    """)
    assert "ToggleOn(robot, 'Faucet')" in program(["STATE(Mug, filled)"], [MUG])


def test_solve_looks_at_a_thing_under_the_lamp_with_the_thing_in_hand():
    lamp = (Area(name="node_1", position_m=(0.0, 0.9, 0.0), contains=("Desk", "DeskLamp")),)
    said = program(["HOLDON(robot, Mug)", "TOGGLEON(DeskLamp)"], [MUG], areas=lamp)
    assert said == lines("""
        GoToObject(robot, 'Mug')
        PickupObject(robot, 'Mug')
        GoToObject(robot, 'DeskLamp')
        ToggleOn(robot, 'DeskLamp')
    """)


def test_solve_uses_switch_for_the_light_switch_only():
    assert program(["TOGGLEOFF(LightSwitch)"])[-1] == "SwitchOff(robot, 'LightSwitch')"
    assert program(["TOGGLEON(Faucet)"])[-1] == "ToggleOn(robot, 'Faucet')"


def test_solve_of_open_and_closed_leaves_the_other_steps_out():
    assert program(["OPEN(Fridge)"]) == lines(
        "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')"
    )
    assert program(["CLOSED(Fridge)"])[-1] == "CloseObject(robot, 'Fridge')"


def test_solve_of_nothing_is_nothing():
    assert program([]) == []


# ----------------------------------------------------------------- any goals, any view

MOVABLE = sorted(k for k, v in object_types().items() if v.can("pickupable"))
PLACES = sorted(k for k, v in object_types().items() if v.can("receptacle"))
FIXED = sorted(k for k, v in object_types().items() if not v.can("pickupable"))
WORDS = ("clean", "heated", "cooked", "cold", "sliced", "filled", "broken")


@st.composite
def views(draw):
    kinds = draw(st.lists(st.sampled_from(MOVABLE), max_size=6, unique_by=base_type))
    things = []
    for kind in kinds:
        place = draw(st.sampled_from([None, "Fridge", "Cabinet", "CounterTop"]))
        things.append(
            NamedThing(name=base_type(kind), object_type=kind, place=place, place_type=place)
        )
    held = None
    if things and draw(st.booleans()):
        held = NamedThing(name=things[0].name, object_type=things[0].object_type)
        things[0] = held
    found = draw(st.lists(st.sampled_from(FIXED), unique=True, max_size=12))
    areas = (Area(name="node_1", position_m=(0.0, 0.9, 0.0), contains=tuple(found)),)
    return ExpertView(things=tuple(things), areas=draw(st.sampled_from([(), areas])), held=held)


@st.composite
def goals(draw):
    thing = base_type(draw(st.sampled_from(MOVABLE)))
    switched = draw(st.sampled_from(["Faucet", "Microwave", "DeskLamp", "LightSwitch", "Fridge"]))
    return draw(
        st.sampled_from(
            [
                Goal(predicate="ON", arguments=(thing, draw(st.sampled_from(PLACES)))),
                Goal(predicate="HOLDON", arguments=("robot", thing)),
                Goal(predicate="STATE", arguments=(thing, draw(st.sampled_from(WORDS)))),
                Goal(predicate="TOGGLEON", arguments=(switched,)),
                Goal(predicate="OPEN", arguments=(switched,)),
            ]
        )
    )


GOALS = st.lists(goals(), max_size=4)


@given(goals=GOALS, view=views())
def test_solve_says_only_what_parses_back_to_the_same_calls(goals, view):
    calls = solve(goals, view)
    parsed = parse_program("".join(f"{call}\n" for call in calls))
    assert [(c.skill, c.objects, c.positions) for c in parsed] == [
        (c.skill, c.objects, c.positions) for c in calls
    ]
    arity = {skill.name: skill.arguments.count("object") for skill in SKILLS}
    assert all(len(call.objects) == arity[call.skill] for call in calls)


@given(goals=GOALS, view=views())
def test_solve_never_needs_a_second_hand(goals, view):
    hand = view.held.name if view.held else None
    for call in solve(goals, view):
        if call.skill == "PickupObject":
            assert hand is None, call
            hand = call.objects[0]
        elif call.skill == "PutObject":
            assert hand == call.objects[0], call
            hand = None
        elif call.skill == "SliceObject":
            assert hand is not None, call
            assert base_type(hand) in KNIVES or _type_in(view, hand) in KNIVES, call


def _type_in(view, name):
    return next((thing.object_type for thing in view.things if thing.name == name), name)


@given(goals=GOALS, view=views())
def test_solve_opens_what_is_shut_before_it_puts_something_in(goals, view):
    opened = set()
    for call in solve(goals, view):
        if call.skill == "OpenObject":
            opened.add(call.objects[0])
        elif call.skill == "CloseObject":
            opened.discard(call.objects[0])
        elif call.skill == "PutObject" and call.objects[1] in STAND_CLOSED:
            assert call.objects[1] in opened, call


# ----------------------------------------------------------------- every task is solvable


@pytest.mark.parametrize("task", TASKS, ids=[task.id for task in TASKS])
def test_expert_solves_the_task(task, tmp_path):
    world = registry.load("worlds", "embedded")()
    record = run_episode(ExpertMethod(), world, task, row="expert", seed=0, folder=tmp_path)
    wrong = [(sub.instruction, sub.unmet) for sub in record.subtasks if sub.unmet]
    assert (record.error, wrong) == ("", [])
    assert record.success


@pytest.mark.parametrize(
    "goal", ["ON(Egg, StoveBurner)", "INSIDE(Bread, Toaster)", "INSIDE(Spoon, Microwave)"]
)
def test_expert_brings_what_fits_nowhere_by_itself_cut_or_in_a_vessel(goal, tmp_path):
    asked = SubTask(instruction="Bring it there.", goals=(parse_goal(goal),))
    task = Task(id="t", kind="simple", scene=SceneRef(name="kitchen_1"), subtasks=(asked,))
    world = EmbeddedWorld()
    record = run_episode(ExpertMethod(), world, task, row="e", seed=0, folder=tmp_path)
    assert record.success, record
