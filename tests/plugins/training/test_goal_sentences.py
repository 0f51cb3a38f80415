"""ALFRED's goal sentences as requests: five facts in, a program, the same five facts out."""

from itertools import product

import pytest

from karma.agent.planning.expert import ExpertView, NamedThing
from karma.agent.planning.program import parse_program
from karma.plugins.training.drawing.memories import room_of
from karma.plugins.training.goal_sentences import (
    GoalFacts,
    Sentence,
    facts_of,
    goals_of,
    program_of,
    read_sentences,
    truth_of,
)
from karma.plugins.training.samples import draw_alfred
from karma.seeds import stream
from karma.world.core import scene

PLACES = ("CounterTop", "Fridge", "Microwave", "Cabinet", "Sink", "GarbageCan")


def facts():
    tasks = ("simple", "clean", "heat", "cool", "two", "stack")
    for task, place, sliced in product(tasks, PLACES, (False, True)):
        if (task, place) in {("cool", "Fridge"), ("heat", "Microwave"), ("clean", "Sink")}:
            continue
        movable = "Plate" if task == "stack" else ""
        yield GoalFacts(task=task, thing="Apple", movable=movable, place=place, sliced=sliced)
    yield GoalFacts(task="look", thing="Book", movable="", place="DeskLamp", sliced=False)


@pytest.mark.parametrize("wanted", list(facts()), ids=str)
def test_facts_of_a_program_are_those_it_was_written_for(wanted):
    calls = program_of(Sentence(text="a sentence", facts=wanted), ExpertView())
    assert facts_of(calls) == wanted


def test_two_of_a_kind_are_one_goal_that_counts():
    wanted = GoalFacts(task="two", thing="Apple", movable="", place="Fridge", sliced=True)
    goals = [str(goal).removesuffix(": 1") for goal in goals_of(wanted, "Apple", "")]
    assert goals == ["2*STATE(Apple, sliced)", "2*ON(Apple, Fridge)"]
    calls = [str(call) for call in program_of(Sentence(text="two", facts=wanted), ExpertView())]
    assert sum("SliceObject" in call for call in calls) == 1
    assert sum("PutObject(robot, 'Apple', 'Fridge')" in call for call in calls) == 2


def test_second_of_two_goes_by_its_own_name_where_it_is_known():
    things = tuple(NamedThing(name=name, object_type="Mug") for name in ("Mug", "Mug_2"))
    wanted = GoalFacts(task="two", thing="Mug", movable="", place="Desk", sliced=False)
    calls = program_of(Sentence(text="two", facts=wanted), ExpertView(things=things))
    puts = [call.objects for call in calls if call.skill == "PutObject"]
    assert puts == [("Mug", "Desk"), ("Mug_2", "Desk")]


def test_facts_of_a_text_survive_being_written_and_read():
    wanted = GoalFacts(task="heat", thing="Potato", movable="", place="DiningTable", sliced=True)
    calls = program_of(Sentence(text="Cook a slice.", facts=wanted), ExpertView())
    assert facts_of(parse_program("".join(f"{call}\n" for call in calls))) == wanted


def test_facts_of_programs_without_a_task_are_none():
    assert facts_of(()) is None
    assert facts_of(parse_program("GoToObject(robot, 'Apple')")) is None
    assert facts_of(parse_program("ToggleOn(robot, 'DeskLamp')")) is None


def test_truth_of_a_record_takes_basins_for_their_whole_and_lamps_for_places():
    params = {"object_target": "Cloth", "parent_target": "SinkBasin", "mrecep_target": "",
              "toggle_target": "", "object_sliced": False}  # fmt: skip
    found = truth_of({"task_type": "pick_and_place_simple", "pddl_params": params})
    assert found == GoalFacts(task="simple", thing="Cloth", movable="", place="Sink", sliced=False)
    params = params | {"parent_target": "", "toggle_target": "FloorLamp"}
    assert truth_of({"task_type": "look_at_obj_in_light", "pddl_params": params}).place == (
        "FloorLamp"
    )


def test_draw_alfred_of_a_room_without_the_place_is_none():
    room = room_of(scene.load("bathroom_1"), "bathroom_1")
    wanted = GoalFacts(task="simple", thing="Apple", movable="", place="Fridge", sliced=False)
    sentences = [Sentence(text="Put an apple in the fridge.", facts=wanted)]
    assert all(
        draw_alfred(stream(0, str(n)), room, sentences, mapped=True) is None for n in range(20)
    )
    drawn = [draw_alfred(stream(0, str(n)), room, sentences, mapped=False) for n in range(20)]
    alone = [e for e in drawn if e is not None and "#memory\n#program" in e.changing]
    assert len(alone) > 8
    assert all("put an apple in the fridge" in example.changing for example in alone[:1])


@pytest.mark.shared
def test_every_goal_of_the_reference_data_comes_back_from_its_program(shared):
    path = shared / "data" / "alfred" / "valid_seen.jsonl.gz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    sentences = read_sentences(path)
    assert len(sentences) == 820
    assert all(facts_of(program_of(s, ExpertView())) == s.facts for s in sentences)
