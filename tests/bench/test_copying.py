"""The control row that copies the nearest example's program."""

from dataclasses import replace

import pytest
from support.needs import need_models

from karma import registry
from karma.bench.methods.expert import CopyingMethod
from karma.errors import KarmaError
from karma.loading.planner_files import examples_for, read_bank
from karma.models.scripted import MetadataVision, ScriptedModel
from karma.types.completion import Decoding
from karma.types.planning import PlanRequest
from karma.types.roles import Resources


@pytest.fixture(scope="module")
def resources():
    need_models("minilm")
    embedder = registry.load("embedders", "minilm")()
    return Resources(
        model=ScriptedModel(),
        profile="full",
        decoding=Decoding(attempts=1),
        recall=registry.load("recalls", "cosine")(embedder),
        vision=MetadataVision(),
        embedder=embedder,
        examples=examples_for(4, embedder=embedder),
    )


@pytest.mark.parametrize("profile", ["full", "goals"])
def test_a_sentence_of_the_bank_gets_its_own_program_whatever_was_asked_before(resources, profile):
    planner = CopyingMethod.build(replace(resources, profile=profile), {}).planner
    assert planner.profile == "full"
    for one in read_bank()[:60:20]:
        (plan,) = planner.plan(PlanRequest(instruction=one.instruction))
        assert plan.completion.text == one.program
        assert plan.examples[-1] == one.instruction


def test_run_without_examples_is_refused_with_what_would_tell_some(resources):
    with pytest.raises(KarmaError, match=r"needs examples: profile = .*, examples = 1 or more"):
        CopyingMethod.build(replace(resources, examples=None), {})
