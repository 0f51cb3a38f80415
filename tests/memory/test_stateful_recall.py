"""Recall that reads states, places, names and pronouns; contract tests of every recall."""

from dataclasses import replace

import pytest

from karma import registry
from karma.contracts import MemoryUnit


@pytest.fixture(scope="module")
def minilm():
    return registry.load("embedders", "minilm")()


class WordsAndPictures:
    """An embedder of both, of which only the words are asked for: these units have no picture."""

    def __init__(self, words):
        self.name, self.dimension, self.embed = words.name, words.dimension, words.embed

    def embed_images(self, frames):
        raise AssertionError("no unit has a picture")


def made(name, minilm):
    embedder = WordsAndPictures(minilm) if name == "multimodal" else minilm
    return registry.load("recalls", name)(embedder)


def unit(kind, *states, place="CounterTop|1", handled=False):
    return MemoryUnit(
        object_id=f"{kind}|1", object_type=kind, position_m=(0.0, 0.9, 0.0), states=states,
        place_id=place, handled=handled,
    )  # fmt: skip


UNITS = (
    unit("Fork", "cleaned", handled=True),
    unit("Spoon"),
    unit("Tomato", "sliced", handled=True),
    unit("Lettuce", place="Cabinet|2", handled=True),
    unit("Mug", "filled", place="CoffeeMachine|1"),
)


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("hand me the washed cutlery", "Fork"),
        ("bring the spoon", "Spoon"),
        ("throw the cut vegetable away", "Tomato"),
        ("give me what is in the cabinet", "Lettuce"),
        ("drop it on the floor", "Lettuce"),
        ("serve the full cup", "Mug"),
    ],
)
def test_first_unit_is_the_one_that_words_and_history_mean(minilm, query, wanted):
    recall = registry.load("recalls", "stateful")(minilm)
    assert recall.recall(query, UNITS, 1)[0].unit.object_type == wanted


def test_leading_verb_is_not_a_state(minilm):
    recall = registry.load("recalls", "stateful")(minilm)
    units = (unit("Fork", "cleaned"), unit("Spoon"))
    with_verb = recall.recall("clean the spoon", units, 2)
    assert [item.unit.object_type for item in with_verb] == ["Spoon", "Fork"]


@pytest.mark.parametrize("name", registry.names("recalls"))
def test_recall_keeps_its_contract(minilm, name):
    recall = made(name, minilm)
    for k in (1, 3, 9):
        found = recall.recall("the clean fork", UNITS, k)
        assert len(found) == min(k, len(UNITS))
        assert [i.similarity for i in found] == sorted((i.similarity for i in found), reverse=True)
        assert found == recall.recall("the clean fork", UNITS, k)
    assert recall.recall("anything", (), 3) == []
    with pytest.raises(ValueError, match="at least 1"):
        recall.recall("anything", UNITS, 0)


@pytest.mark.parametrize("name", registry.names("recalls"))
def test_equal_units_keep_their_order(minilm, name):
    recall = made(name, minilm)
    twins = [replace(unit("Mug"), object_id=f"Mug|{n}") for n in (2, 1)]
    if name == "cosine":
        recall = registry.load("recalls", name)(minilm, text="sentence")
    found = recall.recall("the mug", twins, 2)
    assert [item.unit.object_id for item in found] == ["Mug|2", "Mug|1"]
