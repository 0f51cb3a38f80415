"""What an errand changes besides is put back; what may be two things is asked; yes goes on."""

import pytest
from support.household import kitchen, on
from support.talking import STORE, TAKE, agent_saying

from karma.agent.planning.program import parse_program
from karma.files import to_json
from karma.plugins.rules.language.clauses import completed
from karma.plugins.rules.method import reader_of
from karma.plugins.rules.request_checker import Guard
from karma.plugins.rules.talk.offers import is_no, is_yes, offered, pending

HERE = ("Apple", "Bowl", "CounterTop", "DiningTable", "Fridge", "Mug", "Sink", "Faucet")
OPENED = "OpenObject(robot, 'Fridge')\nPutObject(robot, 'Apple', 'Fridge')\n"
CUT = "GoToObject(robot, 'Knife')\nPickupObject(robot, 'Knife')\nSliceObject(robot, 'Apple')\n"


def objects(agent):
    return {one["objectId"]: one for one in agent._world.last_event.metadata["objects"]}


def of(agent, kind):
    return next(one for one in objects(agent).values() if one["objectType"] == kind)


@pytest.fixture(scope="module")
def reader():
    return reader_of(None)


def objection(reader, text, program, *, exact=False):
    (request,) = reader.read(text)
    return Guard(request, HERE).stopped(parse_program(program), exact=exact)


# ----------------------------------------------------------------- put back


def test_a_door_that_was_opened_on_the_way_is_shut_again(tmp_path):
    agent = agent_saying(tmp_path, [TAKE + OPENED])
    assert agent.do("put the apple in the fridge").status == "done"
    assert not of(agent, "Fridge")["isOpen"]


def test_a_door_that_was_to_be_open_stays_so(tmp_path):
    agent = agent_saying(tmp_path, ["OpenObject(robot, 'Fridge')\n"])
    assert agent.do("open the fridge").status == "done"
    assert of(agent, "Fridge")["isOpen"]


def test_a_tool_goes_back_to_where_it_was_taken_from(tmp_path):
    agent = agent_saying(tmp_path, [CUT])
    before = of(agent, "Knife")["parentReceptacles"]
    reply = agent.do("slice the apple")
    assert reply.status == "done"
    assert of(agent, "Knife")["parentReceptacles"] == before
    assert not any("knife is in the hand" in check.text for check in reply.checks)


def test_what_ran_for_it_is_off_again(tmp_path):
    agent = agent_saying(
        tmp_path,
        ["GoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')\n"
         "GoToObject(robot, 'CoffeeMachine')\nPutObject(robot, 'Mug', 'CoffeeMachine')\n"
         "ToggleOn(robot, 'CoffeeMachine')\n"],
    )  # fmt: skip
    assert agent.do("make a mug of coffee").status == "done"
    assert not of(agent, "CoffeeMachine")["isToggled"]
    assert of(agent, "Mug")["isFilledWithLiquid"]


# ----------------------------------------------------------------- more than was named


def test_two_of_a_kind_are_not_done_where_one_was_named(reader, tmp_path):
    twice = STORE + STORE
    assert "2 of a kind" in objection(reader, "put the apple in the fridge", twice)
    assert objection(reader, "put two apples in the fridge", twice) == ""
    assert objection(reader, "put all apples in the fridge", twice) == ""
    agent = agent_saying(tmp_path, [twice])  # said twice: it is done once
    reply = agent.do("put the apple in the fridge")
    assert reply.status == "done"
    puts = [one for part in reply.parts for one in part.results if one.call.skill == "PutObject"]
    assert len(puts) == 1


def test_what_lies_in_a_thing_may_come_along(reader):
    along = (
        "PickupObject(robot, 'Apple')\nPutObject(robot, 'Apple', 'Bowl')\n"
        "PickupObject(robot, 'Bowl')\nPutObject(robot, 'Bowl', 'DiningTable')\n"
    )
    assert objection(reader, "put the bowl with the apple on the dining table", along) == ""
    assert "apple to be moved" in objection(reader, "put the bowl on the dining table", along)


def test_a_mug_is_a_cup_only_if_no_cup_was_meant_before(reader):
    mug = "PickupObject(robot, 'Mug')\nPutObject(robot, 'Mug', 'Sink')\n"
    assert objection(reader, "put the cup in the sink", mug) == ""
    assert "does not put the cup" in objection(reader, "put the cup in the sink", mug, exact=True)


@pytest.mark.parametrize(
    ("name", "own", "other"),
    [("old chair", "Chair", "ArmChair"), ("shelf", "Shelf", "ShelvingUnit"),
     ("table", "", "SideTable"), ("stand", "", "TVStand")],
)  # fmt: skip
def test_what_is_one_by_its_name_only_will_not_do_where_one_was_seen(reader, name, own, other):
    def why(place, *here):
        program = f"PickupObject(robot, 'Apple')\nPutObject(robot, 'Apple', '{place}')\n"
        (request,) = reader.read(f"put the apple on the {name}")
        return Guard(request, (*HERE, *here)).stopped(parse_program(program))

    if own:
        assert "does not put" in why(other, other, own)
        assert why(own, other, own) == ""
    else:
        assert why(other, other) == ""


def test_what_a_thing_lies_in_may_be_brought_along(reader):
    along = (
        "PickupObject(robot, 'Apple')\nPutObject(robot, 'Apple', 'Bowl')\n"
        "PickupObject(robot, 'Bowl')\nPutObject(robot, 'Bowl', 'DiningTable')\n"
    )
    assert objection(reader, "put the apple in the bowl on the dining table", along) == ""
    assert objection(reader, "put the apple in the bowl, put it on the dining table", along) == ""
    elsewhere = along.replace("DiningTable", "Sink")
    text = "put the apple in the bowl on the dining table"
    assert "does not put the apple" in objection(reader, text, elsewhere)


def test_what_was_to_be_put_near_a_thing_is_not_put_into_it(reader):
    program = "PickupObject(robot, 'Apple')\nPutObject(robot, 'Apple', 'Sink')\n"
    (request,) = reader.read("put the apple next to the sink")
    beside = Guard(request, HERE).put_near(parse_program(program))
    assert [call.skill for call in beside] == ["PickupObject", "PutNear"]
    assert Guard(request, HERE).stopped(beside) == ""
    (request,) = reader.read("wash the apple and put it near the fridge")
    washed = "PutObject(robot, 'Apple', 'Sink')\nToggleOn(robot, 'Faucet')\n"
    put = "PutObject(robot, 'Apple', 'CounterTop')\n"
    calls = Guard(request, HERE).put_near(parse_program(washed + put))
    assert [str(call) for call in calls][::2] == [
        "PutObject(robot, 'Apple', 'Sink')", "PutNear(robot, 'Apple', 'Fridge')",
    ]  # fmt: skip


# ----------------------------------------------------------------- asked


def test_which_of_two_is_asked_where_nothing_takes_it_back(tmp_path):
    table = next(one for one in kitchen().objects if one.type == "DiningTable")
    more = kitchen(extra=(on(table, "Egg", 1.7, 0.1, size=(0.06, 0.06, 0.06)),))
    (tmp_path / "handmade.json").write_bytes(to_json(more))
    ways = ["OpenObject(robot, 'Fridge')\n"]
    away = "PickupObject(robot, 'Egg')\nPutObject(robot, 'Egg', 'GarbageCan')\n"
    agent = agent_saying(tmp_path, [*ways, away])
    for text in ("find the egg", "open the fridge"):  # it has seen both eggs now
        assert agent.do(text).status == "done"
    before = {name: one["parentReceptacles"] for name, one in objects(agent).items()}
    reply = agent.do("throw the egg away")
    assert reply.status == "asked" and "Which one?" in str(reply)
    assert sorted(pending(reply).candidates) == [
        "the egg in the fridge", "the egg on the dining table",
    ]  # fmt: skip
    assert before == {name: one["parentReceptacles"] for name, one in objects(agent).items()}
    assert completed(pending(reply).text, "the one in the fridge", pending(reply).about) == (
        "throw the egg in the fridge away"
    )


@pytest.mark.parametrize(
    ("text", "offer"),
    [
        ("wash the mug in twenty minutes", "wash the mug"),
        ("wash the plat", "wash the plate"),
        ("the plate is filthy", "wash the plate"),
        ("the fridge is open", "close the fridge"),
    ],
)
def test_yes_asks_for_what_was_offered(tmp_path, text, offer):
    reply = agent_saying(tmp_path, [STORE]).do(text)
    assert (reply.status, offered(reply)) == ("refused", offer)


def test_yes_and_no():
    assert is_yes("yes") and is_yes("Sure, go ahead!") and is_yes("do it")
    assert is_no("no thanks") and is_no("never mind")
    assert not is_yes("put it there") and not is_no("no, the blue one") and not is_yes("it")
