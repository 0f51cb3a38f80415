"""How sure a model was: by arithmetic, and against the scores that the same weights give texts."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.hosted_server import NANO
from support.needs import need_models

from karma.agent.planning.planner import program_spec
from karma.agent.planning.prompt import compact
from karma.models.llama.answer import CertaintyLog, TokenTable
from karma.models.llama.model import LlamaModel
from karma.types.memory import Area
from karma.types.planning import PlanRequest

PIECES = (b"Go", b"re", b"refuse('", b"r", b"robot", b"", b"x", b"refused")
TABLE = TokenTable(PIECES, [5])
LOGITS = st.lists(st.floats(-30, 30, width=32), min_size=8, max_size=8)


def chances(logits):
    """Softmax by Python's own floats."""
    top = max(logits)
    weights = [math.exp(one - top) for one in logits]
    return [weight / math.fsum(weights) for weight in weights]


@given(steps=st.lists(st.tuples(LOGITS, st.integers(0, 7)), min_size=1, max_size=5))
def test_certainty_is_mean_and_least_of_the_logarithms_of_the_chosen_tokens_chances(steps):
    log = CertaintyLog(TABLE, may_refuse=True)
    for logits, token in steps:
        log.add(np.array(logits, np.float32), token)
    expected = [logits[token] - max(logits) for logits, token in steps]
    expected = [
        one - math.log(math.fsum(math.exp(each - max(logits)) for each in logits))
        for one, (logits, _) in zip(expected, steps, strict=True)
    ]
    found = log.certainty()
    assert found.mean_logprob == pytest.approx(sum(expected) / len(expected), abs=1e-4)
    assert found.least_logprob == pytest.approx(min(expected), abs=1e-4)
    first = chances(steps[0][0])
    assert found.refusing == pytest.approx(first[1] + first[2] + first[3] + first[7], abs=1e-4)


def test_certainty_of_an_answer_that_may_not_refuse_knows_no_refusing():
    log = CertaintyLog(TABLE, may_refuse=False)
    assert log.certainty() is None
    log.add(np.zeros(8, np.float32), 0)
    assert log.certainty().refusing is None
    assert log.certainty().mean_logprob == pytest.approx(-math.log(8), abs=1e-5)


@pytest.mark.model
def test_certainty_agrees_with_the_score_of_the_same_text():
    need_models("karma-nano")
    model = LlamaModel(NANO)
    areas = (Area(name="node_1", position_m=(0, 0, 0), contains=("Fridge", "Sink")),)
    facts = PlanRequest(instruction="put the mug in the fridge", areas=areas)
    rendered = compact(facts)
    spec = program_spec(facts, rendered.names, refusing=True)
    answer = model.complete(rendered.prompt, spec=spec)
    again = model.complete(rendered.prompt, spec=spec)
    assert (again.text, again.certainty) == (answer.text, answer.certainty)
    prompt = (rendered.prompt.stable, rendered.prompt.changing)
    choice = model.choose(prompt, [answer.text], scoring="average")
    tokens = len(model.gguf.tokens(answer.text))
    total = choice.score * tokens
    ended = answer.certainty.mean_logprob * (tokens + 1)
    assert ended <= total + 1e-3 and ended == pytest.approx(total, abs=0.5)
    assert answer.certainty.least_logprob <= answer.certainty.mean_logprob <= 0
    assert answer.certainty.refusing < 0.01  # it has not learnt to
    model.close()
