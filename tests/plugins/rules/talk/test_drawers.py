"""The desk drawer is one of the desk's: by the eyes, from where the boxes stand."""

import json
from pathlib import Path

import pytest

import karma.world
from karma import Agent

ROOM = Path(karma.world.__file__).parent / "scenes" / "bedroom_3.json"


def drawers_of(kind):
    """The ids of the drawers whose middle is within a piece of furniture, by the room's file."""
    objects = json.loads(ROOM.read_bytes())["objects"]
    (whole,) = (one for one in objects if one["type"] == kind)
    x, z = whole["position"][0], whole["position"][2]
    wide, deep = whole["size"][0] / 2, whole["size"][2] / 2
    drawers = (one for one in objects if one["type"] == "Drawer")
    return {
        one["id"] for one in drawers
        if abs(one["position"][0] - x) < wide and abs(one["position"][2] - z) < deep
    }  # fmt: skip


@pytest.fixture(scope="module")
def agent(tmp_path_factory):
    return Agent("bedroom_3", planner="karma-nano", folder=tmp_path_factory.mktemp("drawers"))


def last(agent, action):
    return {given["objectId"] for name, given in agent.home.past[-1].actions if name == action}


def test_a_drawer_is_one_of_what_was_named(agent):
    assert agent.do("put the pen in the desk drawer").status == "done"
    assert last(agent, "OpenObject") and last(agent, "OpenObject") <= drawers_of("Desk")
    assert agent.do("open the drawers of the dresser").status == "done"
    assert last(agent, "OpenObject") == drawers_of("Dresser")
    assert "at the dresser" in str(agent.do("which drawers are open?"))
    assert agent.do("close the dresser drawers").status == "done"
    assert last(agent, "CloseObject") == drawers_of("Dresser")


def test_an_answer_is_of_that_drawer_alone(agent):
    assert agent.do("put the book in the side table's drawer").status == "done"
    answer = str(agent.do("what is in the desk drawer?"))
    assert "the pen" in answer and "the book" not in answer


def test_furniture_without_drawers_has_none(agent):
    reply = agent.do("put the pencil in the bed's drawer")
    assert reply.status != "done"
    assert "I found no" in str(reply)


def test_them_are_all_and_the_one_is_not_what_is_so_already(tmp_path):
    agent = Agent("living_4", planner="karma-nano", folder=tmp_path)

    def so(kinds, state):
        found = agent._world.last_event.metadata["objects"]
        return sorted(
            one["objectType"] for one in found if one[state] and one["objectType"] in kinds
        )

    assert agent.do("open the drawers of the tv stand").status == "done"
    assert agent.do("put a book from the coffee table in the dresser drawers").status == "done"
    assert "Yes. In the drawer: the book" in str(agent.do("is anything in the dresser's drawers?"))
    assert "Yes" in str(agent.do("did you leave any drawer open?"))
    assert so(["Drawer"], "isOpen") == ["Drawer", "Drawer"]
    assert agent.do("close them").status == "done"
    assert so(["Drawer"], "isOpen") == []
    assert agent.do("turn off the floor lamp").status == "done"
    assert agent.do("turn off the lamp").status == "done"
    assert so(["DeskLamp", "FloorLamp"], "isToggled") == []
