"""All that runs is switched off, and what is told by the others is asked about."""

import re

import pytest

from karma import Agent


@pytest.fixture(scope="module")
def agent(tmp_path_factory):
    return Agent("kitchen_2", planner="karma-nano", folder=tmp_path_factory.mktemp("everything"))


def still_on(agent):
    """The types of what is on by the world's own word."""
    found = agent._world.last_event.metadata["objects"]
    return {one["objectType"] for one in found if one["isToggled"]}


def test_everything_off_is_also_what_runs_and_is_no_lamp(agent):
    assert agent.do("turn the stove on under the pan").status == "done"
    (pan,) = (
        one for one in agent._world.last_event.metadata["objects"] if one["objectType"] == "Pan"
    )
    controlled = [
        burner for one in agent._world.last_event.metadata["objects"]
        if one["objectType"] == "StoveKnob" and one["isToggled"]
        for burner in one["controlledObjects"]
    ]  # fmt: skip
    assert controlled == [one for one in pan["parentReceptacles"] if "StoveBurner" in one]
    assert agent.do("turn on the tap").status == "done"
    assert still_on(agent) >= {"StoveKnob", "Faucet", "LightSwitch"}
    assert agent.do("turn everything off").status == "done"
    assert not still_on(agent) & {"StoveKnob", "Faucet", "LightSwitch"}


@pytest.mark.parametrize("text", ["the smaller of the spoons", "the nearer spoon"])
def test_what_only_the_others_tell_apart_is_asked_about(agent, text):
    assert agent.do(f"put {text} in the sink").status == "asked"


def test_a_question_after_an_order_is_of_the_same_thing(agent):
    reply = str(agent.do("open the fridge and tell me what's inside"))
    assert "In the fridge: " in reply and "the lettuce" in reply


def test_the_lamp_that_is_on_is_of_whichever_kind(tmp_path):
    agent = Agent("living_4", planner="karma-nano", folder=tmp_path)
    assert {"FloorLamp", "DeskLamp"} <= still_on(agent)
    assert agent.do("turn off the floor lamp").status == "done"
    assert agent.do("turn off whichever lamp is on").status == "done"
    assert not still_on(agent) & {"FloorLamp", "DeskLamp"}


def test_what_nobody_looked_into_is_not_said_to_be_empty(agent):
    agent.do("find the plate")
    actions = (one for errand in agent.home.past for one in errand.actions)
    opened = {given["objectId"] for name, given in actions if name == "OpenObject"}
    answer = str(agent.do("how many cabinets are empty?"))
    said = re.search(r"(\d+) that I have seen", answer)
    assert said is None or int(said[1]) <= sum("Cabinet" in one for one in opened)
    assert int(re.search(r"(\d+) that", str(agent.do("how many cabinets are there?")))[1]) > 1
