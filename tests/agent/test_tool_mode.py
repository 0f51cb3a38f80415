"""Tool mode: the model's calls, their results as it reads them, and the report."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.experiences import begun

from karma.agent.tools.table import MAX_LINES, BadCall, in_tools, parse_answer, tools_grammar
from karma.errors import KarmaError
from karma.loading.names import check_models
from karma.models.constraint import admits
from karma.models.scripted import ScriptedModel
from karma.types.events import Outcome, SkillResult
from karma.types.planning import End
from karma.types.tasks import SubTask

# ----------------------------------------------------------------- the parser


@pytest.mark.parametrize(
    ("text", "calls", "end"),
    [
        ("pick(Mug)\nput(Mug, Sink)", ["pick(Mug)", "put(Mug, Sink)"], None),
        ("```\nlook(Fridge)\n```", ["look(Fridge)"], None),
        ("I will look first.\n1. look('Fridge')\n- survey()", ["look(Fridge)", "survey()"], None),
        ("pick(robot, 'Mug')", ["pick(Mug)"], None),
        ("Pick(Mug);  # the clean one", ["pick(Mug)"], None),
        ("put(Sink)", ["put(Sink)"], None),
        ('done("It (blue) is clean.")', [], ("done", "It (blue) is clean.")),
        ("tell(Two.\nOne is open.)", [], ("tell", "Two. One is open.")),
        ('ask("Which mug?")\npick(Mug)', [], ("ask", "Which mug?")),
        ("done()", [], ("done", "")),
        ("The mug is clean.", [], None),
        ("", [], None),
    ],
)  # fmt: skip
def test_answers_are_read_as_calls_and_an_end(text, calls, end):
    answer = parse_answer(text)
    assert [str(call) for call in answer.calls] == calls
    assert (answer.end and (answer.end.kind, answer.end.text)) == end


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("pik(Mug)", "did you mean pick?"),
        ("vacuum()", "tools: go, look"),
        ("put(A, B, C)", "write put(X, Y)"),
        ("pick(__import__('os'); x)", "a name has letters"),
    ],
)
def test_line_that_is_no_call_of_a_tool_says_what_would_be(text, reason):
    (call,) = parse_answer(text).calls
    assert isinstance(call, BadCall)
    assert reason in call.reason


@given(st.text(max_size=2000) | st.lists(st.sampled_from(["pick(", "done(", ")", '"', "\n", "a"])))
def test_any_text_is_read(text):
    answer = parse_answer("".join(text))
    assert len(answer.calls) <= MAX_LINES + 1


@pytest.mark.parametrize(
    ("text", "is_legal"),
    [
        ("pick(Mug_2)", True),
        ('look(Fridge)\nput(Mug_2, Cabinet)\ndone("Ok, it\'s in.")', True),
        ("survey()\n", True),
        ("pick(Mug_3)", False),
        ("I look first.", False),
        ("pick(Mug_2, Sink)", False),
    ],
)
def test_grammar_admits_calls_with_names_in_scope(text, is_legal):
    assert admits(tools_grammar(["Mug_2"]).grammar, text) is is_legal


def test_skill_calls_in_refusals_are_said_as_tool_calls():
    assert in_tools("the hand is empty; PickupObject(robot, 'Apple') first") == (
        "the hand is empty; pick(Apple) first"
    )


def test_mode_is_known_by_name_where_models_are_named():
    check_models({"profile": "tools"})
    with pytest.raises(KarmaError, match="Did you mean 'tools'"):
        check_models({"profile": "tool"})


# ----------------------------------------------------------------- the loop


@pytest.fixture
def talk(tmp_path):
    """A function that has requests carried out by scripted answers, in one episode."""

    def carried_out(answers, *requests, **options):
        model = ScriptedModel(answers)
        options = {"seen_kept": 2, **options}
        agent, world = begun(tmp_path, model, profile="tools", **options)
        events = [list(agent.do(SubTask(instruction=words))) for words in requests]
        return events, model, world

    return carried_out


def outcome(events):
    assert isinstance(events[-1], Outcome)
    return events[-1]


def called(events):
    return [str(event.call.skill) for event in events if isinstance(event, SkillResult)]


def state_of(world, kind):
    return next(one for one in world.last_event.metadata["objects"] if one["objectType"] == kind)


APPLE = ["find(Apple)\npick(Apple)\nput(Apple, Fridge)", "open(Fridge)\nput(Apple, Fridge)\n"
         'close(Fridge)\ndone("The apple is in the fridge.")']  # fmt: skip


def test_request_is_carried_out_and_the_report_is_what_was_observed(talk):
    (events,), model, world = talk(APPLE, "put the apple in the fridge")
    assert outcome(events).finished
    assert "the apple is in the fridge" in [check.text for check in outcome(events).checks]
    assert state_of(world, "Fridge")["receptacleObjectIds"]
    assert "put(Apple, Fridge) -> FAILED" in model.prompts[1].changing
    assert outcome(events).end == End(kind="done", text="The apple is in the fridge.")


def test_water_that_was_run_by_its_sink_is_no_contradiction(talk):
    wash = 'pick(Apple)\nput(Apple, SinkBasin)\non(SinkBasin)\noff(SinkBasin)\ndone("Washed.")'
    (events,), _, world = talk([wash], "wash the apple")
    assert outcome(events).finished
    assert [check.found for check in outcome(events).checks] == ["seen", "done"]
    assert not state_of(world, "Faucet")["isToggled"]


def test_movable_objects_of_the_tour_stand_in_the_first_prompt(talk):
    _, model, _ = talk(['refuse("No.")'], "no")
    assert "DiningTable: " in model.prompts[0].changing
    assert "Apple" in model.prompts[0].changing
    assert "Egg" not in model.prompts[0].changing  # in the fridge, which nobody opened


def test_users_words_stand_in_the_prompt_as_they_were_said(talk):
    words = "Would you kindly put the apple -- yes, that one -- in the fridge?!"
    _, model, _ = talk(['ask("Which apple?")'], words)
    assert f"Request: {words}" in model.prompts[0].changing


def test_question_is_answered_and_what_a_search_opened_is_closed(talk):
    (events,), _, world = talk(['look(Fridge)\ntell("An egg.")'], "what is in the fridge?")
    assert outcome(events).finished
    assert called(events)[-1] == "CloseObject"
    assert not state_of(world, "Fridge")["isOpen"]


def test_what_the_model_opened_itself_stays_open(talk):
    (events,), _, world = talk(['open(Fridge)\ndone("It is open.")'], "open the fridge")
    assert outcome(events).finished
    assert state_of(world, "Fridge")["isOpen"]


@pytest.mark.parametrize("end", ["ask", "refuse"])
def test_request_that_is_asked_about_or_refused_is_not_finished(talk, end):
    (events,), _, _ = talk([f'{end}("No.")'], "put it away")
    assert not outcome(events).finished
    assert called(events) == []


def test_unknown_name_is_quoted_back_with_the_closest(talk):
    _, model, _ = talk(["open(Frige)", 'refuse("No.")'], "open the fridge")
    assert (
        model.prompts[1].changing
        == "open(Frige) -> FAILED: nothing here is named Frige; there is Fridge"
    )


def test_three_answers_without_a_call_end_the_request_as_not_done(talk):
    (events,), model, _ = talk(["Sure!", "I am on it.", "Done."], "open the fridge")
    assert not outcome(events).finished
    assert outcome(events).checks[-1].text == "3 answers in a row without a call that works"
    assert len(model.prompts) == 3
    assert "no tool call" in model.prompts[1].changing


def test_same_calls_without_effect_end_the_request(talk):
    (events,), model, _ = talk(["go(Fridge)"] * 9, "open the fridge")
    assert not outcome(events).finished
    assert len(model.prompts) < 9


def test_done_with_what_could_not_be_put_down_is_asked_about_once(talk):
    answers = ["pick(Apple)\nput(Apple, Fridge)", 'done("Done.")', 'done("I hold it.")']
    (events,), model, _ = talk(answers, "put the apple in the fridge")
    assert outcome(events).finished
    assert "you still hold Apple" in model.prompts[2].changing


def test_done_with_what_was_to_be_fetched_in_the_hand_is_taken_as_it_is(talk):
    (events,), model, _ = talk(['pick(Apple)\ndone("Here.")'], "bring me the apple")
    assert outcome(events).finished
    assert len(model.prompts) == 1


def test_what_was_looked_at_is_told_with_its_usual_states_too(talk):
    _, model, _ = talk(["go(Microwave)", 'tell("It is off.")'], "is the microwave on?")
    assert "go(Microwave) -> ok, it is closed and off" in model.prompts[1].changing


def test_search_for_one_more_says_that_there_is_no_further_one(talk):
    _, model, _ = talk(["find(Apple)\nfind(Apple)", 'tell("One.")'], "how many apples?")
    known, more = model.prompts[1].changing.splitlines()[:2]
    assert "ok, known: Apple at DiningTable" in known
    assert "FAILED: there is no further Apple" in more


def test_later_requests_read_the_conversation_and_the_same_names(talk):
    _, model, _ = talk(
        [*APPLE, 'tell("In the fridge.")'], "put the apple in the fridge", "where is it?"
    )
    last = model.prompts[-1].changing
    assert "Earlier request: put the apple in the fridge" in last
    assert (
        "done: The apple is in the fridge. (handled: Fridge, Apple)" in last or "handled: " in last
    )
    assert "Fridge: " in last and "Apple" in last


def test_without_short_term_memory_nothing_of_earlier_requests_is_told(talk):
    _, model, _ = talk(
        [*APPLE, 'tell("I do not know.")'],
        "put the apple in the fridge",
        "where is it?",
        short_term=False,
    )
    last = model.prompts[-1].changing
    assert "Earlier request" not in last
    assert "Remembered" not in last
    assert "Apple" not in last


def test_without_long_term_memory_there_is_no_map(talk):
    _, model, _ = talk(['refuse("No.")'], "open the fridge", long_term=False)
    assert "Furniture" not in model.prompts[0].stable


def test_answer_that_was_cut_is_no_call(talk, monkeypatch):
    from dataclasses import replace

    whole = ScriptedModel.complete

    def cut(self, *given, **options):
        said = whole(self, *given, **options)
        return replace(said, finish="length", fault="cut off") if "pick" in said.text else said

    monkeypatch.setattr(ScriptedModel, "complete", cut)
    (events,), model, _ = talk(["find(Apple)\npick(Apple)", 'refuse("No.")'], "take the apple")
    assert called(events) == []
    assert "cut off" in model.prompts[1].changing
