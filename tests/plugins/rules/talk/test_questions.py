"""Questions are answered from what was seen and done; nothing is done for one."""

import pytest
from support.talking import AWAY, STORE, TAKE, WASH, agent_saying

from karma import Agent
from karma.plugins.rules.talk.remembering import age


@pytest.fixture(scope="module")
def agent(tmp_path_factory):
    """It has washed the apple and put it into the fridge, an hour and a half ago."""
    folder = tmp_path_factory.mktemp("asked")
    agent = agent_saying(folder, [TAKE + WASH, STORE], home=folder / "home")
    assert agent.do("wash the apple")
    assert agent.do("put it in the fridge")
    agent.home.wait(5400.0)
    return agent


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("where is the apple?", "The apple is in the fridge, seen 1 hour ago"),
        ("do you know where the apple is?", "The apple is in the fridge"),
        ("is the fridge open?", "No, the fridge is not open; seen 1 hour ago; that may have"),
        ("is the apple clean?", "Yes, the apple is clean"),
        ("is the apple in the fridge?", "Yes: the apple is in the fridge"),
        ("is the apple in the sink?", "No, not that I saw: the apple is in the fridge"),
        ("how many apples are there?", "1 that I have seen: in the fridge"),
        ("how many apples are in the sink?", "None that I have seen."),
        ("what is in the fridge?", "In the fridge: the apple"),
        ("what's in the sink?", "I have seen nothing in the sink."),
        ("when did you last see the apple?", "I saw the apple 1 hour ago, in the fridge."),
        ("did you wash the apple?", "Yes, 1 hour ago: wash the apple."),
        ("did you slice the apple?", "No, not that I remember."),
        ("what is in your hand?", "Nothing."),
        # what was done on the way is known too, with its place
        ("did you put the apple in the fridge?", "Yes, 1 hour ago: put the apple in the fridge."),
        ("did you put the apple in the cabinet?", "No, not that I remember."),
        ("did you open the fridge?", "Yes, 1 hour ago: put the apple in the fridge."),
        ("did you leave the fridge open?", "No, the fridge is not open"),
        ("are you holding anything?", "No, nothing."),
        ("what did you do?", "1 hour ago: put the apple in the fridge (done)"),
        ("what state is the apple in?", "The apple: cleaned"),
        ("where is the vase?", "I have not seen any vase here."),
        ("where is the banana?", "I know nothing that is called banana."),
        # what is asked of which place
        ("is there anything in the fridge?", "Yes. In the fridge: the apple"),
        ("is the fridge empty?", "No. In the fridge: the apple"),
        ("is the microwave empty?", "I have not looked into the microwave."),
        ("does the fridge have anything in it?", "Yes. In the fridge: the apple"),
        ("which cabinet is the apple in?", "The apple is in the fridge"),
        ("do we have any apples?", "Yes: the apple is in the fridge"),
        ("is the apple in the sink or in the fridge?", "The apple is in the fridge"),
        ("are there fewer than two apples in the fridge?", "1 that I have seen."),
        ("how many things are in the fridge?", "2. In the fridge: the apple"),
        # of all that is so
        ("is anything open?", "Nothing that I have seen."),
        ("is everything closed?", "Yes, all that I have seen is closed."),
        ("which apples are clean?", "Clean: the apple"),
        # of the agent
        ("what can you do?", "I look after this room. I can put things somewhere, pick up"),
        ("why did you wash the apple?", "You asked for it 1 hour ago: wash the apple."),
        ("did I tell you about the apple?", "Nothing that I remember."),
        ("what have you seen so far?", "I have seen 10 things that can be carried: 1 apple"),
    ],
)
def test_answer(agent, question, answer):
    before, past = agent._world.last_event, len(agent.home.past)
    reply = agent.do(question)
    assert reply.status == "answered"
    assert reply.parts[0].answer.lines[0].startswith(answer)
    assert agent._world.last_event is before, "something was done for a question"
    assert len(agent.home.past) == past


def test_each_thing_that_is_asked_about_is_told(agent):
    lines = agent.do("where are the knife and the apple?").parts[0].answer.lines
    assert [line.partition(" is ")[0] for line in lines] == ["The knife", "The apple"]


def test_a_question_goes_on_from_the_one_before(agent):
    """Pronouns stand for what was spoken of last, and "and the kettle?" asks the same again."""
    for question, answer in (
        ("where is the apple?", "The apple is in the fridge"),
        ("where is it?", "The apple is in the fridge"),
        ("is it open?", "No, the fridge is not open"),
        ("is the apple clean?", "Yes, the apple is clean"),
        ("and the kettle?", "I have not seen any kettle here."),
        ("where is the vase?", "I have not seen any vase here."),
        ("and the apple?", "The apple is in the fridge"),
        ("what about the banana?", "I know nothing that is called banana."),
    ):
        assert agent.do(question).parts[0].answer.lines[0].startswith(answer), question


@pytest.mark.parametrize(
    "question",
    ["who made the world?", "why is the apple round?", "what changed?", "who moved the apple?",
     "is the apple near the sink?", "are the apple and the bowl in the fridge?",
     "was the apple on the table before?", "how often did you open the fridge?"],
)  # fmt: skip
def test_what_is_not_understood_is_refused_and_nothing_is_done(agent, question):
    before = agent._world.last_event
    assert agent.do(question).status == "refused"
    assert agent._world.last_event is before


def test_an_errand_after_a_question_is_still_done(tmp_path):
    agent = agent_saying(tmp_path, [TAKE, AWAY])
    reply = agent.do("where is the apple? take the apple")
    assert [part.status for part in reply.parts] == ["answered", "done"]
    assert reply.status == "done"


def test_what_was_not_seen_can_be_looked_for_and_is_known_then(tmp_path):
    agent = agent_saying(tmp_path, [])
    first = agent.do("where is the apple?").parts[0].answer
    assert (first.known, first.look) == (False, "find the apple")
    assert agent.do(first.look)
    again = agent.do("where is the apple?").parts[0].answer
    assert again.known
    assert "just now" in again.lines[0]


def test_ages():
    told = [age(seconds) for seconds in (0, 59, 60, 3599, 3600, 86_400, 172_800)]
    assert told == [
        "just now", "just now", "1 minute ago", "59 minutes ago", "1 hour ago", "1 day ago",
        "2 days ago",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "told",
    ["the apple is in the fridge", "my uncle put the apple in the fridge",
     "Remember that the apple is in the fridge."],
)  # fmt: skip
def test_what_a_person_tells_is_remembered_with_its_source_and_used(tmp_path, told):
    agent = agent_saying(tmp_path, [TAKE], home=tmp_path / "home")
    agent.do("find the fridge")
    agent.do("find the apple")
    before = agent._world.last_event
    agent.home.wait(120.0)
    reply = agent.do(told)
    assert reply.status == "answered"
    assert agent._world.last_event is before
    assert agent.do("where is the apple?").parts[0].answer.lines == (
        f"You told me just now: {told.rstrip('.')}.",
    )
    held = agent.do("is the apple in the fridge?").parts[0].answer.lines[0]
    assert held == "Yes: the apple is in the fridge, you told me just now."
    believed = agent.where("Apple")
    assert believed is not None
    assert believed.place_id.startswith("Fridge")
    agent.home.leave()
    again = agent_saying(tmp_path, [], home=tmp_path / "home")
    assert again.do("where is the apple?").parts[0].answer.lines[0].startswith("You told me")


def test_a_place_may_be_told_against_another(tmp_path):
    agent = agent_saying(tmp_path, [])
    agent.do("find the apple")
    agent.do("the apple is not on the table, it's in the fridge")
    told = agent.do("where is the apple?").parts[0].answer.lines
    assert told == ("You told me just now: the apple is in the fridge.",)


def test_eyes_count_more_than_what_was_told_before(tmp_path):
    agent = agent_saying(tmp_path, [])
    agent.do("the apple is in the fridge")
    agent.home.wait(60.0)
    agent.do("find the apple")
    assert agent.do("where is the apple?").parts[0].answer.lines[0].startswith("The apple is on")


@pytest.mark.parametrize(
    "said",
    ["the apple is not in the fridge", "the apple was in the fridge", "dinner was great",
     "the apple never goes in the fridge", "the fridge is in the apple"],
)  # fmt: skip
def test_what_says_no_place_is_not_learnt(tmp_path, said):
    agent = agent_saying(tmp_path, [])
    assert agent.do(said).status == "refused"
    assert agent.home.past == []


def test_a_state_that_nobody_read_is_not_told(tmp_path):
    agent = agent_saying(tmp_path, [])
    agent.do("find the apple")
    answer = agent.do("is the apple clean?").parts[0].answer
    assert answer.lines == ("I have not seen whether the apple is clean.",)
    assert not answer.known


def test_what_is_in_the_hand_is_not_told_away(tmp_path):
    agent = agent_saying(tmp_path, [TAKE])
    agent.do("take the apple")
    told = agent.do("the apple is in the fridge").parts[0].answer.lines
    assert told == ("I have the apple in my hand.",)
    where = agent.do("where is the apple?").parts[0].answer.lines[0]
    assert where.startswith("The apple is in the hand")


def test_how_many_were_not_seen_are_looked_for_by_their_name(tmp_path):
    agent = agent_saying(tmp_path, [])
    answer = agent.do("how many apples are there?").parts[0].answer
    assert (answer.known, answer.look) == (False, "find the apple")
    assert agent.do(answer.look)


def test_what_was_not_looked_at_is_offered_and_looking_answers_it(tmp_path):
    """A desk that only the map knows: to look there is no deed of finding it on the map."""
    agent = Agent("living_1", planner="karma-nano", folder=tmp_path / "run", maps=tmp_path)
    asked = "what is lying on the desk right now?"
    first = agent.do(asked).parts[0].answer
    assert first.lines[0].startswith("I have seen nothing on the desk. Say")
    reply = agent.do(first.look)
    assert reply.status == "done"
    assert reply.parts[0].results
    assert agent.do(asked).parts[0].answer.lines[0].startswith("On the desk: the pen")
    some = "are any of the drawers open?"
    assert "none of the 3 that I have seen is open" in str(agent.do(some))
    assert agent.do("open a drawer")
    assert agent.do(some).parts[0].answer.lines[0].startswith("Yes, the drawer is open")
    assert agent.do("are the drawers open?").parts[0].answer.lines[0].startswith("No, the drawer")


def test_pieces_of_one_thing_are_one_thing(tmp_path):
    cut = "PickupObject(robot, 'Knife')\nSliceObject(robot, 'Apple')\n"
    agent = agent_saying(tmp_path, [cut])
    assert agent.do("slice the apple")
    assert str(agent.do("how many apples are there?")).splitlines()[1].strip().startswith("1 ")
    assert "None" in str(agent.do("how many apples are whole?"))
    assert not str(agent.do("how many slices of apple are there?")).strip().startswith("1 ")


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("what did I ask you first?", "1 hour ago: wash the apple (done)"),
        ("the fridge is shut, right?", "Yes, the fridge is shut"),
        ("are both mugs dirty?", "mug"),
        ("is the other apple clean?", "I have not seen any other apple here."),
    ],
)
def test_questions_of_before_and_of_deeds(agent, question, answer):
    assert answer in str(agent.do(question))
