"""Doubt fitted on drawn requests: against a library's regression, and what its figures mean."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.linear_model import LogisticRegression

from karma.contracts import REFUSAL_KINDS, Certainty, Completion, PlanRequest
from karma.plugins.rules.request_refusals import FEATURES
from karma.plugins.training import figures
from karma.plugins.training.drawing.memories import generated_rooms
from karma.plugins.training.drawing.phrases import our_book
from karma.plugins.training.figures import Judged, Scored, brier, fitted, scored, shares
from karma.plugins.training.refusals import languages, phrases, unseen_refusals
from karma.plugins.training.samples import TrainingExample

NAMES = ("refusing", "mean_logprob")


def judged(to_refuse, refusing, mean=-0.1):
    return Judged(
        example=TrainingExample(
            kind="refuse_deed" if to_refuse else "place", stable="", changing="", program=""
        ),
        request=PlanRequest(instruction="put it there"),
        completion=Completion(
            text="", finish="stop", prompt_tokens=1, reused_tokens=None, completion_tokens=1,
            first_token_s=None, total_s=0.0,
            certainty=Certainty(mean_logprob=mean, least_logprob=mean, refusing=refusing),
        ),
    )  # fmt: skip


def made(count, seed, *, help=1.5):
    """Requests whose chance of refusing tells something, but not all."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        odds = rng.normal(help if number % 2 else -help, 2)
        found.append(judged(bool(number % 2), 1 / (1 + np.exp(-odds)), -float(rng.random())))
    return found


def test_regression_equals_that_of_a_library():
    features, right = figures._table(made(300, 1), NAMES)
    weights, intercept = figures._regression(features, right)
    spread = features.std(0)
    other = LogisticRegression(C=1 / figures._PENALTY, tol=1e-10, max_iter=1000)
    other.fit((features - features.mean(0)) / spread, right)
    assert weights * spread == pytest.approx(other.coef_[0], abs=1e-4)
    chances = other.predict_proba((features - features.mean(0)) / spread)[:, 1]
    assert 1 / (1 + np.exp(-(features @ weights + intercept))) == pytest.approx(chances, abs=1e-4)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 10_000), refused=st.sampled_from((0.0, 0.02, 0.1)))
def test_threshold_refuses_no_more_of_what_is_to_be_done_than_it_may(seed, refused):
    found = made(200, seed)
    told = scored(fitted(found, NAMES, refused=refused), found)
    done = [one.refused for one in told if not one.judged.to_refuse]
    assert sum(done) <= refused * len(done) + 1  # rounding of the threshold moves one at most


def test_fit_needs_requests_of_both_sorts():
    with pytest.raises(ValueError, match="on requests to refuse and on requests to do"):
        fitted([judged(True, 0.5)] * 5)


def test_cross_validated_figures_tell_a_feature_that_helps_from_one_that_does_not():
    helps = figures.cross_validated(made(400, 2), NAMES, refused=0.05)
    lost = figures.cross_validated(made(400, 2, help=0.0), NAMES, refused=0.05)
    assert len(helps) == 400
    assert brier(helps) < 0.2 < brier(lost) < 0.27
    found = {name: times / number for name, (times, number, _) in shares(helps).items()}
    assert found["to refuse"] > 0.25 > 0.1 > found["to do"]


def said(chance, to_refuse, *, refused=False):
    return Scored(judged=judged(to_refuse, 0.5), chance=chance, refused=refused)


def test_brier_score_and_shares_of_made_up_requests():
    told = [said(1.0, True, refused=True), said(0.5, True), said(0.5, False), said(0.0, False)]
    assert brier(told) == pytest.approx(0.125)
    found = shares(told)
    assert found["to refuse"][:2] == (1, 2)
    assert found["to do"][:2] == (0, 2)
    assert found["refuse_deed"][:2] == (1, 2)


def test_drawn_requests_are_of_both_sorts_and_of_all_kinds_and_none_is_of_training():
    rooms, book = list(generated_rooms(3, 5)), our_book().part(held_out=True)
    found = list(figures.drawn(rooms, (book,), 400, 0))
    refused = [one for one in found if one.kind.startswith("refuse_")]
    assert len(refused) == 200
    kinds = Counter(one.kind.removeprefix("refuse_") for one in refused)
    assert set(kinds) == set(REFUSAL_KINDS)
    assert all(one.facts.instruction for one in found)
    trained = {x for said in languages().values() if not said.held_out for x in said.others}
    assert not trained & {one.sentence for one in refused}
    again = list(figures.drawn(rooms, (book,), 10, 0))
    assert again == found[:10]


def test_held_out_refusals_share_no_pattern_with_training():
    trained = {text for group in ("talk", "ask", "tell", "errands", "deeds", "harm", "kept")
               for text in phrases().words[group]}  # fmt: skip
    unseen = {text for texts in unseen_refusals().values() for text in texts}
    assert set(unseen_refusals()) == set(REFUSAL_KINDS)
    assert not trained & unseen


def test_features_of_a_judged_request_are_those_of_doubt():
    assert set(judged(True, 0.5).features) == set(FEATURES)
    untold = replace(judged(True, 0.5), completion=replace(
        judged(True, 0.5).completion, certainty=None
    ))  # fmt: skip
    with pytest.raises(ValueError, match="tells no certainty"):
        _ = untold.features
