"""LoTa-Bench's planners: what they are told, what is read out of lists, how an episode goes."""

import json
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import alfred_kitchen as ours
from support import eb_alfred as eb
from support.lota_alfred import FETCH, SAID, STOW, environment, listed, trial
from support.paths import SHARED
from support.scores import scores
from support.tiny import export_tiny

from karma.errors import FileError
from karma.journal.records import NotRun
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.models.scripted import ScriptedModel
from karma.plugins.alfred.eb_world.actions import skills_of
from karma.plugins.alfred.replay.facts import gather
from karma.plugins.alfred.suites.benchmark import AlfredStage, TrialRooms, play
from karma.plugins.alfred.suites.experiment import LotaRow, draw_tasks
from karma.plugins.alfred.suites.lota_planner import (
    LotaPromptOptions,
    followed,
    read_list,
    score_prompt,
)
from karma.plugins.alfred.suites.table import LOTA_TABLES, results_of

NAMES = [str(skill) for skill in skills_of(eb.TYPES)]
OPTIONS = LotaPromptOptions()


def numbers_of(*names):
    return [NAMES.index(name) for name in names]


# ----------------------------------------------------------------- lists in answers


@pytest.mark.parametrize(
    "text",
    [
        "1) find an apple 2) pick up the apple 3) done",
        "Step 1: find an apple\nStep 2: pick up the apple\nStep 3: done",
        "Find an apple. Pick up the apple. Done.",
        "1. Find an apple.\n2. Pick up the apple.\n3. Done.",
        "1. find an apple, 2. pick up the apple, 3. done.",
        "Robot: 1. find an apple, 2. pick up the apple, 3. done.\nHuman: Thanks.",
        "find an apple\npick up the apple\ndone",
        "* Find the Apple;\n* `Pick up an apple`;\n* **done**",
        "\n 1) find  an apple\n 2) pick up apple\n\n 3) DONE",
    ],
)
def test_list_is_read_however_it_is_written(text):
    assert read_list(text, NAMES) == (*numbers_of(*FETCH), 0)


def test_list_ends_with_done_and_is_bounded():
    assert read_list("done, find an apple", NAMES) == (0,)
    assert read_list("", NAMES) == read_list(" ,\n,", NAMES) == ()
    assert len(read_list("wave, " * 1_000_000, NAMES)) == 1_000


@given(text=st.text(max_size=200) | st.text("find apple,.\n1 dopuckthe", max_size=200))
def test_list_any_text_is_skills_and_texts(text):
    for mend in (True, False):
        for one in read_list(text, NAMES, mend=mend):
            assert isinstance(one, str) or 0 <= one < len(NAMES)


# ----------------------------------------------------------------- prompts


def test_score_prompt_has_lead_examples_instruction_and_steps_in_this_order(tmp_path):
    env = environment(tmp_path)
    eb.say(env, *FETCH)
    segments = score_prompt(" wash it \n", env.steps, OPTIONS)
    assert segments[1:] == (
        "Human: wash it\nRobot: 1.", " find an apple, 2.", " pick up the apple, 3.",
    )  # fmt: skip
    lines = segments[0].splitlines()
    assert [line.partition(":")[0] for line in lines] == ["Robot"] * 2 + ["Human", "Robot"] * 6
    assert lines[3].endswith(", 7. done.")
    fewer = score_prompt("x", (), LotaPromptOptions(examples=1))[0]
    assert fewer.count("Human:") == 1


def test_score_prompt_tells_failures_only_when_asked(tmp_path):
    env = environment(tmp_path)
    eb.say(env, "find a pen", "find an egg", "pick up the egg")
    bare = "".join(score_prompt("x", env.steps, OPTIONS))
    assert "failed" not in bare
    told = score_prompt("x", env.steps, LotaPromptOptions(failures=True))
    assert told[3:] == (
        " find an egg, 3.",
        " pick up the egg (this action failed: the egg is out of sight, it is in fridge), 4.",
    )
    assert told[0].count("(this action failed: ") == 3


# ----------------------------------------------------------------- draws


def lists(path, count=40):
    kinds = ("pick_and_place_simple", "pick_two_obj_and_place")
    entries = [{"task": f"{kinds[n % 2]}-x/t{n}", "repeat_idx": n % 3} for n in range(count)]
    path.write_text(json.dumps({"valid_seen": entries, "other": entries[:2]}))
    return path


def test_draw_leaves_out_two_objects_and_samples_as_the_source_does(tmp_path):
    path = lists(tmp_path / "lists.json")
    whole = draw_tasks(path, ("valid_seen",))
    assert [task.trial for task in whole] == [f"t{n}" for n in range(0, 40, 2)]
    random.seed(1)
    theirs = random.sample([task.trial for task in whole], int(len(whole) * 30 / 100))
    drawn = draw_tasks(path, ("valid_seen",), percent=30)
    assert [task.trial for task in drawn] == theirs
    assert drawn != draw_tasks(path, ("valid_seen",), percent=30, seed=2)
    with pytest.raises(FileError, match="no list 'valid_unseen'"):
        draw_tasks(path, ("valid_unseen",))


@pytest.mark.shared
def test_draws_of_the_whole_list_are_the_sources(tmp_path):
    """Half of the 696 is known by its places, and which of it the source drew."""
    half = SHARED / "data/lota_alfred/splits_even.json"
    known = json.loads(half.read_text())
    other = {"task": "unknown-x/unknown", "repeat_idx": 0}
    whole = [one for entry in known["valid_seen"] for one in (entry, other)]
    path = tmp_path / "whole.json"
    path.write_text(json.dumps({"valid_seen": whole}))
    for percent in (5, 30):
        drawn = draw_tasks(path, percent=percent)
        assert len(drawn) == {5: 34, 30: 208}[percent]
        ours_ = [(f"{one.folder}/{one.trial}", one.repeat) for one in drawn if one.trial[1] == "r"]
        theirs = known[f"valid_seen_{percent}_percent_seed_1"]
        assert ours_ == [(one["task"], one["repeat_idx"]) for one in theirs]


# ----------------------------------------------------------------- episodes


def stage(tmp_path, model):
    given = ours.read(tmp_path, trial())
    rooms = TrialRooms(trials={given.id: given}, facts=gather([given], ours.beside(tmp_path)))
    return AlfredStage(rooms=rooms, types=eb.TYPES, model=model)


def played(tmp_path, *answers, player="generated", task=None, **row):
    model = ScriptedModel(answers)
    row = LotaRow(name="r", player=player, **row)
    return play(stage(tmp_path, model), row, task or listed(), 0, {}), model


def test_generated_list_is_carried_out_to_its_end_whatever_fails(tmp_path):
    plan = (*FETCH, "find a pen", "slice the apple", *STOW)
    record, model = played(tmp_path, ", ".join(plan) + ", done.")
    assert (record.success, record.end, record.calls) == (True, "done", 1)
    assert [step.name for step in record.steps if not step.ok] == ["find a pen", "slice the apple"]
    assert SAID in model.prompts[0].changing
    assert record.instruction == SAID
    answer = record.answers[0]
    assert (answer.named, answer.unknown, record.failed, record.unknown) == (8, 0, 2, 0)


def test_generated_list_is_asked_for_once_and_judged_where_it_ends(tmp_path):
    record, _ = played(tmp_path, ", ".join(FETCH))
    assert (record.success, record.end, len(record.steps)) == (False, "plan over", 2)
    record, _ = played(tmp_path, "")
    assert (record.success, record.end, record.steps) == (False, "empty plan", ())


def test_generated_text_of_ten_megabytes_is_counted_and_kept_short(tmp_path):
    record, _ = played(tmp_path, "x" * 10_000_000)
    assert (record.end, record.unknown, record.failed) == ("plan over", 1, 1)
    assert record.answers[0].characters == 10_000_000
    assert len(record.answers[0].text) + len(record.steps[0].name) < 21_000


def test_scored_skills_follow_each_other_until_done(tmp_path):
    lines = [followed(name, strict=False) for name in (*FETCH, *STOW, "done")]
    assert (lines[0], lines[-1]) == (" find an apple,", " done.")
    record, _ = played(tmp_path, "\n".join(lines), player="scored")
    assert (record.success, record.end, record.calls) == (True, "done", 6)
    assert [answer.text for answer in record.answers] == [step.name for step in record.steps]
    bare = [followed(name, strict=True) for name in (*FETCH, "done")]
    record, _ = played(tmp_path, "\n".join(bare), player="scored", strict=True)
    assert (record.success, record.end, bare[0]) == (False, "done", " find an apple")


@pytest.mark.parametrize("scoring", ["sum", "average"])
def test_scored_skill_is_the_best_of_all_scores(tmp_path, scoring):
    model = LlamaModel(export_tiny(tmp_path / "tiny.gguf"), options=LlamaOptions(threads=1))
    record = play(stage(tmp_path, model), LotaRow(name="r", scoring=scoring), listed(), 0, {})
    texts = [followed(name, strict=False) for name in NAMES]
    for place, answer in enumerate(record.answers[:2]):
        prompt = score_prompt(SAID, record.steps[:place], OPTIONS)
        values = scores(model.gguf, prompt, texts, scoring)
        assert values[NAMES.index(answer.text)] == pytest.approx(values.max(), abs=0.02)
        assert answer.score == pytest.approx(values.max(), abs=0.02)
    assert record.answers
    model.close()


def test_planner_that_fails_is_an_error_of_its_episode_and_stays_in_the_rate(tmp_path):
    record, _ = played(tmp_path)  # the script has run out
    assert (record.end, record.success) == ("error", False)
    assert "run out" in record.error
    good, _ = played(tmp_path, ", ".join((*FETCH, *STOW)))
    found = results_of([record, good], LOTA_TABLES)
    told = {"kind": "all", "success": 0.5, "crashed": 1, "success_without_crashed": 1.0}
    assert told.items() <= found.figures[0].items()
    assert found.table.lines == (("**r**", "50.0", "50.0"),)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (listed("trial_T1"), "there is no trial trial_T1"),
        (listed(repeat=4), "trial ours_1 has no annotation 4"),
    ],
)
def test_task_that_cannot_be_begun_is_not_run(tmp_path, task, message):
    found, _ = played(tmp_path, task=task)
    assert isinstance(found, NotRun)
    assert (found.reason, found.alone) == (message, True)
