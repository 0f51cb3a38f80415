"""References to the log: what was moved, where objects go back to, and what a person stated."""

from dataclasses import replace

import pytest
from support.talking import STORE, TAKE, WASH, agent_saying

from karma.plugins.rules.language.clock import DAY_S, HOUR_S, read_span, time_of_day
from karma.plugins.rules.method import reader_of
from karma.plugins.rules.talk.history import habits_in, in_plain_words, in_turn, moves
from karma.plugins.rules.talk.offers import offered
from karma.types.memory import MemoryChange

BACK = (
    "PickupObject(robot, 'Apple')\nGoToObject(robot, 'DiningTable')\n"
    "PutObject(robot, 'Apple', 'DiningTable')\n"
)
OUT = "OpenObject(robot, 'Fridge')\n" + BACK + "CloseObject(robot, 'Fridge')\n"


@pytest.fixture(scope="module")
def reader():
    return reader_of(None)


@pytest.fixture
def agent(tmp_path):
    """It has washed the apple and put it into the fridge."""
    agent = agent_saying(tmp_path, [TAKE + WASH, STORE, OUT, STORE], home=tmp_path / "home")
    assert agent.do("wash the apple")
    assert agent.do("put it in the fridge")
    return agent


def clauses(agent, text):
    return [request.text for request in agent.assistant.requests(text)]


def answer(agent, question):
    return agent.do(question).parts[0].answer.lines


def place_of(agent, kind):
    found = agent._world.last_event.metadata["objects"]
    return next(one for one in found if one["objectType"] == kind)["parentReceptacles"]


# ----------------------------------------------------------------- questions


def test_what_somebody_else_moved_is_not_taken_for_an_own_deed(agent):
    past = list(agent.home.past)
    seen = next(one for one in past[-1].changes[0].seen if one.object_type == "Apple")
    table = replace(seen, parent_ids=("DiningTable|+01.50|+00.40|-00.10",))
    change = MemoryChange(scene=agent.scene.name, at_s=agent.home.clock_s, seen=(table,))
    agent.home.add("find the apple", "done", (), [change], agent._world.last_event)
    assert moves(agent.home.past)[-1].said == ""


def test_times_are_read_or_said_not_to_be_understood(agent):
    agent.home.wait(DAY_S)  # it is Tuesday, after eight
    assert len(answer(agent, "what did you do yesterday?")) == 2
    assert answer(agent, "what did you do this morning?") == ("Nothing then.",)
    assert "before lunch" in answer(agent, "what did you do before lunch?")[-1]


def test_the_last_hours_are_a_span():
    span, rest = read_span("what changed in the last two hours?", 10 * HOUR_S)
    assert (span.after_s, span.before_s) == (8 * HOUR_S, 10 * HOUR_S)
    assert rest == "what changed?"
    assert read_span("the past hour", HOUR_S)[0].after_s == 0.0
    assert read_span("the last few minutes", HOUR_S)[0] is None
    assert time_of_day(2 * DAY_S + 14.25 * HOUR_S) == "Wednesday 14:15"


# ----------------------------------------------------------------- errands that speak of the log


def test_a_thing_is_put_back_where_it_was(agent):
    was = place_of(agent, "Apple")
    assert agent.do("put the apple on the dining table")
    assert place_of(agent, "Apple") != was
    reply = agent.do("put it back where it was")
    assert reply.parts[0].instruction == "put the apple in the fridge"
    assert reply.status == "done"
    assert place_of(agent, "Apple") == was


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("put it back", "put the apple in the sink"),
        ("please put the apple back where you found it", "please put the apple in the sink"),
        ("bring it back to where it came from", "put the apple in the sink"),
        ("open the fridge and put it back", "open the fridge and put the apple in the sink"),
        # of these the log knows nothing
        ("put the vase back where it was", "put the vase back where it was"),
        ("put it on the table", "put it on the table"),
        ("put the apple away", "put the apple away"),
        ("put the apple where it belongs", "put the apple where it belongs"),
        ("put the apple back in the bowl", "put the apple back in the bowl"),
    ],
)
def test_a_request_is_said_plainly_where_the_log_knows(agent, reader, text, plain):
    assert in_plain_words(text, agent.home.past, reader).text == plain


def test_the_place_is_the_very_one(agent, reader):
    means = in_plain_words("put it back", agent.home.past, reader).means
    assert set(means) == {"Apple", "Sink"} or set(means) == {"Apple", "SinkBasin"}
    assert all("|" in one for one in means.values())


# ----------------------------------------------------------------- what is told


def test_a_habit_is_kept_and_obeyed(tmp_path, agent):
    assert answer(agent, "the apple always goes on the dining table") == (
        "I will remember: the apple goes on the dining table.",
    )
    reply = agent.do("put the apple where it belongs")
    assert reply.parts[0].instruction == "put the apple on the dining table"
    assert "DiningTable" in place_of(agent, "Apple")[0]
    agent.home.leave()
    tomorrow = agent_saying(tmp_path, [OUT], home=tmp_path / "home")
    for text in (
        "put the apple away",
        "tidy away the apple",
        "stow the apple",
        "clear the apple away",
    ):
        assert clauses(tomorrow, text) == ["put the apple on the dining table"]
    assert clauses(tomorrow, "put the apple in the sink") == ["put the apple in the sink"]
    assert clauses(tomorrow, "put the mug away") == ["put the mug away"]
    assert answer(tomorrow, "where does the apple go?") == (
        "You told me: the apple goes on the dining table.",
    )


@pytest.mark.parametrize(
    ("text", "habit"),
    [
        ("the apples always go in the fridge", ("Apple", "Fridge")),
        ("I usually keep the mug in the cabinet", ("Mug", "Cabinet")),
        ("the apple never goes in the fridge", None),
        ("the apple is in the fridge", None),
        ("always put the apple in the fridge", ("Apple", "Fridge")),
        ("from now on the apple goes in the fridge", ("Apple", "Fridge")),
        ("the fridge is always open", None),
        ("the apple belongs in the fridge", ("Apple", "Fridge")),
        ("go and put the apple in the fridge", None),
        ("my brother lives here, put the book on the desk", None),
    ],
)
def test_habits_are_told_from_other_statements(reader, text, habit):
    found = [(thing.types[0], place.types[0]) for thing, place in habits_in(text, reader)]
    assert found == ([] if habit is None else [habit])


def test_several_habits_are_told_at_once(reader):
    text = "Fruit belongs in the fridge and cutlery in a drawer"
    found = {
        kind: place.types[0] for thing, place in habits_in(text, reader) for kind in thing.types
    }
    assert found == {
        "Apple": "Fridge", "ButterKnife": "Drawer", "Fork": "Drawer", "Spoon": "Drawer",
    }  # fmt: skip
    both = habits_in("plates and bowls always go in the cabinet", reader)
    assert [(thing.types[0], place.types[0]) for thing, place in both] == [
        ("Plate", "Cabinet"),
        ("Bowl", "Cabinet"),
    ]
    assert habits_in("fruit always goes in the fridge and the spoon", reader) == []


def test_what_one_part_means_by_the_log_is_no_other_parts_place(tmp_path):
    agent = agent_saying(tmp_path, [STORE])
    agent.do("put the apple in the fridge")
    clauses = list(agent.assistant.requests("find the mug, then put the apple back where it was"))
    assert [clause.text for clause in clauses] == [
        "find the mug", "put the apple on the dining table",
    ]  # fmt: skip
    assert dict(clauses[0].means) == {}
    assert set(clauses[1].means) == {"Apple", "DiningTable"}


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("wash the mug, then put it back where it was",
         ["wash the mug", "put it back where it was"]),
        ("wash the mug and put it away", ["wash the mug and put it away"]),
        ("put it back", ["put it back"]),
        ("open the fridge and close it", ["open the fridge and close it"]),
    ],
)  # fmt: skip
def test_only_what_speaks_of_the_log_is_cut_off(text, parts):
    assert in_turn(text) == parts


@pytest.mark.parametrize(
    "text",
    [
        "remember that the apple belongs in the fridge",
        "Please remember that the apple goes in the fridge",
    ],
)
def test_what_is_to_be_remembered_is_no_errand(tmp_path, text):
    agent = agent_saying(tmp_path, [])
    before = agent._world.last_event
    assert answer(agent, text) == ("I will remember: the apple goes in the fridge.",)
    assert agent._world.last_event is before
    assert clauses(agent, "put the apple where it belongs") == ["put the apple in the fridge"]


def test_how_a_thing_is_by_a_persons_words_is_kept_and_told_as_theirs(agent):
    """The agent itself has washed it and put it away."""
    (seen,) = answer(agent, "is the apple dirty?")
    assert seen.startswith("No, the apple is not dirty; seen")
    filthy = agent.do("the apple is dirty again")  # that may ask for something
    kept = ("I will remember: the apple is dirty.", "Should I wash the apple?")
    assert (filthy.parts[0].answer.lines, offered(filthy)) == (kept, "wash the apple")
    (told,) = answer(agent, "is the apple dirty?")
    assert told == "Yes, the apple is dirty; you told me just now."
    assert answer(agent, "I just washed the apple") == ("I will remember: the apple is clean.",)
    (told,) = answer(agent, "is the apple clean?")
    assert told == "Yes, the apple is clean; you told me just now."
    (place,) = answer(agent, "where is the apple?")
    assert "you told me" not in place  # that was seen
    assert "I will remember: the fridge is open." in answer(agent, "I opened the fridge")
    (told,) = answer(agent, "is the fridge open?")
    assert told == "Yes, the fridge is open; you told me just now."
    assert "told" not in " ".join(answer(agent, "what did you do?"))


@pytest.mark.parametrize(
    "said",
    ["I wash the apple every day", "the apple was dirty", "the apple is not dirty",
     "I always close the fridge", "I forgot to close the fridge"],
)  # fmt: skip
def test_what_is_not_so_now_is_no_state_that_is_told(agent, said):
    before = answer(agent, "is the apple dirty?"), answer(agent, "is the fridge open?")
    agent.do(said)
    assert (answer(agent, "is the apple dirty?"), answer(agent, "is the fridge open?")) == before


def test_told_state_outlives_the_session(tmp_path, agent):
    agent.do("I opened the fridge")
    agent.home.leave()
    again = agent_saying(tmp_path, [], home=tmp_path / "home")
    (told,) = answer(again, "is the fridge open?")
    assert "you told me" in told
