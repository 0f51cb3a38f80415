"""Plans in JSON: what a grammar admits, and what models say under them."""

import json

import numpy as np
import pytest
from support.hosted_server import NANO
from support.needs import need_models
from support.plans import ILLEGAL, LEGAL, PLANS
from support.tiny import export_tiny

from karma.models.constraint import admits
from karma.models.llama.model import LlamaModel
from karma.models.llama.opening import LlamaOptions
from karma.plugins.alfred.suites.plan_spec import PlanSpec
from karma.types.planning import Prompt

PROMPT = Prompt(stable="#areas\n", changing="#task put the apple in the fridge\n")


@pytest.mark.parametrize(("texts", "legal"), [(LEGAL, True), (ILLEGAL, False)])
def test_grammar_admits_plans_only(texts, legal):
    assert [admits(PLANS.grammar, text) for text in texts] == [legal] * len(texts)


def test_spec_without_text_or_with_one_action_is_admitted_alike():
    spec = PlanSpec(
        texts=("why",), plan="plan", number="id", name="a", actions=("x",), max_text=0,
        max_actions=1,
    )  # fmt: skip
    text = '{"why":"","plan":[{"id":0,"a":"x"}]}'
    assert admits(spec.grammar, text)
    assert not admits(spec.grammar, text.replace("]", ',{"id":0,"a":"x"}]'))


# ----------------------------------------------------------------- models


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """A model of random weights, and the nano planner."""
    need_models("karma-nano")
    path = export_tiny(tmp_path_factory.mktemp("tiny") / "tiny.gguf")
    options = LlamaOptions(threads=1)
    found = [LlamaModel(one, options=options) for one in (path, NANO)]
    yield found
    for model in found:
        model.close()


@pytest.mark.model
def test_constrained_answers_of_any_weights_parse_and_name_listed_actions(models):
    draws = np.random.default_rng(0)
    lengths = set()
    for model in models:
        for seed in range(12):
            words = " ".join(map(str, draws.integers(1000, size=5)))
            prompt = Prompt(stable=PROMPT.stable, changing=f"#task {words}\n")
            answer = model.complete(
                prompt, spec=PLANS, max_tokens=300, temperature=1.5 * (seed % 3), seed=seed
            )
            assert answer.finish == "stop"
            assert answer.constrained is True
            assert admits(PLANS.grammar, answer.text), answer.text
            lengths.add(len(json.loads(answer.text)["plan"]))
    assert len(lengths) > 1  # they do differ


def test_context_may_be_longer_than_it_was_trained_for_if_it_is_named(tmp_path):
    path = export_tiny(tmp_path / "tiny.gguf")
    trained = LlamaModel(path, options=LlamaOptions())
    longer = LlamaModel(path, options=LlamaOptions(n_ctx=6000))
    assert (trained.gguf.limit, longer.gguf.limit) == (4096, 6000)
    prompt = Prompt(stable="", changing="put the apple in the fridge\n" * 600)
    answer = longer.complete(prompt, spec=PLANS, max_tokens=100)
    assert answer.prompt_tokens > 4096
    assert admits(PLANS.grammar, answer.text)
    for model in (trained, longer):
        model.close()
