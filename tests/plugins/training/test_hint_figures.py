"""Figures of hints, over a file small enough to know every answer; and what texts may say."""

import pytest
from support.hint_figures import DEEDS, WAYS, AskedWord, asked_words, figures

from karma import registry
from karma.language.hints import WordFile, own_texts
from karma.language.lexemes import lexicon
from karma.plugins.training.hinted import KeptRows, words_file

FILE = WordFile(
    types={"Cup": ("glass", "drinking vessel"), "Knife": ("knife",), "Pen": ("pen",), "Bed": ()},
    deeds={"wash": ("wash",), "heat": ("warm up",)},
    phrases=frozenset(), words=frozenset(),
)  # fmt: skip


@pytest.fixture(scope="module")
def minilm():
    return registry.load("embedders", "minilm")()


def asked(group, phrase, right, *left_out):
    return AskedWord(
        group=group, phrase=phrase, right=frozenset((right,)), left_out=frozenset(left_out)
    )


def test_figures_count_the_right_meaning_in_first_and_in_third_place(minilm):
    words = [asked("names", "glass", "Cup"), asked("names", "blade", "Knife"),
             asked("names", "pen", "Bed")]  # fmt: skip
    found = {one.way: one for one in figures(FILE, minilm, words)}
    assert set(found) == set(WAYS)
    assert {(one.number, one.first, one.third) for one in found.values()} == {(3, 2, 2)}


def test_type_whose_texts_are_all_left_out_comes_last(minilm):
    words = [asked("names", "knife", "Knife", "knife")]
    assert all(one.first == 0 for one in figures(FILE, minilm, words))


def test_verbs_are_asked_of_deeds(minilm):
    (one, *_) = figures(FILE, minilm, [asked("verbs", "rinse", "wash")])
    assert (one.group, one.first) == ("verbs", 1)
    assert str(one).startswith("verbs  all texts")


def test_held_out_words_are_asked_with_nothing_left_out_and_known_ones_never_among_them():
    unseen, known = list(asked_words(unseen=True)), list(asked_words(unseen=False))
    assert all(not word.left_out for word in unseen)
    assert all(word.left_out for word in known)
    assert {word.phrase for word in unseen}.isdisjoint(word.phrase for word in known)
    assert {word.group for word in unseen} == {"names", "kinds", "uses", "verbs"}
    assert set(DEEDS.values()) <= set(own_texts().deeds)


def test_every_type_and_deed_that_hints_may_name_has_a_text():
    file = words_file(())
    assert {kind for kind in lexicon() if not file.types.get(kind)} == set()
    assert {name for name, texts in file.deeds.items() if not texts} == set()


def test_kept_rows_are_read_again_and_not_asked_for(minilm, tmp_path):
    first = KeptRows(minilm, tmp_path / "rows.safetensors")
    rows = first.embed(["glass", "knife"])
    first.save()

    class Silent:
        name, dimension = minilm.name, minilm.dimension

        def embed(self, texts):
            raise AssertionError(texts)

    assert (KeptRows(Silent(), tmp_path / "rows.safetensors").embed(["knife"]) == rows[1]).all()


def test_kept_rows_of_another_embedder_are_not_used(minilm, tmp_path):
    first = KeptRows(minilm, tmp_path / "rows.safetensors")
    first.embed(["glass"])
    first.save()

    class Other:
        name, dimension = "another", minilm.dimension

    assert KeptRows(Other(), tmp_path / "rows.safetensors").rows == {}
