"""No false "done", whatever the planner: requests carried out as they were said, or told of."""

import msgspec
import pytest
from support.asked import AskedRequest, verdict
from support.talking import AWAY, STORE, TAKE, WASH, agent_saying

from karma.agent.planning.program import parse_program
from karma.cli.conversation import CODES
from karma.plugins.rules.method import reader_of
from karma.plugins.rules.program_effects import effects_of
from karma.plugins.rules.request_checker import Guard, cannot_serve, here_of
from karma.plugins.rules.talk.offers import offered, pending

HERE = ("Apple", "Bowl", "CounterTop", "Fridge", "Mug", "Sink", "Faucet", "Microwave", "Toaster")
CUT = "PickupObject(robot, 'Knife')\nSliceObject(robot, 'Apple')\n"


@pytest.fixture(scope="module")
def reader():
    return reader_of(None)


def objection(reader, text, program):
    (request,) = reader.read(text)
    return Guard(request, HERE).stopped(parse_program(program))


# ----------------------------------------------------------------- a program against the words


@pytest.mark.parametrize(
    ("text", "program"),
    [
        ("put the apple in the fridge", STORE),
        ("wash the apple", TAKE + WASH),
        ("take the apple", TAKE),
        ("slice the apple", CUT),
        ("put the apple in the fridge but don't slice it", STORE),
        ("chill the apple", STORE),
        ("open the fridge", "OpenObject(robot, 'Fridge')\n"),
        ("turn the tap on", "ToggleOn(robot, 'Faucet')\n"),
        ("throw the apple away", TAKE + "PutObject(robot, 'Apple', 'GarbageCan')\n"),
    ],
)
def test_right_programs_pass(reader, text, program):
    assert objection(reader, text, program) == ""


@pytest.mark.parametrize(
    ("text", "program", "reason"),
    [
        ("put the apple in the fridge", TAKE, "does not put the apple"),
        ("put the mug in the fridge", STORE, "does not put the mug"),
        ("put the apple in the sink", STORE, "does not put the apple"),
        ("put the apple in the fridge", STORE + CUT, "nobody asked"),
        ("put the apple in the fridge", STORE.replace("Apple", "Mug") + STORE, "mug to be moved"),
        ("put the apple in the fridge", STORE + TAKE, "does not put the apple"),
        ("wash the apple", TAKE + WASH.replace("ToggleOn(robot, 'Faucet')\n", ""), "not wash"),
        ("put the apple in the sink but don't wash it", TAKE + WASH, "says not to wash"),
        ("chill the apple", STORE.replace("CloseObject(robot, 'Fridge')\n", ""), "not chill"),
        ("open the fridge", "OpenObject(robot, 'Fridge')\nCloseObject(robot, 'Fridge')\n", "open"),
        ("put the apple in the fridge instead of the sink",
         TAKE + "PutObject(robot, 'Apple', 'Sink')\n" + STORE, "not to use the sink"),
        ("take the apple", TAKE + "ThrowObject(robot, 'Apple')\n", "does not take"),
        ("turn the tap on", "ToggleOn(robot, 'Toaster')\nToggleOn(robot, 'Faucet')\n", "toaster"),
    ],
)  # fmt: skip
def test_wrong_programs_are_stopped_with_the_reason(reader, text, program, reason):
    assert reason in objection(reader, text, program)


def test_effects_follow_what_is_carried_in_something():
    program = parse_program(
        "PickupObject(robot, 'Apple')\nPutObject(robot, 'Apple', 'Bowl')\n"
        "PickupObject(robot, 'Bowl')\nPutObject(robot, 'Bowl', 'Fridge')\n"
        "CloseObject(robot, 'Fridge')\n"
    )
    found = effects_of(program)
    assert found.places(("Apple", 0)) == {"Bowl", "Fridge"}
    assert found.did("cool", ("Apple",))


def test_what_is_nowhere_here_is_no_candidate():
    assert here_of(("DeskLamp", "FloorLamp"), ("DeskLamp",)) == ("DeskLamp",)
    assert here_of(("Curtains",), HERE) == ()
    assert here_of(("Apple",), ()) == ("Apple",)
    assert here_of(("Spoon",), HERE) == ("Spoon",)  # it may lie in something


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("why is the fridge open?", "question"),
        ("my uncle likes the apple", "statement"),
        ("put the apple in", "incomplete"),
        ("put the apple in the fridge at noon", "time"),
        ("put the walnut in the fridge", "thing"),
        ("put the apple in the wardrobe", "place"),
        ("put the fridge in the sink", "impossible"),
        ("knit the apple", "deed"),
        ("don't touch the apple", "negated"),
        ("coupe la pomme en deux", "language"),
    ],
)
def test_what_no_planner_can_serve_is_refused_before_one_is_asked(reader, tmp_path, text, kind):
    requests = reader.read(text)
    refused = cannot_serve(requests[0], HERE)
    assert refused is not None and refused.kind == kind
    agent = agent_saying(tmp_path, [])  # a script that has run out: nobody may ask it
    before = agent._world.last_event.metadata["objects"]
    reply = agent.do(text)
    assert reply.status in ("refused", "asked") and not reply
    assert agent._world.last_event.metadata["objects"] == before


# ----------------------------------------------------------------- what is said at the end


@pytest.mark.parametrize(
    ("text", "status", "code"),
    [
        ("put the apple in the fridge", "done", 0),
        ("put the apple in", "asked", 5),
        ("put the walnut in the fridge", "refused", 3),
    ],
)
def test_statuses_and_codes(tmp_path, text, status, code):
    reply = agent_saying(tmp_path, [STORE]).do(text)
    assert (reply.status, CODES[reply.status]) == (status, code)
    if status == "asked":
        assert pending(reply) is not None and pending(reply).question


def test_a_stubborn_planner_is_not_followed(tmp_path):
    """Its program is not carried out; what is is that of the words, where they tell what is meant.

    Which bowl is the clean one, they do not.
    """
    agent = agent_saying(tmp_path, [STORE, STORE])
    reply = agent.do("put the bowl in the fridge")
    assert {call.objects[0] for one in reply.parts[0].plans for call in one.calls} >= {"Bowl"}
    assert "Apple" not in {
        name for one in reply.parts[0].plans for c in one.calls for name in c.objects
    }
    assert agent.do("put the clean bowl in the fridge").status == "done"  # it lies there already
    reply = agent.do("put the clean bowl in the sink")
    assert reply.status == "refused"
    assert "does not put the clean bowl" in repr(reply)
    assert not reply.parts[0].results


def test_what_was_done_already_is_not_done_again(tmp_path):
    agent = agent_saying(tmp_path, [TAKE + WASH + STORE])
    reply = agent.do("wash the apple and put it in the fridge")
    assert [part.status for part in reply.parts] == ["done", "done"]


def test_it_stands_for_what_was_spoken_of_before(tmp_path):
    agent = agent_saying(tmp_path, [TAKE + WASH, TAKE + AWAY])
    assert agent.do("wash the apple")
    assert agent.do("put it in the fridge")


@pytest.mark.parametrize(
    ("scene", "text", "status", "told"),
    [
        ("kitchen_3", "wash all three forks", "partly", "2 of 3: forks; I found no more: no"),
        ("living_1", "all lights off", "done", "3 of 3: lights: seen"),
        ("living_1", "switch off everything except the television", "done", "3 of 3"),
        ("kitchen_1", "clean all the dirty things", "done", "4 of 4"),
        (
            "kitchen_2",
            "put the forks in a bowl on the table",
            "done",
            "the bowl is on the dining table",
        ),
        ("kitchen_1", "put two eggs in the pot on the stove", "done", "2 of 2: eggs"),
        (
            "kitchen_1",
            "move the plate from the counter to the sink",
            "done",
            "was on the counter top: not seen",
        ),
        ("kitchen_2", "wash the pan if it is dirty", "done", "that is not so"),
        ("kitchen_2", "if the pan is clean, put it in the sink", "done", "pan is in the sink"),
    ],
)
def test_plurals_and_conditions_belong_to_the_agent(agent_in, scene, text, status, told):
    reply = agent_in(scene).do(text)
    assert reply.status == status
    assert told in repr(reply)
    assert reply.status != "done" or all(check.found != "otherwise" for check in reply.checks)


OPEN, SHUT = "OpenObject(robot, '{}')\n", "CloseObject(robot, '{}')\n"
CLOSING = [OPEN.format("Fridge"), OPEN.format("Microwave"), SHUT.format("Fridge"),
           SHUT.format("Microwave")]  # fmt: skip


def test_things_are_told_by_their_state_which_is_no_deed(tmp_path):
    """ "Close what is open" opens nothing, and leaves what is shut alone."""
    text = "close everything that is open"
    agent = agent_saying(tmp_path, CLOSING)
    assert agent.do("open the fridge")
    assert agent.do("open the microwave")
    reply = agent.do(text)
    assert reply.status == "done"
    done = {one.call.skill for part in reply.parts for one in part.results if one.ok}
    assert "CloseObject" in done
    assert "OpenObject" not in done
    assert agent.do("is anything open?").parts[0].answer.lines == ("Nothing that I have seen.",)
    again = agent.do(text)
    assert again.status == "done"
    assert {one.call.skill for one in again.parts[0].results} <= {"GoToObject"}  # it looks
    assert "nothing that I have seen is open" in str(again)


def test_otherwise_is_not_looked_at_again_after_the_first_deed(tmp_path):
    """The fridge that was closed is shut by then; it was not to be opened again."""
    text = "if the fridge is open, close it, otherwise open it"
    opened, shut = OPEN.format("Fridge"), SHUT.format("Fridge")
    agent = agent_saying(tmp_path, [opened, shut, opened])
    assert agent.do("open the fridge")
    for now in ("closed", "open"):
        assert agent.do(text).status == "done"
        assert agent.do(f"is the fridge {now}?").parts[0].answer.lines[0].startswith("Yes")


def test_one_that_was_cut_is_then_meant_by_its_pieces(tmp_path):
    stack = TAKE + "PutObject(robot, 'Apple', 'Plate')\n"
    agent = agent_saying(
        tmp_path, ["PickupObject(robot, 'Knife')\nSliceObject(robot, 'Apple')\n", stack]
    )
    agent.do("find the apple")
    agent.do("find the plate")
    reply = agent.do("slice the apple and put it on the plate")
    assert [part.status for part in reply.parts] == ["done", "done"]
    assert agent.do("is the apple on the plate?").parts[0].answer.lines[0].startswith("Yes")


def test_another_is_none_of_those_that_were_put_there_before(agent_in):
    agent = agent_in("bedroom_1")
    assert agent.do("put a book on the bed")
    assert agent.do("put another book on the bed")
    things = agent._world.last_event.metadata["objects"]
    books = [one["parentReceptacles"] for one in things if one["objectType"] == "Book"]
    assert sum(parents is not None and "Bed|" in parents[0] for parents in books) == 2


@pytest.mark.parametrize(
    ("scene", "turns", "changed"),
    [
        ("living_2", ["put the watch that is on the side table on the shelf"], ["Watch on Shelf"]),
        ("bathroom_2", ["wash every cloth except the one in the drawer"], ["Cloth on Bathtub"]),
        ("kitchen_3", ["wash the mug that's in the sink, not the other one"], ["Mug clean"]),
        ("bedroom_1", ["put a book on the shelf", "put the other books on the bed"],
         ["Book on Bed", "Book on Bed", "Book on Shelf"]),
        ("bedroom_3", ["sit the teddy bear on the bed", "no, on the armchair"],
         ["TeddyBear on ArmChair"]),
        ("living_1", ["turn off the floor lamp", "turn off the other lamp"],
         ["DeskLamp off", "FloorLamp off"]),
        ("kitchen_2", ["put the dirty mug next to the sink"], ["Mug on CounterTop"]),
        ("kitchen_1", ["fill the kettle with coffee", "put the egg in the second drawer",
                       "wash the bowl by the clean plate", "find all the mugs"], []),
    ],
)  # fmt: skip
def test_what_words_tell_apart_is_what_is_changed(agent_in, scene, turns, changed):
    """By the world's true state: the one that was meant, no other of its kind."""
    agent = agent_in(scene)
    before = agent._world.last_event.metadata["objects"]
    for turn in turns:
        agent.do(turn)
    after = {one["objectId"]: one for one in agent._world.last_event.metadata["objects"]}
    found = [how for one in before for how in _how_it_changed(one, after[one["objectId"]])]
    assert sorted(found) == changed


def _how_it_changed(was, now):
    """Yield where a thing has come to lie, and whether it was cleaned or turned off."""
    kind = was["objectType"]
    if was["parentReceptacles"] != now["parentReceptacles"]:
        yield f"{kind} on {now['parentReceptacles'][0].split('|')[0]}"
    elif was["isDirty"] and not now["isDirty"]:
        yield f"{kind} clean"
    if was["isToggled"] and not now["isToggled"]:
        yield f"{kind} off"


def test_all_furniture_of_a_kind_has_its_turn(agent_in):
    agent = agent_in("bedroom_4")
    assert "8 of 8: drawers" in repr(agent.do("open all the drawers"))
    things = agent._world.last_event.metadata["objects"]
    assert all(one["isOpen"] for one in things if one["objectType"] == "Drawer")
    assert agent.do("close all of them but the first").status == "asked"
    asked = agent.do("close the top drawer")
    assert (asked.status, offered(asked)) == ("asked", "close the drawer")


def test_each_thing_that_they_stand_for_is_carried(agent_in):
    """Neither has a place of its own in the text, so one was once taken for the other."""
    agent = agent_in("kitchen_1")
    assert agent.do("put the fork and the spoon in the sink")
    assert agent.do("put them on the table")
    where = {
        one["objectType"]: one["parentReceptacles"][0].split("|")[0]
        for one in agent._world.last_event.metadata["objects"]
        if one["objectType"] in ("Fork", "Spoon")
    }
    assert where == {"Fork": "DiningTable", "Spoon": "DiningTable"}


# ----------------------------------------------------------------- the judge


def test_the_judge_tells_what_was_said_from_what_is_so():
    do = AskedRequest(id="a", kind="x", scene="s", text="t", act="do")
    assert verdict(do, "done", met=True, changed=True) == "right"
    assert verdict(do, "done", met=False, changed=True) == "wrong and said done"
    assert verdict(do, "unfinished", met=False, changed=True) == "wrong and said so"
    assert verdict(do, "refused", met=False, changed=False) == "refused or asked wrongly"
    ask = replace_act(do, "ask")
    assert verdict(ask, "asked", met=False, changed=False) == "asked rightly"
    assert verdict(ask, "done", met=True, changed=False) == "wrong and said done"
    assert verdict(ask, "refused", met=False, changed=True) == "wrong and said so"
    partly = replace_act(do, "partly")
    assert verdict(partly, "partly", met=True, changed=True) == "right"
    assert verdict(partly, "done", met=True, changed=True) == "wrong and said done"


def replace_act(one, act):
    return msgspec.structs.replace(one, act=act)
