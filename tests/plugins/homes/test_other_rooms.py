"""What is said of another room is answered from a home there, and never done or looked for here."""

import pytest
from support.household import kitchen
from support.talking import STORE, TAKE, resources

from karma import Agent
from karma.files import to_json
from karma.plugins.homes.home import homes


def in_room(folder, room, answers, home):
    """An agent in the kitchen made by hand, which goes by the name of a room."""
    scene = folder / f"{room}.json"
    scene.write_bytes(to_json(kitchen()))
    number = len(list(folder.glob("run-*")))
    loaded = resources(answers, maps=folder / "maps")
    run = folder / f"run-{number}"
    return Agent(str(scene), resources=loaded, folder=run, maps=folder / "maps",
                 options={"guard": True}, home=home)  # fmt: skip


@pytest.fixture(scope="module")
def agent(tmp_path_factory):
    """In a kitchen in which nothing was done; the apple of the bedroom is in its fridge."""
    folder = tmp_path_factory.mktemp("rooms")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for room, home, answers in (("bedroom_a", "bed", [STORE]), ("bathroom_a", "bath", [TAKE])):
            there = in_room(folder, room, answers, home)
            said = "put the apple in the fridge" if home == "bed" else "take the apple"
            assert there.do(said)
            there.home.leave()
        yield in_room(folder, "kitchen_a", [], "cook")


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("where is the apple in the bedroom?", "The apple is in the fridge, seen just now"),
        ("is the apple in the bedroom?", "Yes: the apple is in the fridge, seen just now"),
        ("is there an apple in the bathroom?", "Yes: the apple is in the hand"),
        ("how many apples are in the bedroom?", "1 that I have seen: in the fridge"),
        ("what is in the bedroom?", "I have seen the apple in the fridge"),
        ("is the bedroom fridge open?", "No, the fridge is not open"),
        ("did you put the apple in the fridge in the bedroom?", "Yes, just now: put the apple"),
        ("is there a vase in the other room?", "I have not seen any vase there."),
    ],
)
def test_question_about_another_room_is_answered_from_the_home_there(agent, said, told):
    reply = agent.do(said)
    assert told in str(reply), reply
    assert "In the home b" in str(reply)
    assert "go and see" not in str(reply)
    assert (reply.status, agent.home.past) == ("answered", [])


@pytest.mark.parametrize(
    ("said", "status", "told"),
    [
        ("where is the apple in the living room?", "answered", "I know nothing of the living room"),
        ("take the apple to my bedroom", "refused", "Tell me there: karma chat --home bed"),
        ("put the apple in the bathroom sink", "refused", "This home is only a kitchen: I can do"),
        ("in the bedroom there is an apple, wash it", "refused", "I can do nothing in the bedroom"),
        ("go to the garage", "refused", "I can do nothing in the garage."),
        ("the apple is in the bedroom", "answered", "I keep nothing of the bedroom here."),
    ],
)
def test_nothing_is_done_here_for_what_is_in_another_room(agent, said, status, told):
    reply = agent.do(said)
    assert told in str(reply), reply
    assert (reply.status, agent.home.past) == (status, [])


@pytest.mark.parametrize("said", ["I am in the bedroom, take the apple", "take the apple here"])
def test_room_of_whoever_asks_is_no_place_of_the_errand(tmp_path, said):
    agent = in_room(tmp_path, "kitchen_a", [TAKE], None)
    assert agent.do(said).status == "done"
    for asked in ("is the apple in the kitchen?", "what is in the kitchen?"):
        assert "apple" in str(agent.do(asked).parts[0].answer.lines)
    assert "in the hand" in str(agent.do("what did you see in the kitchen?"))


def test_home_that_is_asked_about_is_left_as_it_is(agent):
    (log,) = (one / "log.jsonl" for one in homes() if one.name == "bed")
    torn = log.read_bytes() + b'{"said": "half'  # another process is writing it
    log.write_bytes(torn)
    assert "in the fridge" in str(agent.do("where is the apple in the bedroom?"))
    assert log.read_bytes() == torn
