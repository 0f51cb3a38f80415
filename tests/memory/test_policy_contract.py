"""What every registered replacement policy keeps to; to register is to be tested."""

from functools import cache, partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma import registry
from karma.bench.policies.simulate import Trace, best, simulate_with

KEYS = st.text("abcdefg", max_size=50)
POLICIES = registry.names("policies")
ONE_LINE_EACH = [name for name in POLICIES if name not in ("fifo", "fifo-merge-full")]

pytestmark = pytest.mark.parametrize("name", POLICIES)


kind_of = cache(partial(registry.load, "policies"))


def made(name, capacity):
    return kind_of(name)(capacity)


def single(keys):
    return Trace.of((key,) for key in keys)


def hits(policy, keys):
    return simulate_with(policy, single(keys)).hits


def repeats(keys):
    return len(keys) - len(set(keys))


@given(keys=KEYS, capacity=st.integers(1, 6))
def test_touch_any_sequence_keeps_the_books(name, keys, capacity):
    policy, resident = made(name, capacity), set()
    for key in keys:
        left = policy.touch(key)
        resident.add(key)
        if left is not None:
            assert left in resident
            resident.discard(left)
        assert set(policy) == resident
        assert all(other in policy for other in resident)
        assert left is None or left not in policy
        assert len(list(policy)) == len(resident) <= len(policy) <= policy.capacity


@given(keys=KEYS, capacity=st.integers(1, 6))
def test_asking_and_listing_change_nothing(name, keys, capacity):
    quiet, asked = made(name, capacity), made(name, capacity)
    for key in keys:
        for other in "abcdefgz":
            assert (other in asked) == (other in list(asked))
        assert quiet.touch(key) == asked.touch(key)
        assert list(quiet) == list(asked)


@given(keys=KEYS, capacity=st.integers(1, 6))
def test_no_policy_beats_the_clairvoyant_one(name, keys, capacity):
    bound = repeats(keys) if name == "unbounded" else best(single(keys), capacity).hits
    assert hits(made(name, capacity), keys) <= bound


@given(keys=KEYS, capacity=st.integers(1, 6), names=st.permutations("tuvwxyz"))
def test_renaming_keys_renames_the_answers(name, keys, capacity, names):
    new = dict(zip("abcdefg", names, strict=True)) | {None: None}
    first, second = made(name, capacity), made(name, capacity)
    for key in keys:
        assert new[first.touch(key)] == second.touch(new[key])
    assert [new[key] for key in first] == list(second)


@given(keys=KEYS, more=KEYS, gone=st.sampled_from("abcdefg"), capacity=st.integers(1, 6))
def test_discard_frees_lines_and_leaves_the_rest(name, keys, more, gone, capacity):
    policy = made(name, capacity)
    for key in keys:
        policy.touch(key)
    others = [key for key in policy if key != gone]
    policy.discard(gone)
    assert list(policy) == others
    assert len(policy) <= policy.capacity
    resident = set(others)
    for key in more:
        left = policy.touch(key)
        resident = (resident | {key}) - {left}
        assert set(policy) == resident


@pytest.mark.parametrize("capacity", [0, -1])
def test_no_room_is_refused(name, capacity):
    with pytest.raises(ValueError, match="capacity"):
        made(name, capacity)


def test_keys_spread_evenly_hit_in_proportion_to_room(name):
    if name in ("unbounded", "fifo", "fifo-merge-full"):
        pytest.skip("holds another number of different keys than its capacity")
    import numpy as np

    from karma.seeds import stream

    requests, capacity, kinds = 20_000, 10, 50
    trace = stream(7, "spread").integers(kinds, size=requests).tolist()
    found = hits(made(name, capacity), trace)
    share = capacity / kinds
    z = (found - requests * share) / np.sqrt(requests * share * (1 - share))
    assert abs(z) < 4
