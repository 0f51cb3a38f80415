"""Recall returns the nearest units by cosine, in a fixed order, whatever FAISS does with ties."""

from dataclasses import replace
from hashlib import blake2b

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma import registry
from karma.errors import KarmaError, UnknownNameError
from karma.memory.recall import VERBALISERS, CosineRecall, unit_sentence, unit_text
from karma.types.memory import MemoryUnit


class HashingEmbedder:
    """Counts of words, hashed into a few dimensions: near-ties and exact ties are common."""

    name = "hashing"

    def __init__(self, dimension=8, scale=1.0):
        self.dimension = dimension
        self.scale = scale
        self.asked = []

    def embed(self, texts):
        rows = np.zeros((len(texts), self.dimension), dtype=np.float32)
        for row, text in zip(rows, texts, strict=True):
            for word in text.lower().replace('"', " ").split():
                row[blake2b(word.encode(), digest_size=1).digest()[0] % self.dimension] += 1
        self.asked += texts
        return rows * np.float32(self.scale)


def unit(kind, *, states=(), number=1):
    return MemoryUnit(
        object_id=f"{kind}|{number}", object_type=kind, position_m=(1.0, 2.5, -0.1), states=states
    )


KINDS = st.sampled_from(["Apple", "Pear", "DishSponge", "CreditCard", "Mug"])
WORDS = st.lists(st.sampled_from(["clean", "apple", "dish", "mug", "a", "sponge"]), max_size=6)
UNITS = st.lists(
    st.builds(
        unit,
        KINDS,
        states=st.sampled_from([(), ("cleaned",), ("cleaned", "sliced")]),
        number=st.integers(1, 3),
    ),
    max_size=12,
)


def brute_force(embedder, text, query, units):
    """Cosines in float64, without FAISS."""
    rows = embedder.embed([query, *map(text, units)]).astype(np.float64)
    lengths = np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)
    rows = rows / lengths
    return rows[1:] @ rows[0]


@pytest.mark.parametrize("text", sorted(VERBALISERS))
@given(units=UNITS, query=WORDS.map(" ".join), k=st.integers(1, 14))
def test_recall_agrees_with_brute_force(text, units, query, k):
    embedder = HashingEmbedder(scale=3.0)
    found = CosineRecall(embedder, text=text).recall(query, units, k)
    expected = brute_force(embedder, VERBALISERS[text], query, units)
    assert len(found) == min(k, len(units))
    best = np.sort(expected)[::-1][:k]
    np.testing.assert_allclose([one.similarity for one in found], best, atol=1e-6)
    places = {id(one): place for place, one in enumerate(units)}
    for one in found:
        np.testing.assert_allclose(one.similarity, expected[places[id(one.unit)]], atol=1e-6)


@given(units=UNITS, query=WORDS.map(" ".join))
def test_fewer_is_the_head_of_more(units, query):
    recall = CosineRecall(HashingEmbedder(), text="sentence")
    everything = recall.recall(query, units, len(units) + 1)
    for k in range(1, len(units) + 1):
        assert recall.recall(query, units, k) == everything[:k]


@given(query=WORDS.map(" ".join), kinds=st.lists(KINDS, min_size=1, max_size=40))
def test_of_equal_units_the_last_used_comes_first(query, kinds):
    units = [replace(unit(kind), object_id=str(at)) for at, kind in enumerate(kinds)]
    found = CosineRecall(HashingEmbedder(384), text=unit_sentence).recall(query, units, 40)
    keys = [(-one.similarity, -int(one.unit.object_id)) for one in found]
    assert keys == sorted(keys)
    by_kind = {one.unit.object_type: one.similarity for one in found}
    assert all(one.similarity == by_kind[one.unit.object_type] for one in found)


def test_unknown_verbaliser_is_refused():
    with pytest.raises(UnknownNameError, match="sentence"):
        CosineRecall(HashingEmbedder(), text="poem")


def test_unit_is_embedded_once_for_as_long_as_it_is_remembered():
    embedder = HashingEmbedder()
    recall = CosineRecall(embedder)
    apple, pear = unit("Apple"), unit("Pear")
    for units in ([apple, apple], [pear, apple], [pear], [apple]):
        recall.recall("an apple", units, 1)
    question = ["an apple"]
    assert embedder.asked == [
        unit_text(apple), *question, unit_text(pear), *question * 2, unit_text(apple), *question
    ]  # fmt: skip


@pytest.mark.parametrize(
    "kind, states, says",
    [
        ("Apple", (), "an apple"),
        ("Apple", ("none",), "an apple"),
        ("CD", ("dirty",), "a dirty cd"),
        ("TVStand", (), "a tv stand"),
        ("DishSponge", ("cleaned", "used up"), "a cleaned, used up dish sponge"),
    ],
)
def test_unit_sentence_says_states_and_name(kind, states, says):
    assert unit_sentence(unit(kind, states=states)) == says


@pytest.mark.model
def test_minilm_finds_the_named_object():
    try:
        embedder = registry.load("embedders", "minilm")()
        embedder.embed(["hello"])
    except (ImportError, KarmaError) as error:
        pytest.skip(f"the MiniLM embedder cannot be used here: {error}")
    units = [unit("Knife"), unit("Apple", states=("cleaned",)), unit("Laptop"), unit("Pillow")]
    for text in VERBALISERS:
        recall = CosineRecall(embedder, text=text)
        for wanted in units:
            found = recall.recall(f"bring me the {wanted.object_type.lower()}", units, 4)
            assert found[0].unit == wanted
            expected = brute_force(
                embedder, VERBALISERS[text], f"bring me the {wanted.object_type.lower()}", units
            )
            np.testing.assert_allclose(
                [one.similarity for one in found], np.sort(expected)[::-1], atol=1e-4
            )
