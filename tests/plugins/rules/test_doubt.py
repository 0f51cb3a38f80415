"""Doubt decides by a planner's first answer whether a request is refused."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma.agent.planning.planner import Planner
from karma.contracts import (
    Certainty,
    Completion,
    Decoding,
    FailedProgram,
    Hint,
    Meaning,
    PlanRequest,
    RefusedRequest,
)
from karma.errors import FileError
from karma.files import to_json
from karma.models.scripted import ScriptedModel
from karma.plugins.rules.request_refusals import (
    FEATURES,
    LogisticDoubt,
    far_words,
    read_doubt,
    weakest_hint,
)

GOOD = "GoToObject(robot, 'Apple')\nPickupObject(robot, 'Apple')\n"
REFUSE = "refuse('thing')\n"
HAMMER = Hint(phrase="big hammer", meanings=(Meaning(name="Knife", similarity=0.4),))
TUMBLER = Hint(phrase="tumbler", meanings=(Meaning(name="Cup", similarity=0.8),))
FETCH = Hint(phrase="yank", meanings=(Meaning(name="hold", similarity=0.3),))
ASKED = PlanRequest(instruction="bring the big hammer")
FITTED = LogisticDoubt(
    coefficients={"refusing": 1.0}, intercept=0.0, threshold=0.5, fitted_on="nothing"
)


class SureModel(ScriptedModel):
    """Says its script, and how likely it was to refuse."""

    def __init__(self, answers, refusing):
        super().__init__(answers)
        self._refusing = refusing

    def complete(self, prompt, *, spec=None, **options):
        certainty = Certainty(mean_logprob=-0.1, least_logprob=-0.5, refusing=self._refusing)
        return replace(super().complete(prompt, spec=spec, **options), certainty=certainty)


def plans(answers, chance, facts=ASKED, doubt=FITTED, **decoding):
    model = SureModel(answers, chance)
    planner = Planner(
        model,
        "compact",
        Decoding(**{"refusing": True, "inspected": False, **decoding}),
        doubt=doubt,
    )
    return model, list(planner.plan(facts))


def test_answer_is_kept_where_doubt_is_below_the_threshold():
    _, (plan,) = plans([GOOD], 0.2)
    assert (len(plan.calls), plan.refused) == (2, None)
    assert plan.doubt == pytest.approx(0.2, abs=1e-5)


def test_answer_is_refused_where_doubt_is_above_and_the_far_words_are_named():
    facts = replace(ASKED, hints=(HAMMER, TUMBLER))
    _, (plan,) = plans([GOOD], 0.8, facts)
    assert plan.refused == RefusedRequest(kind="thing", by="doubt", words=("big hammer",))
    assert (plan.calls, plan.error, plan.failure) == ((), "", None)
    assert plan.doubt == pytest.approx(0.8, abs=1e-5)


@pytest.mark.parametrize(
    ("hints", "kind"), [((), "unclear"), ((TUMBLER,), "unclear"), ((FETCH,), "deed")]
)
def test_kind_of_a_doubted_request_follows_from_what_is_far(hints, kind):
    _, (plan,) = plans([GOOD], 0.9, replace(ASKED, hints=hints))
    assert plan.refused.kind == kind


def test_refusal_of_the_planner_is_kept_with_its_kind_where_doubt_agrees():
    _, (plan,) = plans([REFUSE], 0.9)
    assert plan.refused == RefusedRequest(kind="thing")


def test_refusal_that_doubt_does_not_share_is_asked_again_without_the_choice():
    model, (first, second) = plans([REFUSE, GOOD], 0.3)
    assert first.refused is not None
    assert (len(second.calls), second.refused) == (2, None)
    assert [bool(spec.refusals) for spec in model.specs] == [True, False]


def test_doubt_is_asked_for_the_first_answer_only_and_not_after_a_failure():
    failed = FailedProgram(lines=(), failed=None, reason="x")
    _, (plan,) = plans([GOOD], 0.9, replace(ASKED, failures=(failed,)))
    assert plan.refused is None and plan.doubt is None


def test_doubt_is_silent_where_the_planner_may_not_refuse_or_tells_nothing():
    _, (plan,) = plans([GOOD], 0.9, refusing=False)
    assert (plan.refused, plan.doubt) == (None, None)
    planner = Planner(ScriptedModel([GOOD]), "compact", Decoding(refusing=True), doubt=FITTED)
    (plan,) = planner.plan(ASKED)
    assert (plan.refused, plan.doubt) == (None, None)


def completion(certainty):
    return Completion(
        text="", finish="stop", prompt_tokens=1, reused_tokens=None, completion_tokens=1,
        first_token_s=None, total_s=0.0, certainty=certainty,
    )  # fmt: skip


@given(low=st.floats(0, 1), high=st.floats(0, 1), mean=st.floats(-100, 0), least=st.floats(-100, 0))
def test_probability_grows_with_the_chance_of_refusing_and_stays_one(low, high, mean, least):
    low, high = sorted((low, high))
    doubt = LogisticDoubt(
        coefficients=dict.fromkeys(FEATURES, 0.7), intercept=-1.0, threshold=0.5, fitted_on=""
    )
    found = [
        doubt.of(
            completion(Certainty(mean_logprob=mean, least_logprob=least, refusing=chance)), ASKED
        )
        for chance in (low, high)
    ]
    assert 0 <= found[0] <= found[1] <= 1


def test_far_words_and_weakest_hint_of_a_request_are_those_of_its_hints():
    request = replace(ASKED, hints=(HAMMER, TUMBLER))
    assert far_words(request) == 0.75
    assert weakest_hint(request) == 0.4
    assert (far_words(ASKED), weakest_hint(ASKED)) == (0.0, 1.0)


def test_doubt_is_read_back_as_it_was_written(tmp_path):
    path = tmp_path / "doubt.json"
    path.write_bytes(to_json(FITTED))
    assert read_doubt(path) == FITTED


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (b'"refusing"', b'"mood"'), (b"0.5", b"1.5"), (b'"threshold"', b'"treshold"'), (b"{", b""),
    ],
)  # fmt: skip
def test_doubt_that_is_none_is_refused_by_name(tmp_path, change, named):
    path = tmp_path / "doubt.json"
    path.write_bytes(to_json(FITTED).replace(change, named, 1))
    with pytest.raises(FileError, match=r"doubt\.json"):
        read_doubt(path)
