"""Each policy against a second, slow telling of the same rule."""

import os
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma import registry
from karma.errors import KarmaError, UnknownNameError
from karma.memory.policies import Fifo, FifoMerge, FifoMergeWhenFull, Lfu, Lru, make_policy
from karma.memory.wtinylfu import CAP, CaffeineWTinyLfu, CountMin4, ExactCounts, KarmaWTinyLfu

KEYS = st.text("01234567", max_size=70)
SIZES = st.integers(1, 6)
SEGMENTS = st.tuples(st.integers(0, 5), st.integers(0, 10)).filter(any)


def segmented(kind, window, main, **options):
    return kind(window + main, window=window, **options)


def segments(policy):
    """The keys in the window, in the elimination segment and in the protected one."""
    window, protected = list(policy._window), list(policy._protected)
    return window, [key for key in policy if key not in (*window, *protected)], protected


def answers(policy, keys):
    return [policy.touch(key) for key in keys]


# ----------------------------------------------------------------- slow tellings


def slow_fifo_merge(keys, capacity):
    queue = []
    for key in keys:
        left = None
        if key not in queue:
            queue.append(key)
            if len(queue) > capacity:
                left = queue.pop(0)
        yield left


def slow_fifo(keys, capacity, *, merge_when_full):
    queue = []
    for key in keys:
        if merge_when_full and len(queue) == capacity and key in queue:
            yield None
            continue
        if len(queue) == capacity:
            first = queue.pop(0)
            queue.append(key)
            yield None if first in queue else first
        else:
            queue.append(key)
            yield None


def slow_lru(keys, capacity):
    last = {}
    for now, key in enumerate(keys):
        last[key] = now
        oldest = min(last, key=last.__getitem__)
        if len(last) > capacity:
            del last[oldest]
            yield oldest
        else:
            yield None


def slow_lfu(keys, capacity):
    count, last = {}, {}
    for now, key in enumerate(keys):
        left = None
        if key not in count and len(count) == capacity:
            left = min(count, key=lambda other: (count[other], last[other]))
            del count[left], last[left]
        count[key] = count.get(key, 0) + 1
        last[key] = now
        yield left


def slow_karma(keys, window, main, period):
    """Segments as a label per key, everything searched anew each time."""
    where, used, count, uses = {}, {}, {}, 0

    def oldest(segment):
        return min((k for k in where if where[k] == segment), key=used.__getitem__)

    def size(segment):
        return list(where.values()).count(segment)

    for now, key in enumerate(keys):
        if period is None or count.get(key, 0) < 15:
            count[key] = count.get(key, 0) + 1
        uses += 1
        if uses == period:
            count = {k: c // 2 for k, c in count.items()}
            uses //= 2
        used[key] = now
        left = None
        if where.get(key) == "elimination" and main * 8 // 10 > 0:
            where[key] = "protected"
            if size("protected") > main * 8 // 10:
                where[oldest("protected")] = "elimination"
        elif key not in where:
            where[key] = "window"
            if len(where) > window + main:
                rivals = [k for k in where if where[k] != "protected"]
                left = min(rivals, key=lambda k: (count[k], used[k]))
                del where[left]
            if size("window") > window:
                where[oldest("window")] = "elimination"
        yield left


@given(keys=KEYS, capacity=SIZES)
def test_queues_answer_as_their_slow_tellings(keys, capacity):
    assert answers(FifoMerge(capacity), keys) == list(slow_fifo_merge(keys, capacity))
    plain = list(slow_fifo(keys, capacity, merge_when_full=False))
    assert answers(Fifo(capacity), keys) == plain
    letter = list(slow_fifo(keys, capacity, merge_when_full=True))
    assert answers(FifoMergeWhenFull(capacity), keys) == letter


@given(keys=KEYS, capacity=SIZES)
def test_lru_and_lfu_answer_as_their_slow_tellings(keys, capacity):
    assert answers(Lru(capacity), keys) == list(slow_lru(keys, capacity))
    assert answers(Lfu(capacity), keys) == list(slow_lfu(keys, capacity))


@given(keys=KEYS, sizes=SEGMENTS, period=st.none() | st.integers(1, 40))
def test_karma_rule_answers_as_its_slow_telling(keys, sizes, period):
    policy = segmented(KarmaWTinyLfu, *sizes, period=period)
    assert answers(policy, keys) == list(slow_karma(keys, *sizes, period))


# ----------------------------------------------------------------- W-TinyLFU


@pytest.mark.parametrize("kind", [CaffeineWTinyLfu, KarmaWTinyLfu])
@given(keys=KEYS, sizes=SEGMENTS, sketch=st.booleans())
def test_segments_add_up_and_keep_their_sizes(kind, keys, sizes, sketch):
    window, main = sizes
    policy = segmented(kind, window, main, sketch=sketch)
    assert (policy.capacity, policy.window_size) == (window + main, window)
    before = 0
    for key in keys:
        *_, before_protected = segments(policy)
        left = policy.touch(key)
        in_window, elimination, protected = segments(policy)
        every = [*in_window, *elimination, *protected]
        assert sorted(every) == sorted(policy) == sorted(set(every))
        assert len(every) == len(policy) <= window + main
        assert len(in_window) <= window
        assert len(protected) <= main * 8 // 10
        assert len(policy) >= before
        assert left is None or left not in before_protected
        before = len(policy)


def test_sizes_default_to_each_sources_own():
    caffeine, karma = CaffeineWTinyLfu(10), KarmaWTinyLfu(10)
    assert (caffeine.window_size, caffeine.protected_size) == (1, 7)
    assert (karma.window_size, karma.protected_size) == (9, 0)
    assert CaffeineWTinyLfu(1).window_size == KarmaWTinyLfu(1).window_size == 1
    with pytest.raises(ValueError, match="window"):
        KarmaWTinyLfu(10, window=11)


def test_caffeine_challenger_must_be_used_strictly_more_often():
    policy = segmented(CaffeineWTinyLfu, 1, 1)
    assert answers(policy, "abc") == [None, None, "b"]  # b challenges a, both used once
    assert answers(policy, "cd") == [None, "a"]  # c, used twice, beats a


# ----------------------------------------------------------------- counts


@given(keys=KEYS, period=st.integers(1, 20))
def test_exact_counts_halve_at_the_period(keys, period):
    counts, expected, uses = ExactCounts(period, cap=None), {}, 0
    for key in keys:
        counts.add(key)
        expected[key] = expected.get(key, 0) + 1
        uses += 1
        if uses == period:
            expected = {other: count // 2 for other, count in expected.items()}
            uses //= 2
        assert all(counts.estimate(other) == count for other, count in expected.items())


@pytest.mark.parametrize("kind", [int, str])
@given(keys=st.binary(max_size=120), capacity=SIZES)
def test_sketch_never_counts_too_little_below_the_cap(kind, keys, capacity):
    sketch, exact = CountMin4(capacity, period=None), {}
    for key in map(kind, keys):
        sketch.add(key)
        exact[key] = exact.get(key, 0) + 1
        assert min(exact[key], CAP) <= sketch.estimate(key) <= CAP


@given(keys=st.binary(max_size=120), capacity=SIZES)
def test_sketch_halves_every_estimate_rounding_down(keys, capacity):
    sketch = CountMin4(capacity)
    for key in keys:
        uses = sketch.uses
        others = {other: sketch.estimate(other) for other in range(0, 256, 5) if other != key}
        sketch.add(key)
        if sketch.uses < uses:  # the use may have raised a shared counter before the halving
            for other, count in others.items():
                assert count // 2 <= sketch.estimate(other) <= (count + 1) // 2


# ----------------------------------------------------------------- names and statistics


def test_policy_text_gives_the_sizes_it_says():
    assert isinstance(make_policy("fifo-merge[10]"), FifoMerge)
    policy = make_policy(" wtinylfu-karma[9,1] W=inf ")
    assert isinstance(policy, KarmaWTinyLfu)
    assert (policy.capacity, policy.window_size, policy.counts.period) == (10, 9, None)
    assert make_policy("wtinylfu-caffeine[10] W=70").counts.period == 70
    assert isinstance(make_policy("wtinylfu-caffeine[10] cm4").counts, CountMin4)


@pytest.mark.parametrize(
    "text, says",
    [
        ("fifo-merge", "name\\[size\\]"),
        ("fifo[x]", "not understood"),
        ("lru[9,1]", "only W-TinyLFU"),
        ("lru[10] W=5", "only W-TinyLFU"),
        ("lru[0]", "at least 1"),
        ("wtinylfu-karma[0,0]", "at least 1"),
        ("wtinylfu-karma[9,1] W=0", "period"),
        ("wtinylfu-karma[9,1] w=5", "unknown option 'w=5'"),
    ],
)
def test_policy_text_that_makes_no_sense_is_refused(text, says):
    with pytest.raises(KarmaError, match=says):
        make_policy(text)


def test_policy_of_unknown_name_suggests_the_nearest():
    with pytest.raises(UnknownNameError, match="wtinylfu-karma"):
        make_policy("wtinylfu-kama[9,1]")


def test_answers_of_no_policy_depend_on_the_hash_seed():
    program = (
        "import sys; from karma.memory.policies import make_policy\n"
        "for text in sys.argv[1:]:\n"
        "    policy = make_policy(text)\n"
        "    print([policy.touch(f'k{i * i % 17}') for i in range(200)], list(policy))\n"
    )
    names = registry.names("policies")
    texts = [f"{name}[5]" for name in names]
    texts += [f"{name}[3,2] cm4" for name in names if name.startswith("wtinylfu")]
    answers = {
        subprocess.run(
            [sys.executable, "-c", program, *texts],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("0", "1")
    }
    assert len(answers) == 1
    assert answers.pop().count("\n") == len(texts)
