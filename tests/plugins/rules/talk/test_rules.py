"""What is forbidden for good holds for every request, in a search too, until it is taken back."""

import pytest
from support.talking import STORE, TAKE, WASH, agent_saying


def opened(agent):
    """What the agent has opened so far, by type."""
    actions = (one for errand in agent.home.past for one in errand.actions)
    return [given["objectId"].split("|")[0] for name, given in actions if name == "OpenObject"]


@pytest.mark.parametrize(
    "rule",
    ["never open the fridge", "Don't ever use the fridge.", "never put anything in the fridge"],
)
def test_what_a_rule_forbids_is_not_done_until_it_is_taken_back(tmp_path, rule):
    agent = agent_saying(tmp_path, [STORE, STORE])
    assert agent.do(rule).status == "answered"
    reply = agent.do("put the apple in the fridge")
    assert reply.status == "refused" and "You told me" in str(reply)
    assert not opened(agent)
    assert "no longer" in str(agent.do("forget that rule"))
    assert agent.do("put the apple in the fridge").status == "done"


def test_a_search_opens_nothing_that_is_to_stay_shut(tmp_path):
    agent = agent_saying(tmp_path, [])
    assert agent.do("find the spoon, but do not open any drawers").status == "unfinished"
    assert "Drawer" not in opened(agent)
    assert agent.do("find the spoon").status == "done"
    assert "Drawer" in opened(agent)


def test_a_rule_lasts_as_long_as_the_home_does(tmp_path):
    home = tmp_path / "home"
    agent = agent_saying(tmp_path, [], home=home)
    agent.do("never wash the apple")
    agent.home.leave()
    again = agent_saying(tmp_path, [TAKE + WASH, STORE], home=home)
    assert again.do("wash the apple").status == "refused"
    assert again.do("put the apple in the fridge").status == "done"
    assert "never wash the apple" in str(again.do("what did I tell you?"))
    assert again.do("you may wash the apple again").status == "answered"


def test_a_rule_of_one_thing_leaves_others_alone(tmp_path):
    agent = agent_saying(tmp_path, [STORE])
    agent.do("never touch the bread")
    assert agent.do("put the apple in the fridge").status == "done"
    assert agent.do("put the bread in the fridge").status == "refused"


@pytest.mark.parametrize(
    "text",
    ["never mind, don't do anything", "don't ever do that again", "never put dirty things away"],
)
def test_what_names_nothing_that_could_be_held_to_is_no_rule(tmp_path, text):
    agent = agent_saying(tmp_path, [STORE])
    assert agent.do(text).status != "answered"
    assert agent.do("put the apple in the fridge").status == "done"
