"""The LoTa rows: what they say to a model, and what becomes of its steps."""

import re
from itertools import pairwise

import pytest
from support.household import kitchen
from support.scores import scores
from support.tiny import export_tiny

from karma.agent.planning.planner import Planner
from karma.agent.planning.program import parse_program
from karma.agent.seeing.perceive import observe
from karma.bench.methods.expert import NoOptions
from karma.errors import ModelError
from karma.files import to_json
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.models.scripted import ScriptedModel
from karma.plugins.baselines.lota import (
    DONE,
    LotaGenerate,
    LotaScore,
    LotaScoreSettings,
    Past,
    chooser_of,
    code_prompt,
    named_types,
    smart_skills,
    steps_in_lines,
    steps_in_words,
    words_prompt,
)
from karma.types.completion import END, Decoding
from karma.types.events import Plan, SkillResult
from karma.types.space import SceneRef
from karma.types.tasks import SubTask
from karma.world.sim import EmbeddedWorld

PICK = " find an apple,\n pick up the apple,\n"


@pytest.fixture
def world(tmp_path):
    path = tmp_path / "handmade.json"
    path.write_bytes(to_json(kitchen()))
    made = EmbeddedWorld(str(path))
    made.scene = str(path)
    return made


def started(method, world, folder):
    return method.begin(world, SceneRef.of(world.scene), seed=0, folder=folder)


@pytest.fixture
def score(world, tmp_path):
    def start(answers, form="words", **settings):
        method = LotaScore(ScriptedModel(answers), form, LotaScoreSettings(**settings))
        return started(method, world, tmp_path)

    return start


@pytest.fixture
def generate(world, tmp_path):
    def start(answers, profile="full"):
        model = answers if isinstance(answers, ScriptedModel) else ScriptedModel(answers)
        planner = Planner(model, profile, Decoding(attempts=3))
        return started(LotaGenerate(planner, NoOptions()), world, tmp_path)

    return start


def do(method, instruction="fetch the apple"):
    *moments, outcome = method.do(SubTask(instruction=instruction))
    plans = [moment for moment in moments if isinstance(moment, Plan)]
    return plans, [moment for moment in moments if isinstance(moment, SkillResult)], outcome


def held(world):
    thing = observe(world.last_event).held
    return thing.object_type if thing else None


# ----------------------------------------------------------------- the closed lists


@pytest.mark.parametrize("listed, end", [(steps_in_words, DONE), (steps_in_lines, END)])
def test_no_step_begins_another_and_one_ends(listed, end):
    steps = listed()
    texts = sorted(set(steps) - {END})
    assert len(texts) == len(steps) - (end == END)
    assert not any(after.startswith(before) for before, after in pairwise(texts))
    assert [text for text, call in steps.items() if call is None] == [end]


# ----------------------------------------------------------------- prompts


def test_every_step_of_the_examples_is_on_the_list():
    (examples,) = words_prompt((), "x", ())[:1]
    said = re.findall(r"^Robot: 1\.(.*)$", examples, re.MULTILINE)
    assert len(said) == 6
    for line in said:
        for step in re.split(r"(?<=,) \d+\.", line):
            assert step in steps_in_words()


def test_code_prompt_shows_skills_types_examples_and_earlier_plans_but_no_place():
    past = Past(instruction="open the fridge", steps=("OpenObject(robot, 'Fridge')\n",))
    prompt = code_prompt((past,), "take the mug")
    names = [skill.name for skill in smart_skills()]
    assert len(names) == 10
    assert all(f"def {name}(robot" in prompt.stable for name in names)
    assert all(f"'{name}'" in prompt.stable for name in named_types())
    examples = prompt.stable.partition("\n\n# Task Description: ")[2].split("# Task Description: ")
    assert len(examples) == 5
    for example in examples:
        assert parse_program(example.partition("\n")[2], smart_skills())
    assert "node_" not in prompt.stable
    assert prompt.changing == (
        "# Task Description: Open the fridge.\nOpenObject(robot, 'Fridge')\n\n"
        "# Task Description: Take the mug.\n"
    )


# ----------------------------------------------------------------- lota.score


def test_score_takes_steps_until_done(score, world):
    plans, results, outcome = do(score([PICK + DONE]))
    assert [plan.completion.text for plan in plans] == [*PICK.splitlines(), DONE]
    assert [result.ok for result in results] == [True, True]
    assert outcome.finished
    assert held(world) == "Apple"
    assert [name.partition("|")[0] for name in outcome.handled_ids] == ["Apple"]


def test_score_stops_at_the_step_limit_of_each_instruction(score):
    method = score([" open the fridge,\n" * 80], max_steps=25)
    for _ in range(2):
        plans, results, outcome = do(method)
        assert len(plans) == len(results) == 25
        assert not outcome.finished


def test_score_refusal_is_counted_and_the_step_stays_in_the_history(score):
    method = score([" pick up the apple,\n find an apple,\n pick up the apple,\n" + DONE])
    plans, results, outcome = do(method)
    assert [result.ok for result in results] == [False, True, True]
    assert "no Apple is known" in results[0].reason
    assert "pick up the apple, 2. find an apple, 3." in plans[-1].prompt.changing
    assert outcome.finished


def test_put_down_goes_where_the_last_find_was(score, world):
    steps = PICK + " find a microwave,\n open the microwave,\n put down the apple,\n"
    _, results, _ = do(score([steps + DONE]))
    assert str(results[-1].call) == "PutObject(robot, 'Apple', 'Microwave')"
    assert results[-1].ok
    assert held(world) is None


@pytest.mark.parametrize("between", ["", " find a microwave,\n pick up the mug,\n"])
def test_put_down_without_a_place_is_refused(score, between):
    _, results, _ = do(score([PICK + between + " put down the apple,\n" + DONE]))
    assert not results[-1].ok
    assert (results[-1].reason, results[-1].actions) == ("no place was found to put it down", 0)


def test_score_in_lines_searches_what_was_not_seen_and_frees_the_hand(score, world):
    lines = (
        "GoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
        "GoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')\n"
    )
    method = score([lines], form="compact")
    plans, results, outcome = do(method, "fetch the mug")
    assert len(plans) == 5
    called = [str(result.call) for result in results]
    assert called[0] == "Explore(robot, 'Apple')"
    assert any(text.startswith("PutObject(robot, 'Apple', ") for text in called)
    assert all(result.ok for result in results)
    assert outcome.finished
    assert held(world) == "Mug"


def test_score_with_a_model_that_tells_no_probabilities_is_refused():
    class Hosted:
        name = "hosted"

    with pytest.raises(ModelError, match=r"hosted: lota\.score needs.*lota\.generate"):
        chooser_of(Hosted())


def test_score_chooses_what_all_scores_say(world, tmp_path):
    model = LlamaModel(export_tiny(tmp_path / "tiny.gguf"), options=LlamaOptions(threads=1))
    method = LotaScore(chooser_of(model), "compact", LotaScoreSettings(max_steps=2))
    plans, _, _ = do(started(method, world, tmp_path))
    texts = [*steps_in_lines()][::40]
    texts.append(plans[0].completion.text)
    prompt = (plans[0].prompt.stable, plans[0].prompt.changing)
    values = scores(model.gguf, prompt, texts)
    chosen = values[texts.index(plans[0].completion.text)]
    assert chosen == pytest.approx(values.max(), abs=0.02)
    model.close()


# ----------------------------------------------------------------- lota.generate


def test_generate_carries_out_the_whole_plan_of_one_answer(generate, world):
    method = generate(["GoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"])
    plans, results, outcome = do(method)
    assert len(plans) == 1
    assert [str(result.call) for result in results] == [
        "Explore(robot, 'Apple')",
        "PickupObject(robot, 'Apple')",
    ]
    assert outcome.finished
    assert held(world) == "Apple"


def test_generate_passes_over_a_refused_line_and_asks_no_second_time(generate, world):
    method = generate(
        ["SliceObject(robot, 'Apple')\nGoToObject(robot, 'Mug')\nPickupObject(robot, 'Mug')\n"]
    )
    plans, results, outcome = do(method)
    assert len(plans) == 1
    assert [result.ok for result in results] == [False, True, True]
    assert not outcome.finished
    assert held(world) == "Mug"


@pytest.mark.parametrize(
    "answer, words",
    [("Fly(robot)", "Fly"), ("", "no skill call"), ("Explore(robot, 'Mug')", "Explore")],
)
def test_generate_with_an_answer_that_is_no_plan_does_nothing(generate, answer, words):
    plans, results, outcome = do(generate([answer]))
    assert words in plans[0].error
    assert (results, outcome.finished) == ([], False)


def test_generate_in_the_compact_profile_is_mended_as_for_karma(generate):
    method = generate(["GoToObject(robot, 'Apple')\n"], profile="compact")
    plans, results, _ = do(method)
    assert plans[0].prompt.changing == "#task fetch the apple\n#memory\n#program\n"
    assert results[0].call.skill == "Explore"
    assert results[0].ok


# ----------------------------------------------------------------- the scripted model
