"""EB-ALFRED's planners: what they are told, what is read out of answers, how they replan."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import eb_alfred as eb

from karma.models.scripted import ScriptedModel
from karma.plugins.alfred.eb_world.actions import PUT
from karma.plugins.alfred.published_tasks import ListedTask
from karma.plugins.alfred.suites.benchmark import AlfredStage, play
from karma.plugins.alfred.suites.eb_planner import (
    PromptOptions,
    read_answer,
    render_prompt,
)
from karma.plugins.alfred.suites.experiment import EbRow

OPTIONS = PromptOptions()


def plan_text(*numbers):
    return json.dumps({"executable_plan": [{"action_id": n, "action_name": "?"} for n in numbers]})


# ----------------------------------------------------------------- answers


@pytest.mark.parametrize(
    ("text", "plan"),
    [
        (plan_text(3, 1), (3, 1)),
        (f"Sure!\n```json\n{plan_text(3)}\n```\nGood luck {{}}.", (3,)),
        ('{"executable_plan": [{"action_id": "4", "action_name": "x"},],}', (4,)),
        ('{"executable_plan": [{"action_id": 1}, {"action_id": 2}, {"action_na', (1, 2)),
        ('{"executable_plan": [5, 6]}', (5, 6)),
        (plan_text(2, 999, 3), (2,)),
        ('{"executable_plan": []}', ()),
    ],
)
def test_answer_is_read_and_mended_within_bounds(text, plan):
    found = read_answer(text, 20)
    assert (found.plan, found.error) == (plan, "")


@pytest.mark.parametrize(
    ("text", "reason", "no_json"),
    [
        ("", "no JSON object", True),
        ("I would open the fridge.", "no JSON object", True),
        ("[1, 2]", "no JSON object", True),
        ('{"plan": [1]}', "no list 'executable_plan'", True),
        ('{"executable_plan": [{"action_id": true}]}', "no whole number", True),
        ('{"executable_plan": [{"action_id": 1.5}]}', "no whole number", True),
        (plan_text(20, 1), "there is no action 20", False),
        (plan_text(-1), "there is no action -1", False),
        ('{"executable_plan": [' * 100_000, "", True),
    ],
)
def test_answer_that_is_of_no_use_says_why(text, reason, no_json):
    found = read_answer(text, 20)
    assert found.plan == ()
    assert reason in found.error
    assert found.error
    assert found.no_json is no_json


WELL = '"executable_plan": [{"action_id": 5, "action_name": "find a Mug"}]'
DAMAGED = {
    "a line in a text": '{"language_plan": "1. find\n2. pick up", ' + WELL + "}",
    "a tab in a text": '{"language_plan": "1.\tfind", ' + WELL + "}",
    "quotes in a text": '{"language_plan": "the "big" {mug}", ' + WELL + "}",
    "Python": "{'seen': None, 'ok': True, 'executable_plan': [{'action_id': 5, 'why': \"it's\"}]}",
    "Python and JSON": '{"seen": None, ' + WELL + "}",
    "braces before": '<think>{find} {5}, as {"executable_plan": [...]}</think>{' + WELL + "}",
    "a comment": '{"executable_plan": [{"action_id": 5} // the [first]\n]}',
    "another comment": '{"executable_plan": [\n# first\n{"action_id": 5}]}',
    "a float": '{"executable_plan": [{"action_id": 5.0}]}',
    "a list alone": '[{"action_id": 5, "action_name": "x"}]',
    "one alone": '{"executable_plan": {"action_id": 5}}',
    "dots at the end": '{"executable_plan": [{"action_id": 5}, ...]}',
    "damage in the middle": '{"executable_plan": [{"action_id": 5}, {action: 6}, [7]]}',
    "typographic quotes": "{“executable_plan”: [{“action_id”: 5}]}",
    "a text in JSON": json.dumps("{" + WELL + "}"),
    "no end": "{" + WELL[:-1] + ', {"action_id": 6, "act',
    "as YAML": 'executable_plan: [{"action_id": 5}]',
}


@pytest.mark.parametrize("text", DAMAGED.values(), ids=DAMAGED)
def test_plan_is_read_out_of_a_damaged_answer_and_counted_as_mended(text):
    found = read_answer(text, 20)
    assert (found.plan, found.error, found.mended) == ((5,), "", True)
    assert read_answer(text, 20, mend=False).no_json


@given(text=st.text(max_size=300) | st.text('{}[]",:0123456789ab\\ ', max_size=300))
def test_answer_any_text_is_a_plan_within_the_list_or_an_error(text):
    found = read_answer('{"executable_plan": ' + text, 20)
    assert all(0 <= number < 20 for number in found.plan)
    assert not (found.plan and found.error)


# ----------------------------------------------------------------- the prompt


def test_prompt_has_the_parts_in_their_order(tmp_path):
    env = eb.environment(tmp_path)
    prompt = render_prompt(env, "Cool it.", "base", OPTIONS)
    text = prompt.stable + prompt.changing
    parts = ("## Rules", "## Actions (0 to", "## Example 1\n", "## Example 10", "## Guidelines",
             "## Instruction\nCool it.")  # fmt: skip
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    assert f"\n{len(env.actions) - 1}: {env.actions[-1]}" in text
    assert "executable_plan" in prompt.changing
    assert prompt.stable.endswith("\n")


def test_prompt_tells_what_was_done_and_how_it_went_unless_told_not_to(tmp_path):
    env = eb.environment(tmp_path)
    eb.say(env, "find a Fridge", "close the Fridge")
    told = render_prompt(env, "x", "base", OPTIONS).changing
    assert "action 3, find a Fridge: Done." in told
    assert "already closed" in told
    bare = render_prompt(env, "x", "base", PromptOptions(feedback=False)).changing
    assert "find a Fridge" in bare
    assert "Done." not in bare


def test_prompt_with_pictures_shows_the_last_views_and_asks_what_they_show(tmp_path):
    env = eb.environment(tmp_path)
    eb.say(env, "find a Fridge")
    options = PromptOptions(pictures=2)
    prompt = render_prompt(env, "x", "base", options, pictures=env.pictures(options.pictures))
    assert [picture.shape for picture in prompt.pictures] == [(500, 500, 3)] * 2
    assert (prompt.pictures[0] != prompt.pictures[1]).any()
    assert "visual_state_description" in prompt.stable
    assert "visual_state_description" in prompt.changing
    bare = render_prompt(env, "x", "base", OPTIONS)
    assert (bare.pictures, env.pictures(0)) == ((), ())
    assert "visual_state_description" not in bare.stable + bare.changing


# ----------------------------------------------------------------- at play


def played(tmp_path, *answers, strict=False, options=OPTIONS, task=""):
    model = ScriptedModel(answers)
    stage = AlfredStage(rooms=eb.rooms(tmp_path, task=task), types=eb.TYPES, model=model)
    row = EbRow(name="r", strict=strict, prompt=options)
    asked = ListedTask(
        list="base", position=0, folder="", trial="ours_1", repeat=0, instruction="Put fruit away."
    )
    return play(stage, row, asked, 0, {}), model


def numbers_of(tmp_path, *names):
    found = {str(action): number for number, action in enumerate(eb.environment(tmp_path).actions)}
    return [found[name] for name in names]


def test_planner_is_asked_anew_when_an_action_fails_and_told_why(tmp_path):
    wrong = numbers_of(tmp_path, "find a Apple", "pick up the Apple", "find a Fridge", PUT, PUT)
    right = numbers_of(tmp_path, "find a Fridge", "open the Fridge", PUT)
    record, model = played(tmp_path, plan_text(*wrong), plan_text(*right))
    assert (record.success, record.calls, record.invalid) == (True, 2, 1)
    assert [step.name for step in record.steps][3:] == [
        PUT, "find a Fridge", "open the Fridge", PUT,
    ]  # fmt: skip
    assert "putting it at the Fridge failed" in model.prompts[1].changing


def test_planner_that_gives_no_json_is_told_so_unless_strict(tmp_path):
    empty = plan_text()
    record, model = played(tmp_path, "no idea", empty)
    assert (record.end, record.invalid, record.no_json, record.calls) == ("empty plan", 1, 1, 2)
    assert "could not be used\nthere is no JSON object" in model.prompts[1].changing
    _, model = played(tmp_path, "no idea", empty, strict=True)
    assert model.prompts[0] == model.prompts[1]


def test_empty_plan_keeps_its_progress_unless_strict(tmp_path):
    """The apple is in the fridge, which is open: one of three conditions of cooling it."""
    names = ("find a Apple", "pick up the Apple", "find a Fridge", "open the Fridge", PUT)
    done = plan_text(*numbers_of(tmp_path, *names))
    for strict, progress in ((False, 1 / 3), (True, 0.0)):
        task = {"task": "pick_cool_then_place_in_recep", "strict": strict}
        record, _ = played(tmp_path, done, plan_text(), **task)
        assert (record.end, record.progress) == ("empty plan", progress)
