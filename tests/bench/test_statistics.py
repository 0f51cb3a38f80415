"""Intervals and paired tests, held against other implementations."""

import itertools
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from karma.bench.figures.statistics import (
    bootstrap,
    effective_number,
    mcnemar,
    mean,
    rate,
    sign_flip,
    wilson,
)

ZERO_ONE = st.sampled_from((0.0, 1.0))
GROUPS = st.lists(st.lists(ZERO_ONE, min_size=1, max_size=5), min_size=1, max_size=12)
AMOUNTS = st.lists(
    st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=3), min_size=1, max_size=8
)  # fmt: skip


# ----------------------------------------------------------------- Wilson


@pytest.mark.parametrize(
    ("successes", "number", "low", "high"),
    [
        # Newcombe (1998), Statistics in Medicine 17, table I, method 3
        (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)  # fmt: skip
def test_wilson_equals_published_intervals(successes, number, low, high):
    found = wilson(successes, number)
    assert (round(found.low, 4), round(found.high, 4)) == (low, high)


@given(number=st.integers(1, 400), share=st.floats(0, 1))
def test_wilson_and_mcnemar_agree_with_scipy(number, share):
    successes = round(number * share)
    tested = stats.binomtest(successes, number)
    theirs, found = tested.proportion_ci(method="wilson"), wilson(successes, number)
    assert (found.low, found.high) == pytest.approx((theirs.low, theirs.high), abs=1e-9)
    assert mcnemar(successes, number - successes) == pytest.approx(tested.pvalue, abs=1e-9)


# ----------------------------------------------------------------- seeds of one task


@given(groups=GROUPS)
def test_rate_interval_contains_the_rate(groups):
    found = rate(groups)
    assert found.value == pytest.approx(np.mean([x for group in groups for x in group]))
    assert found.value in found.interval
    assert 0 <= found.interval.low <= found.interval.high <= 1
    assert found.number == sum(map(len, groups))


@given(groups=GROUPS)
def test_effective_number_lies_between_tasks_worth_and_all_observations(groups):
    number = sum(map(len, groups))
    sizes = sum(len(group) ** 2 for group in groups) / number
    assert number / sizes - 1e-9 <= effective_number(groups) <= number + 1e-9


@given(outcomes=st.lists(ZERO_ONE, min_size=2, max_size=20), seeds=st.integers(1, 7))
def test_seeds_that_always_agree_count_once(outcomes, seeds):
    groups = [[one] * seeds for one in outcomes]
    assert effective_number(groups) == pytest.approx(len(outcomes))
    assert rate(groups).interval.low == pytest.approx(wilson(sum(outcomes), len(outcomes)).low)


def test_rate_covers_the_truth_where_seeds_are_correlated():
    """Tasks have success rates of their own; the interval is about the mean over all tasks."""
    random, covered, naive = Random(11), 0, 0
    for _ in range(400):
        chances = [random.betavariate(0.5, 0.5) for _ in range(40)]
        groups = [[float(random.random() < chance) for _ in range(5)] for chance in chances]
        successes = sum(map(sum, groups))
        covered += 0.5 in rate(groups).interval
        naive += 0.5 in wilson(successes, 200)
    assert covered / 400 > 0.92
    assert naive / 400 < 0.85


# ----------------------------------------------------------------- bootstrap


@settings(max_examples=30)
@given(groups=AMOUNTS)
def test_mean_interval_contains_the_mean_and_has_no_order(groups):
    found = mean(groups)
    assert found.value == pytest.approx(np.mean([x for g in groups for x in g]), abs=1e-6)
    if found.interval is not None:
        assert found.value in found.interval
    turned = mean(groups[::-1])
    assert turned.value == pytest.approx(found.value, abs=1e-6)


def test_bootstrap_equals_all_resamples_of_a_small_table():
    """Six tasks have 46,656 resamples; quantiles of their means are what 10,000 draws come to."""
    values = [1.0, 2.0, 6.0, 3.0, 9.0, 4.0]
    exact = [sum(drawn) / 6 for drawn in itertools.product(values, repeat=6)]
    sums = np.array([[v, 1.0] for v in values])
    found = bootstrap(sums, lambda s: s[:, 0] / s[:, 1], number=6)
    ends = found.interval
    assert [ends.low, ends.high] == pytest.approx(np.quantile(exact, [0.025, 0.975]), abs=0.2)


@pytest.mark.parametrize("tasks", [1, 2, 5, 6])
def test_mean_of_fewer_than_six_tasks_has_no_interval(tasks):
    found = mean([[float(number)] for number in range(tasks)])
    assert found.value == (tasks - 1) / 2
    assert (found.interval is None) == (tasks < 6)


def test_bootstrap_agrees_with_scipy_where_every_task_is_seen_once():
    random = np.random.default_rng(2)
    values = random.exponential(2.0, size=25)
    ours = mean([[value] for value in values]).interval
    theirs = stats.bootstrap(
        (values,), np.mean, n_resamples=20_000, method="percentile", rng=random
    ).confidence_interval
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), rel=0.03)


# ----------------------------------------------------------------- two arms


@given(differences=st.lists(st.integers(-5, 5), max_size=9))
def test_sign_flip_counts_all_exchanges(differences):
    sums = [
        abs(sum(sign * d for sign, d in zip(signs, differences, strict=True)))
        for signs in itertools.product((1, -1), repeat=len(differences))
    ]
    expected = sum(one >= abs(sum(differences)) for one in sums) / len(sums)
    assert sign_flip(differences) == pytest.approx(expected)


@given(first=st.integers(0, 25), second=st.integers(0, 25))
def test_sign_flip_of_single_pairs_is_mcnemar(first, second):
    assert sign_flip([1] * first + [-1] * second) == pytest.approx(mcnemar(first, second))
