"""The policy laboratory: traces, hit counts, the bound.

Covered: hit counts of two real traces; libcachesim; Belady's bound against all choices; laws that
hold of policies on random tasks; intervals; damaged trace files.
"""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma import registry
from karma.bench.policies.simulate import Trace, best, simulate
from karma.bench.policies.sweep import (
    Resampler,
    run_rows,
    sized,
    sweep_of,
)
from karma.errors import KarmaError, UnknownNameError
from karma.seeds import stream

REAL = ("alfred_rooms_m_seq0", "alfred_type_r4_seq0")
TASKS = st.lists(st.lists(st.sampled_from("abcdefgh"), max_size=4), max_size=40)


def single(keys):
    return Trace.of((key,) for key in keys)


def zipf_keys(count, kinds=60, seed=1):
    weights = 1 / stream(seed, "lab-tests", "order").permutation(range(1, kinds + 1))
    return stream(seed, "lab-tests").choice(kinds, size=count, p=weights / weights.sum()).tolist()


# ----------------------------------------------------------------- outside counts


def golden(shared, name):
    data = json.loads((shared / "data" / "traces" / f"{name}.json").read_bytes())
    return {int(size): row["hits"] for size, row in data["golden"].items()}


def policy_of(row, size):
    """Return our text for a row of the golden files, "" where we have none."""
    plain = {"FIFO (libCacheSim)": "fifo-merge", "LRU (libCacheSim)": "lru",
             "LFU (libCacheSim)": "lfu", "ARC (libCacheSim)": "arc"}  # fmt: skip
    if row in plain:
        return f"{plain[row]}[{size}]"
    if not row.startswith("W-TinyLFU"):
        return ""
    window = int(row.split()[1].removeprefix("w="))
    return f"wtinylfu-caffeine[{window},{size - window}]" + " cm4" * row.endswith("cm4")


@pytest.mark.shared
@pytest.mark.parametrize("name", REAL)
def test_real_traces_give_the_golden_counts(shared, name):
    keys = json.loads((shared / "data" / "traces" / f"{name}.json").read_bytes())["trace"]
    trace = single(keys)
    checked = 0
    for size, rows in golden(shared, name).items():
        bound = simulate(f"belady[{size}]", trace).hits
        assert max(rows.values()) <= bound
        for row, hits in rows.items():
            if text := policy_of(row, size):
                assert simulate(text, trace).hits == hits, (size, row)
                checked += 1
    assert checked == 32


def library_hits(kind, keys, size):
    """Count hits of a policy of libcachesim, telling it when each key comes next."""
    cachesim = pytest.importorskip("libcachesim", reason="has no wheel for this machine")
    cache, upcoming, later = getattr(cachesim, kind)(size), [], {}
    for index in range(len(keys) - 1, -1, -1):
        upcoming.append(later.get(keys[index], 1 << 62))
        later[keys[index]] = index
    hits = 0
    for key, use in zip(keys, reversed(upcoming), strict=True):
        request = cachesim.Request()
        request.obj_id, request.obj_size, request.next_access_vtime = key, 1, use
        hits += cache.get(request)
    return hits


@pytest.mark.parametrize("size", [1, 2, 5, 10, 25])
@pytest.mark.parametrize(
    "kind, name", [("FIFO", "fifo-merge"), ("LRU", "lru"), ("LFU", "lfu"), ("ARC", "arc")]
)
def test_hits_equal_those_of_libcachesim(kind, name, size):
    for seed in range(4):
        keys = zipf_keys(800, seed=seed)
        found = simulate(f"{name}[{size}]", single(keys)).hits
        assert found == library_hits(kind, keys, size), seed


# ----------------------------------------------------------------- the bound


def slow_best(tasks, capacity):
    """Try every choice of what to keep between tasks."""
    kept = {frozenset(): 0}
    for task in tasks:
        following = {}
        for held, hits in kept.items():
            now = hits + len(held & set(task))
            for option in subsets(sorted(held | set(task)), capacity):
                following[option] = max(now, following.get(option, 0))
        kept = following
    return max(kept.values())


def subsets(keys, most):
    found = [()]
    for key in keys:
        found += [(*one, key) for one in found if len(one) < most]
    return map(frozenset, found)


@settings(max_examples=60)
@given(
    tasks=st.lists(st.lists(st.sampled_from("abcde"), max_size=3), max_size=7),
    capacity=st.integers(0, 3),
)
def test_bound_is_the_best_of_all_choices_between_tasks(tasks, capacity):
    assert best(Trace.of(tasks), capacity).hits == slow_best(tasks, capacity)


@pytest.mark.parametrize("name", [n for n in registry.names("policies") if n != "unbounded"])
@settings(max_examples=25)
@given(tasks=TASKS, capacity=st.integers(1, 6))
def test_no_policy_hits_more_than_the_bound_of_tasks(name, tasks, capacity):
    trace = Trace.of(tasks)
    assert simulate(f"{name}[{capacity}]", trace).hits <= best(trace, capacity).hits


# ----------------------------------------------------------------- outcomes


def test_outcome_of_a_known_trace():
    trace = Trace.of(["ab", "ab", "c", "b", "a", "a"])
    found = simulate("lru[2]", trace)
    assert list(found.answers) == [0, 0, 1, 1, 0, 1, 0, 1]
    assert (found.requests, found.hits, found.left, found.warm_task) == (8, 4, 2, 1)
    assert (found.rate(), found.rate(3)) == (4 / 8, 2 / 3)
    assert found.between(1, 3) == (2, 3)


# ----------------------------------------------------------------- names and sizes


def test_policies_take_their_sizes():
    assert sized(["lru", "wtinylfu-karma W=inf"], [5, 10]) == (
        "lru[5]", "lru[10]", "wtinylfu-karma[5] W=inf", "wtinylfu-karma[10] W=inf",
    )  # fmt: skip
    assert sized(["wtinylfu-caffeine[9/1]"], [5, 10, 25]) == (
        "wtinylfu-caffeine[4,1]", "wtinylfu-caffeine[9,1]", "wtinylfu-caffeine[23,2]",
    )  # fmt: skip
    assert sized(["lru[7]", "lru"], [7]) == ("lru[7]",)


def test_policies_that_are_none_are_refused():
    with pytest.raises(KarmaError, match="no size"):
        sized(["lru"], [])
    with pytest.raises(UnknownNameError, match="'lru'"):
        sized(["lruu"], [5])
    with pytest.raises(KarmaError, match="at least 1"):
        sized(["belady[0]"], [])
    with pytest.raises(KarmaError, match="only W-TinyLFU"):
        sized(["lru[9/1]"], [10])


# ----------------------------------------------------------------- intervals


def test_correlation_of_a_line_is_one_and_of_a_constant_undefined():
    x = [float(n) for n in range(10)]
    found = Resampler(10, 0).correlation(x, [3 * one - 1 for one in x])
    assert (found.low, found.value, found.high) == (1, 1, 1)
    assert Resampler(10, 0).correlation(x, [1.0] * 10) is None


@pytest.mark.parametrize("count", [2, 5, 6])
def test_a_few_sequences_have_no_interval_and_it_is_said(count):
    traces = [single(zipf_keys(60, seed=seed)) for seed in range(count)]
    found = sweep_of(traces, run_rows(traces, ["lru[5]"]))
    assert (found.rows[0].cold.low is None) == (count < 6)
    assert found.interval.startswith(f"none: {count} sequences" if count < 6 else "bootstrap")


def test_rows_have_the_hits_of_each_sequence():
    traces = [single(zipf_keys(300, seed=seed)) for seed in (1, 2, 3)]
    rows = list(run_rows(traces, ["lru[5]", "belady[5]"], checkpoints=[10, 300, 900]))
    found = sweep_of(traces, rows)
    assert rows[0].hits == [simulate("lru[5]", trace).hits for trace in traces]
    assert rows[0].cold.value == pytest.approx(sum(rows[0].hits) / 900, abs=1e-5)
    assert [point.tasks for point in rows[0].curve] == [10, 300]
    assert rows[0].curve[-1].rate == rows[0].cold
    assert (found.requests, found.steady_requests) == ([300] * 3, [150] * 3)
    assert (rows[1].left, rows[1].warm_task, rows[1].warm) == (None, None, None)
