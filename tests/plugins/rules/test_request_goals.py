"""Goals of a parsed request, and the planner that falls back on them."""

from dataclasses import replace

import pytest

from karma.agent.planning.planner import Planner
from karma.agent.planning.program import SKILLS, parse_program
from karma.goals.files import load_said
from karma.household.states import DONE_BY
from karma.household.types import object_types
from karma.loading.planner_files import bank_file
from karma.models.scripted import ScriptedModel
from karma.plugins.rules.answer_checker import advice_for
from karma.plugins.rules.language.lexicon import Lexicon
from karma.plugins.rules.language.request import RequestReader
from karma.plugins.rules.parser import SpacyParser
from karma.plugins.rules.request_checker import Guard, cannot_serve
from karma.plugins.rules.request_goals import asked_goals, program_for
from karma.types.completion import Decoding
from karma.types.memory import Area
from karma.types.planning import PlanRequest
from karma.types.tasks import Goal

MANY = ("CoffeeTable", "DeskLamp", "FloorLamp", "ShelvingUnit")  # a table, a lamp: which?
HERE = frozenset(object_types()) - {*MANY}
KITCHEN = ("CounterTop", "Fridge", "Sink", "Faucet", "Microwave", "Toaster", "Drawer", "GarbageCan")


@pytest.fixture(scope="module")
def reader():
    return RequestReader(SpacyParser(), Lexicon(None))


@pytest.mark.parametrize(
    ("said", "goals"),
    [
        ("wash the mug and put it on the counter", ["STATE(Mug, cleaned)", "ON(Mug, CounterTop)"]),
        ("take the apple out and put it in the fridge", ["ON(Apple, Fridge)"]),
        ("open the drawer, put the spoon in and close it",
         ["OPEN(Drawer)", "ON(Spoon, Drawer)", "CLOSED(Drawer)"]),
        ("put the fork next to the plate", ["NEAR(Fork, Plate)"]),
        ("the bread has gone stale, throw it away", ["ON(Bread, GarbageCan)"]),
        ("close the tap", ["TOGGLEOFF(Faucet)"]),
        ("make me a cup of coffee", ["STATE(Mug, filled)", "TOGGLEON(CoffeeMachine)"]),
        ("wash two plates", []),  # which ones has to be seen first
        ("put a slice of bread on the plate", []),
        ("throw the empty roll away", []),  # a look has to tell whether it is
        ("put the plate with the potato in the fridge", []),
        ("fry the pan", []),
        ("put everything in the fridge", []),
    ],
)  # fmt: skip
def test_words_alone_say_goals_where_they_tell_what_is_meant(reader, said, goals):
    (asked,) = reader.read(said)
    assert [goal.removesuffix(": 1") for goal in text(asked_goals(asked, HERE))] == goals


def test_words_alone_mean_what_the_written_sentences_were_written_for(reader):
    """Of ours that words alone answer nearly all; the others leave which things open."""
    right, wrong = 0, []
    for one in load_said(bank_file()):
        read = reader.read(one.text) if one.goals else ()
        found = [asked_goals(asked, HERE) for asked in read if not cannot_serve(asked, HERE)]
        if found and len(found) == len(read) and all(found):
            said = {_plain(goal) for goals in found for goal in goals}
            if said == {_plain(goal) for goal in one.wanted}:
                right += 1
            else:
                wrong.append((one.text, sorted(map(str, said))))
    assert right >= 450
    assert len(wrong) <= 8, wrong


def _plain(goal):
    """Return a goal with the first of its alternatives, and what is to be done for its state."""
    first, *others = (one.partition("/")[0].strip() for one in goal.arguments)
    if goal.predicate == "STATE":
        others = [DONE_BY.get(others[0], others[0])]
    predicate = "ON" if goal.predicate == "INSIDE" else goal.predicate
    return Goal(predicate=predicate, arguments=(first, *others))


def test_near_is_not_on():
    near = Goal(predicate="NEAR", arguments=("Book", "Sofa"))
    assert text(program_for([near], (), {}))[-1] == "PutNear(robot, 'Book', 'Sofa')"


def asked_of(reader, said, answers, **decoding):
    (asked,) = reader.read(said)
    areas = (Area(name="node_1", position_m=(0.0, 0.9, 0.0), contains=KITCHEN),)
    facts = PlanRequest(instruction=said, areas=areas, advice=replace(advice_for(asked), plain=""))
    planner = Planner(ScriptedModel(answers), "compact", Decoding(**decoding))
    return asked, list(planner.plan(facts))


def test_words_alone_plan_where_no_answer_does_what_was_asked(reader):
    wrong = "GoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')\n"
    asked, made = asked_of(reader, "toast the bread", [wrong] * 4, attempts=4)
    *answers, last = made
    assert len(answers) == 2  # the second time is enough
    assert all("toast" in one.error and not one.calls for one in answers)
    assert last.refused is None
    assert last.completion.completion_tokens == 0  # no model said it
    assert not Guard(asked, {*KITCHEN}).stopped(last.calls)
    assert "PutObject(robot, 'Bread', 'Toaster')" in text(last.calls)


@pytest.mark.parametrize("said", ["throw the empty roll away", "wash two plates"])
def test_request_is_refused_where_neither_answers_nor_words_tell(reader, said):
    wrong = "GoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')\n"
    _, made = asked_of(reader, said, [wrong] * 2, attempts=2)
    assert [bool(one.calls) for one in made] == [False, False]
    assert made[-1].refused is not None
    assert made[-1].refused.kind == "astray"


def test_answer_that_does_what_was_asked_is_carried_out_as_it_is(reader):
    right = "GoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')\n"
    _, (only,) = asked_of(reader, "bring me the mug", [right], attempts=2)
    assert only.completion.text == right


def test_what_a_sentence_asks_to_open_is_not_closed_behind_what_is_put_in(reader):
    (asked,) = reader.read("open the fridge and put the egg inside")
    closing = parse_program(
        "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\n"
        "PutObject(robot, 'Egg', 'Fridge')\nCloseObject(robot, 'Fridge')\n", SKILLS,
    )  # fmt: skip
    assert "CloseObject" not in {one.skill for one in Guard(asked, HERE).kept_open(closing)}
    for said in ("put the egg in the fridge", "open the fridge, put the egg in and close it"):
        (asked,) = reader.read(said)
        assert Guard(asked, HERE).kept_open(closing) == tuple(closing)


def text(calls):
    return [str(call) for call in calls]
