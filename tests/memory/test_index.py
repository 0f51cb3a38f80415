"""The kept index gives what a search through all units gives, to the byte, whatever came before."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from karma.memory.recall import UnitIndex
from karma.seeds import stream
from karma.types.memory import MemoryUnit

DIMENSION = 16
KINDS = [f"Kind{number}" for number in range(40)]
PLACES = ["Shelf", "Desk", None]


def unit(number, kind, place=None, *, handled=False):
    return MemoryUnit(
        object_id=f"{kind}|{number}",
        object_type=kind,
        position_m=(0.0, 0.0, 0.0),
        place_id=place,
        handled=handled,
    )


def rows_of(kind):
    """Return one to four vectors of a kind; coarse numbers, so that ties are common."""
    rng = stream(0, "rows", kind)
    rows = rng.integers(-1, 2, size=(int(rng.integers(1, 5)), DIMENSION)).astype(np.float32)
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), np.float32(1))


def index(nearest=1):
    return UnitIndex(
        rows_of,
        lambda one: one.object_type,
        lambda one: one.place_id,
        lambda one: one.handled,
        nearest=nearest,
    )


def brute_force(units, asked, k, worth, nearest=1):
    """Score unit by unit, each row by itself, and sort."""
    scores = []
    for one in units:
        similarity = 0.0
        if asked is not None:
            rows = sorted(float(np.dot(row, asked[0])) for row in rows_of(one.object_type))
            similarity = sum(rows[-nearest:]) / len(rows[-nearest:])
        values = (one.object_type, one.place_id, one.handled)
        scores.append(similarity + sum(adds(v) for adds, v in zip(worth, values, strict=True)))
    order = sorted(range(len(units)), key=lambda at: (-np.float32(scores[at]), -at))
    return [units[at] for at in order[:k]], [scores[at] for at in order[:k]]


UNITS = st.lists(
    st.builds(
        unit,
        st.integers(0, 3),
        st.sampled_from(KINDS),
        st.sampled_from(PLACES),
        handled=st.booleans(),
    ),
    max_size=30,
)
BONUSES = st.tuples(*(st.sampled_from([0.0, 0.25, 0.5]) for _ in range(3)))


def worth_of(bonuses):
    name, place, handled = bonuses
    return (
        lambda kind: name * (kind in KINDS[:5]),
        lambda where: place * (where == "Desk"),
        lambda was: handled * was,
    )


@settings(max_examples=60)
@given(
    memories=st.lists(UNITS, min_size=1, max_size=4),
    seed=st.integers(0, 9),
    k=st.integers(1, 12),
    bonuses=BONUSES,
    nearest=st.integers(1, 3),
)
def test_kept_index_answers_like_a_new_one_and_like_brute_force(
    memories, seed, k, bonuses, nearest
):
    asked = rows_of(f"question {seed}")[:1]
    kept = index(nearest)
    for units in memories:
        kept.follow(units)
        found = kept.recalled(kept.best(asked, k, *worth_of(bonuses)))
        fresh = index(nearest)
        fresh.follow(units)
        assert found == fresh.recalled(fresh.best(asked, k, *worth_of(bonuses)))
        _, scores = brute_force(units, asked, k, worth_of(bonuses), nearest)
        np.testing.assert_allclose([one.similarity for one in found], scores, atol=1e-6)


@given(units=UNITS, k=st.integers(1, 12), bonuses=BONUSES)
def test_without_a_question_bonuses_alone_decide_and_of_equals_the_last_come_first(
    units, k, bonuses
):
    kept = index()
    kept.follow(units)
    found = kept.recalled(kept.best(None, k, *worth_of(bonuses)))
    wanted, scores = brute_force(units, None, k, worth_of(bonuses))
    assert [one.unit for one in found] == wanted
    assert [one.similarity for one in found] == scores


@pytest.mark.parametrize("k", [1, 3, 100])
@pytest.mark.parametrize(("bonus", "nearest"), [(0.0, 1), (0.3, 1), (0.3, 2)])
def test_few_of_many_are_the_head_of_all(k, bonus, nearest):
    """Some thousand distinct values: FAISS is asked for few of them, and the bound must hold."""
    rng = stream(0, "many")
    units = [unit(n, f"Thing{n}", PLACES[n % 3], handled=bool(rng.random() < 0.1))
             for n in range(3000)]  # fmt: skip
    kept = index(nearest)
    kept.follow(units)
    asked = rows_of("question")[:1]
    worth = (None, None, lambda was: bonus * was)
    everything = kept.recalled(kept.best(asked, len(units), *worth))
    assert kept.recalled(kept.best(asked, k, *worth)) == everything[:k]
    none = worth_of((0.0, 0.0, 0.0))[0]
    wanted, _ = brute_force(units, asked, k, (none, none, worth[2]), nearest)
    scores = {one.unit.object_id: one.similarity for one in everything}
    assert [scores[one.object_id] for one in wanted] == pytest.approx(
        [one.similarity for one in everything[:k]], abs=1e-6
    )


def test_index_holds_the_rows_of_what_is_remembered_and_no_others():
    kept = index()
    first = [unit(n, kind) for n, kind in enumerate(KINDS)]
    for units in (first, first[:3], [], [*first[2:5], replace(first[0], handled=True)], first):
        kept.follow(units)
        kinds = {one.object_type for one in units}
        assert len(kept) == sum(len(rows_of(kind)) for kind in kinds)
