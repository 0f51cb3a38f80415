"""Skill scoring against its definition, on random weights and on the shipped planner."""

import os
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.every_score import every_score
from support.naive_scoring import Naive, lines, prompts, tokens_of
from support.needs import need_models
from support.paths import ROOT
from support.tiny import export_tiny

from karma.errors import ModelError
from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.models.llama.scoring import SkillScorer
from karma.types.completion import END
from karma.types.planning import Prompt

NANO = ROOT / "models/nano/planner.gguf"
PROMPT = ("#areas\nunknown\n", "#task put the apple in the fridge\n#memory\n#program\n")
SKILLS = [
    END,
    "GoToObject(robot, 'Apple')\n",
    "GoToObject(robot, 'AppleSliced')\n",
    "GoToObject(robot, 'Fridge')\n",
    "PutObject(robot, 'Apple', 'Fridge')\n",
    "PutObject(robot, 'Apple', 'Fridge')\nCloseObject(robot, 'Fridge')\n",
    "a",
    "go",
]
WORDS = st.text("apb (\n", min_size=1, max_size=9)


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    opened = LlamaModel(
        export_tiny(tmp_path_factory.mktemp("tiny") / "tiny.gguf"), options=LlamaOptions(threads=1)
    )
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def model(planner):
    return planner.gguf


@pytest.fixture
def scorer(model):
    made = SkillScorer(model)
    yield made
    made.close()


def naive(model, prompt, texts):
    """The definition: prompt and text in one run for each text, token by token."""
    context = Naive(model)
    found = np.array([context.score(prompt, text) for text in texts])
    context.close()
    return found


@pytest.mark.model
def test_scores_of_the_shipped_planner_are_naive_ones():
    """On as many prompts as $KARMA_SAMPLE says, with 200 candidates each."""
    need_models("karma-nano")
    model, off = GgufModel(NANO, LlamaOptions(threads=1)), []
    scorer, count = SkillScorer(model), int(os.environ.get("KARMA_SAMPLE", "1"))
    for prompt in prompts(count):
        texts = [*lines(200 if count > 1 else 20), "人参\n"]
        expected, values = naive(model, prompt, texts), every_score(scorer, prompt, texts).values
        best = scorer.choose(prompt, texts)
        assert best.number == values.argmax() == expected.argmax()
        off += [float(np.abs(values - expected).max()), abs(best.score - expected[best.number])]
    print(f"{count} prompts, argmax equal in all; largest difference of a score {max(off):.1e}")
    assert max(off) < 1e-5
    scorer.close()
    model.close()


# ----------------------------------------------------------------- all scores


@pytest.mark.parametrize(
    "prompt",
    [PROMPT, ("".join(PROMPT),), (*PROMPT, "a"), ("a",), ("Möhre 🥕 in die Tür\n", "x")],
    ids=["segments", "whole", "one token last", "one token", "not ASCII"],
)
def test_scores_are_the_sums_of_the_definition(model, scorer, prompt):
    texts = [*SKILLS, "Möhre\n", "人参\n", "🥕", "a\udc80b"]
    values = every_score(scorer, prompt, texts).values
    assert values == pytest.approx(naive(model, prompt, texts), abs=1e-5)
    assert (values < 0).all()


def test_text_longer_than_a_batch_is_scored_as_defined(model, scorer):
    texts = ["go " * 300, "go " * 299 + "b" * 3, "ab"]
    assert max(len(model.tokens(text)) for text in texts) > model.n_batch
    expected = naive(model, PROMPT, texts)
    assert every_score(scorer, PROMPT, texts).values == pytest.approx(expected, rel=1e-6)


def test_average_divides_by_the_number_of_tokens(model, scorer):
    lengths = [len(tokens_of(model, text)) for text in SKILLS]
    sums = every_score(scorer, PROMPT, SKILLS).values
    averages = every_score(scorer, PROMPT, SKILLS, scoring="average").values
    assert averages == pytest.approx(sums / lengths, abs=1e-12)


def test_a_text_that_begins_another_scores_no_less(model, scorer):
    short, long = SKILLS[4:6]
    assert tokens_of(model, long)[: len(tokens_of(model, short))] == tokens_of(model, short)
    one, other = every_score(scorer, PROMPT, [short, long]).values
    assert one > other


def test_shared_beginnings_run_once_and_last_tokens_not_at_all(model, scorer):
    lists = [tokens_of(model, text) for text in SKILLS]
    inner = {tuple(tokens[:n]) for tokens in lists for n in range(1, len(tokens))}
    assert every_score(scorer, PROMPT, SKILLS).run_tokens == len(inner)


# ----------------------------------------------------------------- the best alone


@given(st.lists(WORDS, min_size=1, max_size=30), st.sampled_from(["sum", "average"]))
@settings(max_examples=40, deadline=None)
def test_best_first_search_finds_the_argmax_of_all_scores(shared_scorer, texts, scoring):
    values = every_score(shared_scorer, PROMPT, texts, scoring=scoring).values
    best = shared_scorer.choose(PROMPT, texts, scoring=scoring)
    assert best.score == pytest.approx(values.max(), abs=1e-6)
    assert values[best.number] == pytest.approx(values.max(), abs=1e-6)


@pytest.fixture(scope="module")
def shared_scorer(model):
    made = SkillScorer(model)
    yield made
    made.close()


def test_best_runs_less_than_all(model, scorer):
    texts = [f"{a}{b}{c}{d}" for a in "abcdef" for b in "ghijkl" for c in "mnop" for d in "qrst"]
    all_of_them = every_score(scorer, PROMPT, texts).run_tokens
    assert scorer.choose(PROMPT, texts).run_tokens < all_of_them / 2


# ----------------------------------------------------------------- what is kept


def test_a_kept_prompt_changes_no_bit(model, scorer):
    longer = (*PROMPT, "GoToObject(robot, 'Apple')\n")
    cold = every_score(scorer, longer, SKILLS)
    scorer.choose(PROMPT, SKILLS)
    every_score(scorer, ("#other\n",), SKILLS)
    before = every_score(scorer, PROMPT, SKILLS)
    warm = every_score(scorer, longer, SKILLS)
    assert (before.reused_tokens, warm.reused_tokens) == (0, before.prompt_tokens)
    assert warm.values.tobytes() == cold.values.tobytes()
    again = SkillScorer(model)
    assert every_score(again, longer, SKILLS).values.tobytes() == cold.values.tobytes()
    again.close()


def test_scoring_leaves_the_models_kept_prompt_and_answers_alone(planner, scorer):
    prompt = Prompt(stable=PROMPT[0], changing=PROMPT[1])
    before = planner.complete(prompt, max_tokens=12)
    logits = planner.gguf.logits().tobytes()
    every_score(scorer, PROMPT, SKILLS)
    assert planner.choose(PROMPT, SKILLS).number == scorer.choose(PROMPT, SKILLS).number
    assert planner.gguf.logits().tobytes() == logits
    after = planner.complete(prompt, max_tokens=12)
    assert (after.text, planner.gguf.logits().tobytes()) == (before.text, logits)
    assert after.reused_tokens > 0


# ----------------------------------------------------------------- refusals


def test_a_prompt_without_room_for_the_longest_text_is_refused(model, scorer):
    prompt = ("x " * model.limit,)
    tokens = len(model.tokens(*prompt, begins=True))
    longest = max(len(tokens_of(model, text)) for text in SKILLS)
    words = f"context of {tokens + longest - 1}, but tiny has {model.limit}$"
    for ask in (partial(every_score, scorer), scorer.choose):
        with pytest.raises(ModelError, match=words):
            ask(prompt, SKILLS)
    assert every_score(scorer, PROMPT, SKILLS).values.shape == (len(SKILLS),)


# ----------------------------------------------------------------- the shipped planner
