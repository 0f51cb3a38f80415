"""What a request hangs on is looked for where it would be, inside too, and of each thing."""

import pytest
from support.talking import STORE, TAKE, agent_saying

from karma.agent.seeing.perceive import place_of
from karma.household.places import HAND

EGG = "Explore(robot, 'Egg')\nPickupObject(robot, 'Egg')\n"


def doors(agent):
    """The doors that the agent has opened and closed so far."""
    actions = (one for errand in agent.home.past for one in errand.actions)
    return [
        (name, given["objectId"].split("|")[0]) for name, given in actions
        if name in ("OpenObject", "CloseObject")
    ]  # fmt: skip


def held(agent):
    """The type of what is in the hand."""
    seen = (sight for errand in agent.home.past for one in errand.changes for sight in one.seen)
    last = {sight.object_id: sight for sight in seen}
    return [one.object_type for one in last.values() if place_of(one) == HAND]


@pytest.mark.parametrize(
    ("text", "answers", "said"),
    [
        ("if there is an egg in the fridge, take it", [EGG], "the egg is in the hand: seen"),
        ("unless the egg is in the fridge, wash the apple", [], "that is so: seen"),
        ("if the apple is on the table, put it in the fridge", [STORE], "in the fridge: seen"),
        ("if you see a dirty plate, take the apple", [TAKE], "the apple is in the hand: seen"),
        ("check whether the fridge is open and if not, take the apple", [TAKE], "hand: seen"),
        ("if the microwave is empty, take the apple", [TAKE], "the apple is in the hand: seen"),
    ],
)
def test_a_condition_that_holds_is_seen_and_the_rest_is_done(tmp_path, text, answers, said):
    agent = agent_saying(tmp_path, answers)
    reply = agent.do(text)
    assert reply.status == "done"
    assert said in str(reply)
    assert bool(held(agent)) == ("in the hand" in str(reply))


@pytest.mark.parametrize(
    "text",
    [
        "if there is an apple in the fridge, take it",
        "if the apple is in the fridge, slice it",
        "take the apple unless the egg is in the fridge",
        "if the fridge is empty, put the apple in it",
    ],
)
def test_a_condition_that_does_not_hold_is_looked_for_behind_doors(tmp_path, text):
    agent = agent_saying(tmp_path, [])
    reply = agent.do(text)
    assert "so: seen" in str(reply)
    assert doors(agent) == [("OpenObject", "Fridge"), ("CloseObject", "Fridge")]
    assert held(agent) == []


@pytest.mark.parametrize(
    "text",
    [
        "if the fridge is open and the candle is off, take the apple",
        "if the fridge or the microwave is open, take the apple",
        "if there are two eggs in the fridge, take one",
        "if there is a mug near the sink, take the apple",
        "unless they are on the table, put the mugs in the sink",
    ],
)
def test_a_condition_of_more_than_one_thing_or_place_is_not_guessed_at(tmp_path, text):
    agent = agent_saying(tmp_path, [])
    assert agent.do(text).status in ("refused", "asked")
    assert held(agent) == []
