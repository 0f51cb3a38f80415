"""Answers of a local model cut anywhere: nothing is carried out but whole programs."""

import pytest
from support.cut_answers import AREAS, EVERY, UNITS, asked
from support.needs import need_models

from karma.agent.planning.planner import Planner
from karma.models.llama.model import LlamaModel
from karma.models.manifest import resolve_planner
from karma.types.completion import Decoding
from karma.types.planning import PlanRequest


@pytest.mark.parametrize(
    "said", ["Wash the mug", "Put the apple in the fridge, then open the fridge", "Slice the apple"]
)
def test_answer_of_a_local_model_is_whole_or_it_is_a_fault(said):
    need_models("karma-nano")
    file = resolve_planner("karma-nano")
    model = LlamaModel(file.path, sha256=file.sha256, name=file.name)
    request = PlanRequest(instruction=said, areas=AREAS, units=UNITS)
    for level in ("types", "free"):  # some tokens, and each of the last where it is whole
        (plan,) = Planner(model, "compact", Decoding(attempts=1, constraint=level)).plan(request)
        whole, tokens = [str(call) for call in plan.calls], plan.completion.completion_tokens
        assert whole and plan.completion.finish == "stop"
        for most in {*range(1, tokens, 1 if EVERY else 7), tokens - 2, tokens - 1, tokens} - {0}:
            found = asked(model, said, constraint=level, max_tokens=most)
            assert found in ([], whole)
            assert not found or most >= tokens - 1  # but for a line break that ends it
    model.close()
