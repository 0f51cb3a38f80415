"""Scoring of continuations against its definition, on random weights and on the shipped planner."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.needs import need_models
from support.paths import ROOT
from support.scores import scores
from support.tiny import export_tiny

from karma.errors import ModelError
from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.models.llama.scoring import choose
from karma.types.completion import END
from karma.types.planning import Prompt

NANO = ROOT / "models/nano/planner.gguf"
PROMPT = ("#areas\nunknown\n", "#task put the apple in the fridge\n#memory\n#program\n")
TEXTS = [
    END,
    "GoToObject(robot, 'Apple')\n",
    "GoToObject(robot, 'AppleSliced')\n",
    "GoToObject(robot, 'Fridge')\n",
    "PutObject(robot, 'Apple', 'Fridge')\n",
    "PutObject(robot, 'Apple', 'Fridge')\nCloseObject(robot, 'Fridge')\n",
    "a",
    "go",
    "Möhre\n",
    "人参\n",
    "a\udc80b",
]
WORDS = st.text("apb (\n", min_size=1, max_size=9)


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    path = export_tiny(tmp_path_factory.mktemp("tiny") / "tiny.gguf")
    model = LlamaModel(path, options=LlamaOptions(threads=1))
    yield model
    model.close()


def assert_best(model, prompt, texts, scoring="sum"):
    values = scores(model, prompt, texts, scoring)
    best = choose(model, prompt, texts, scoring=scoring)
    assert best.score == pytest.approx(values.max(), abs=0.02)
    assert values[best.number] == pytest.approx(values.max(), abs=0.02)
    return best


@pytest.mark.model
def test_choice_of_the_shipped_planner_is_the_argmax_of_the_definition():
    need_models("karma-nano")
    model = GgufModel(NANO, LlamaOptions(threads=1))
    for task in ("put the apple in the fridge", "wash a mug", "turn off the lamp"):
        prompt = (PROMPT[0], f"#task {task}\n#memory\n#program\n")
        assert_best(model, prompt, TEXTS)
        assert_best(model, (*prompt, TEXTS[1]), TEXTS, "average")
    model.close()


@pytest.mark.parametrize(
    "prompt", [PROMPT, ("".join(PROMPT),), (*PROMPT, "a"), ("a",), ("Möhre 🥕\n", "x")]
)
@pytest.mark.parametrize("scoring", ["sum", "average"])
def test_the_best_is_the_argmax_of_the_definition(planner, prompt, scoring):
    for count in range(1, len(TEXTS) + 1, 3):
        assert_best(planner.gguf, prompt, TEXTS[-count:], scoring)


@given(st.lists(WORDS, min_size=1, max_size=20), st.sampled_from(["sum", "average"]))
@settings(max_examples=15, deadline=None)
def test_the_best_of_any_texts_is_the_argmax(planner, texts, scoring):
    assert_best(planner.gguf, PROMPT, texts, scoring)


def test_text_longer_than_a_batch_is_scored(planner):
    texts = ["go " * 300, "go " * 299 + "b" * 3]
    model = planner.gguf
    assert max(len(model.tokens(text)) for text in texts) > model.n_batch
    best = choose(model, PROMPT, texts)
    assert best.score == pytest.approx(scores(model, PROMPT, texts).max(), rel=1e-3)


def test_the_first_of_equals_is_chosen_and_less_than_all_is_run(planner):
    assert choose(planner.gguf, PROMPT, ["go", "a", "a", "go"]).number in (0, 1)
    texts = [f"{a}{b}{c}{d}" for a in "abcdef" for b in "ghijkl" for c in "mnop" for d in "qrst"]
    assert choose(planner.gguf, PROMPT, texts).run_tokens < len(texts) / 2


def test_what_was_asked_before_changes_no_bit(planner):
    longer = (*PROMPT, "GoToObject(robot, 'Apple')\n")
    cold = choose(planner.gguf, longer, TEXTS)
    choose(planner.gguf, ("#other\n",), TEXTS)
    choose(planner.gguf, PROMPT, TEXTS)
    warm = choose(planner.gguf, longer, TEXTS)
    assert (warm.number, warm.score) == (cold.number, cold.score)
    assert warm.reused_tokens > 0


def test_scoring_changes_no_answer(planner):
    prompt = Prompt(stable=PROMPT[0], changing=PROMPT[1])
    before = planner.complete(prompt, max_tokens=12)
    planner.choose(PROMPT, TEXTS)
    assert planner.complete(prompt, max_tokens=12).text == before.text


def test_what_cannot_be_scored_is_refused(planner):
    model = planner.gguf
    with pytest.raises(ModelError, match=f"needs a context of .*, but tiny has {model.limit}$"):
        choose(model, ("x " * model.limit,), TEXTS)
    for prompt, texts, said in ((PROMPT, [], "no continuation"), ((), ["a"], "no prompt")):
        with pytest.raises(ValueError, match=said):
            choose(model, prompt, texts)
