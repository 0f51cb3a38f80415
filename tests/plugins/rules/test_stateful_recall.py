"""Recall that reads states, places, names and pronouns; contract tests of every recall."""

from dataclasses import replace

import pytest

from karma import registry
from karma.types.memory import MemoryUnit


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


def types_found(minilm, query, units, k=1):
    found = registry.load("recalls", "stateful")(minilm).recall(query, units, k)
    return [item.unit.object_type for item in found]


def test_names_are_matched_by_all_their_words(minilm):
    units = (unit("SoapBottle"), unit("Bottle"), unit("Knife"), unit("ButterKnife"))
    for query, wanted in (
        ("get the bottle", "Bottle"),
        ("get the soap bottle", "SoapBottle"),
        ("get the butter knife", "ButterKnife"),
        ("get the knife", "Knife"),
        ("get two butter knives", "ButterKnife"),
        ("get the SoapBottle", "SoapBottle"),
    ):
        assert types_found(minilm, query, units) == [wanted]


def test_handling_decides_between_equals_and_never_against_the_name(minilm):
    seen, used = unit("Mug"), replace(unit("Mug", handled=True), object_id="Mug|2")
    fork = unit("Fork", handled=True)
    recall = registry.load("recalls", "stateful")(minilm)
    assert recall.recall("the mug", (seen, used, fork), 1)[0].unit is used
    assert recall.recall("the mug", (seen, fork), 1)[0].unit is seen


@pytest.mark.parametrize("query", ["the mug", "put the fork and the spoon in the sink", "use it"])
def test_kept_recall_answers_like_a_new_one_as_memory_changes(minilm, query):
    kind = registry.load("recalls", "stateful")
    kept = kind(minilm)
    for units in (UNITS, UNITS[1:], UNITS[::-1], (*UNITS[:2], unit("Plate"), *UNITS[3:])):
        everything = kind(minilm).recall(query, units, len(units))
        for k in (1, 2, len(units)):
            assert kept.recall(query, units, k) == everything[:k]


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
def test_of_equal_units_the_last_used_comes_first(minilm, name):
    recall = made(name, minilm)
    twins = [replace(unit("Mug"), object_id=f"Mug|{n}") for n in (2, 1)]
    if name == "cosine":
        recall = registry.load("recalls", name)(minilm, text="sentence")
    found = recall.recall("the mug", twins, 2)
    assert [item.unit.object_id for item in found] == ["Mug|1", "Mug|2"]
