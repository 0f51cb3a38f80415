"""All that runs is switched off, and what only a size tells apart is not said to be that."""

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


def test_the_smaller_of_two_is_one_and_not_said_to_be_seen(agent):
    reply = agent.do("put the smaller of the spoons in the sink")
    assert "whether that is the smaller one: not seen" in str(reply)
    lying = [
        one for one in agent._world.last_event.metadata["objects"]
        if one["objectType"] == "Spoon" and "Sink" in str(one["parentReceptacles"])
    ]  # fmt: skip
    assert len(lying) == 1


def test_a_question_after_an_order_is_of_the_same_thing(agent):
    reply = str(agent.do("open the fridge and tell me what's inside"))
    assert "In the fridge: " in reply and "the lettuce" in reply
