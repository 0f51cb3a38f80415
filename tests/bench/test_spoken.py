"""What is said to an agent in its room, and what the record says of it; the model is scripted."""

import pytest

from karma import registry
from karma.agent.planner import Planner
from karma.bench.spoken import Talk
from karma.contracts import Decoding
from karma.infer.scripted import ScriptedModel
from karma.infer.vision.metadata import MetadataVision
from karma.memory.recall import CosineRecall
from karma.methods.karma import KarmaMethod, KarmaSettings
from karma.tasks.requests import SaidRequest, SeveralRequests, WantedClause
from karma.world.sim import EmbeddedWorld

FRIDGE_OPEN = "GoToObject(robot, 'Fridge')\nOpenObject(robot, 'Fridge')\n"
LIGHT_OFF = "GoToObject(robot, 'LightSwitch')\nToggleOff(robot, 'LightSwitch')\n"
OPEN = WantedClause(clause="open the fridge", goals=("OPEN(Fridge)",))
OFF = WantedClause(clause="turn off the light", goals=("TOGGLEOFF(LightSwitch)",))


@pytest.fixture(scope="module")
def talk(tmp_path_factory):
    """A function that makes a talk with an agent whose model says the given answers."""
    recall = CosineRecall(registry.load("embedders", "minilm")())
    folder = tmp_path_factory.mktemp("talk")
    world = EmbeddedWorld()

    def talk_with(*answers):
        planner = Planner(ScriptedModel(answers), "compact", Decoding(refusing=True))
        settings = KarmaSettings(attempts=1)
        method = KarmaMethod(planner, recall, MetadataVision(), settings, maps=folder / "maps")
        return Talk(method=method, world=world, folder=folder)

    return talk_with


def sentence(kind, *requests):
    return SeveralRequests(
        id="s", kind=kind, scene="kitchen_1", text="said", requests=tuple(requests)
    )


def test_request_that_is_refused_is_recorded_with_its_reason(talk):
    said = SaidRequest(id="a", kind="thing", scene="kitchen_1", text="Feed the cat.")
    record = talk("refuse('thing')\n").one(said)
    assert (record.refused, record.programs, record.reached) == (
        "thing", (("refuse('thing')",),), None,
    )  # fmt: skip


def test_request_that_should_be_refused_ends_with_the_first_program(talk):
    said = SaidRequest(id="a", kind="thing", scene="kitchen_1", text="Feed the cat.")
    record = talk(FRIDGE_OPEN).one(said)  # a second answer would find the script at its end
    assert record.refused == ""
    assert len(record.programs) == 1


@pytest.mark.parametrize(
    ("answer", "reached"), [(FRIDGE_OPEN, True), (LIGHT_OFF, False), ("refuse('deed')\n", False)]
)
def test_request_is_done_when_its_goals_hold_in_the_room(talk, answer, reached):
    said = SaidRequest(
        id="a", kind="plain", scene="kitchen_1", text="Open the fridge.", goals=("OPEN(Fridge)",)
    )
    record = talk(answer).one(said)
    assert record.reached is reached
    assert bool(record.refused) is answer.startswith("refuse")


def test_thing_handled_before_is_what_the_prompt_tells_of(talk):
    said = SaidRequest(
        id="a", kind="memory", scene="kitchen_1", text="Wash it.", goals=("STATE(Mug, cleaned)",),
        handled=("Mug",),
    )  # fmt: skip
    spoken = talk(FRIDGE_OPEN)
    spoken.one(said)
    assert "Mug" in spoken.method.planner.model.prompts[0].changing


@pytest.mark.parametrize(
    ("kind", "answers", "reached"),
    [
        ("before", (FRIDGE_OPEN, LIGHT_OFF), True),
        ("before", (LIGHT_OFF, FRIDGE_OPEN), False),  # in the wrong order
        ("and", (LIGHT_OFF, FRIDGE_OPEN), True),  # no order was asked for
        ("and", (FRIDGE_OPEN, FRIDGE_OPEN), False),
    ],
)
def test_sentence_is_done_when_every_request_is_in_the_order_asked_for(
    talk, kind, answers, reached
):
    clauses = ("open the fridge", "turn off the light")
    record = talk(*answers).several(sentence(kind, OPEN, OFF), "by hand", lambda said: clauses)
    assert (record.splitter, record.clauses, record.split) == ("by hand", clauses, True)
    assert record.reached is reached


def test_sentence_left_whole_is_not_cut_right(talk):
    record = talk(FRIDGE_OPEN).several(sentence("and", OPEN, OFF), "whole", lambda said: ["x"])
    assert (record.split, record.reached) == (False, False)
