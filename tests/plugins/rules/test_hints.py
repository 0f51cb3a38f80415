"""Hints: which phrases get one, what they come near to, and the files that keep the vectors."""

import numpy as np
import pytest

from karma import registry
from karma.household.types import object_types
from karma.plugins.rules.wording.hints import (
    Hinter,
    WordFile,
    load_words,
    own_texts,
    write_words,
)

FILE = WordFile(
    types={
        "Cup": ("glass", "something to drink water out of"),
        "Knife": ("knife", "sharp blade to cut food with"),
        "Pen": ("pen", "tool to write with"),
    },
    deeds={"heat": ("heat up", "warm in the microwave"), "wash": ("wash with water",)},
    phrases=frozenset(("glass", "knife", "pen", "heat up", "wash", "put", "fridge")),
    words=frozenset(("red", "fridge", "glass", "knife")),
)


@pytest.fixture(scope="module")
def minilm():
    return registry.load("embedders", "minilm")()


@pytest.fixture(scope="module")
def hinter(minilm, tmp_path_factory):
    return Hinter(
        write_words(tmp_path_factory.mktemp("words") / "words.json", FILE, minilm), minilm
    )


def told(hinter, text):
    return {hint.phrase: hint.meanings[0].name for hint in hinter.hints(text)}


def test_unknown_noun_comes_nearest_to_the_type_that_it_means(hinter):
    assert told(hinter, "put the clean tumbler in the fridge") == {"tumbler": "Cup"}
    assert told(hinter, "put something to take notes with in the fridge") == {
        "something to take notes with": "Pen"
    }


@pytest.mark.parametrize(
    "text", ["put the red knife in the fridge", "put the glasses in the fridge", "put it there", ""]
)
def test_phrases_that_the_planner_knows_get_no_hint(hinter, text):
    assert hinter.hints(text) == ()


def test_objects_of_an_instruction_are_bare_and_in_the_singular(hinter):
    found = hinter.objects("Put the clean red apples beside the cleaning tool in the fridge")
    assert [*found] == ["red apple", "cleaning tool", "fridge"]
    assert {"DishSponge", "ScrubBrush"} <= found["cleaning tool"]


def test_texts_with_a_word_that_is_left_out_are_as_if_never_written(hinter, minilm):
    (vector,) = minilm.embed(["glass"])
    full = hinter.words.nearest(vector, is_deed=False)
    less = hinter.words.nearest(vector, is_deed=False, without=("glass", "unheard"))
    assert full[0].name == "Cup"
    assert full[0].similarity == pytest.approx(1.0, abs=1e-3)
    assert {meaning.name: meaning.similarity for meaning in less}["Cup"] < 0.7


@pytest.mark.parametrize(
    ("phrase", "is_known"),
    [("knife", True), ("red knives", True), ("wobbly knife", False), ("fridge red", False)],
)
def test_phrase_is_known_as_it_stands_or_behind_known_words(phrase, is_known):
    assert FILE.knows(phrase) is is_known


class Counting:
    """MiniLM, with a count of what it was asked."""

    name, dimension = "minilm", 384

    def __init__(self, inner, name="minilm"):
        self.inner, self.asked, self.name = inner, 0, name

    def embed(self, texts):
        self.asked += len(texts)
        return self.inner.embed(texts)


def test_vectors_beside_the_file_are_read_and_not_made_again(minilm, tmp_path):
    made = write_words(tmp_path / "words.json", FILE, minilm)
    embedder = Counting(minilm)
    read = load_words(tmp_path / "words.json", embedder)
    assert embedder.asked == 0
    assert read.file == FILE
    np.testing.assert_array_equal(read.vectors, made.vectors)


@pytest.mark.parametrize("harm", ["missing", "torn", "other texts", "other embedder"])
def test_vectors_that_do_not_fit_are_made_anew_with_the_same_result(minilm, tmp_path, harm):
    path, kept = tmp_path / "words.json", tmp_path / "words.safetensors"
    made = write_words(path, FILE, minilm)
    if harm == "missing":
        kept.unlink()
    elif harm == "torn":
        kept.write_bytes(kept.read_bytes()[:100])
    elif harm == "other texts":
        write_words(
            tmp_path / "others.json",
            WordFile(types={"Cup": ("beaker",)}, deeds={}, phrases=frozenset(), words=frozenset()),
            minilm,
        )
        kept.write_bytes((tmp_path / "others.safetensors").read_bytes())
    embedder = Counting(minilm, name="another" if harm == "other embedder" else "minilm")
    read = load_words(path, embedder)
    assert embedder.asked == len(read.texts)
    np.testing.assert_array_equal(read.vectors, made.vectors)


def test_every_type_with_texts_of_ours_is_a_type_of_the_table():
    assert set(own_texts().types) <= set(object_types())
