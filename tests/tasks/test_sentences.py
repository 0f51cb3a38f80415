"""Sentences of several requests are cut into them: sentences of development, and what holds of any.

The 200 sentences that figures are given for are in `eval/requests/`; those here are others.
"""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.paths import ROOT

from karma.language.words import base_of
from karma.tasks.loose_names import singular, words_of
from karma.tasks.requests import load_said, load_several, split_right
from karma.tasks.sentence_words import table
from karma.tasks.sentences import split_instruction

FOLDER = ROOT / "tests" / "golden" / "requests"
SEVERAL = load_several(FOLDER / "several.jsonl")
SINGLE = load_said(FOLDER / "single.jsonl")


@pytest.mark.parametrize("said", SEVERAL, ids=lambda one: one.id)
def test_sentence_of_several_requests_is_cut_into_them(said):
    clauses = split_instruction(said.text)
    assert split_right(clauses, said.requests), clauses


@pytest.mark.parametrize("said", SINGLE, ids=lambda one: one.id)
def test_sentence_of_one_request_stays_whole(said):
    assert len(split_instruction(said.text)) == 1


def test_development_sentences_are_many_and_none_of_those_that_are_measured():
    measured = {one.text for one in load_several(ROOT / "eval" / "requests" / "several.jsonl")}
    texts = [one.text for one in SEVERAL]
    assert len(set(texts)) == len(texts) >= 150
    assert not measured & set(texts)


@pytest.mark.parametrize(
    ("text", "clauses"),
    [
        ("water the plant and then turn on the lamp", ["water the plant", "turn on the lamp"]),
        ("Wash the cup and the mug and then put them on the desk.",
         ["Wash the cup", "Wash the mug", "put the cup on the desk", "put the mug on the desk"]),
        ("Close the fridge after you've put the tomato in it.",
         ["put the tomato in the fridge", "Close the fridge"]),
        ("Bring me the mug. I also want it washed beforehand.",
         ["I also want the mug washed", "Bring me the mug"]),
        ("Put the salt and pepper shakers on the table",
         ["Put the salt shaker on the table", "Put the pepper shaker on the table"]),
        ("I'm cold. Close the window.", ["I'm cold, Close the window"]),
        ("Hello there!", ["Hello there!"]),
        ("", [""]),
    ],
)  # fmt: skip
def test_split_instruction_gives_each_request_its_own_words(text, clauses):
    assert list(split_instruction(text)) == clauses


# ----------------------------------------------------------------- properties

THINGS = st.sampled_from(["the mug", "a fork", "the red book", "the salt shaker", "my pillow"])
PLACES = st.sampled_from(["on the table", "in the sink", "into the drawer", "on the shelf"])
DEEDS = st.one_of(
    st.builds("put {} {}".format, THINGS, PLACES),
    st.builds("wash {}".format, THINGS),
    st.builds("bring me {}".format, THINGS),
    st.sampled_from(["turn on the lamp", "close the fridge", "slice the bread"]),
)


SAID = (
    "put wash take go before after then and the a mug mugs salt pepper shakers in on to it them "
    "there you have washed if would mind is are off once that do same with first both one"
)
WORDS = [*words_of(SAID), ",", ":", ".", ";"]


@settings(max_examples=60, deadline=None)
@given(st.lists(DEEDS, min_size=1, max_size=4, unique=True), st.data())
def test_deeds_that_are_joined_come_apart_again(deeds, data):
    joints = [" and then ", "; ", ", ", ". ", ", and ", " and ", ", then "]
    text = deeds[0]
    for deed in deeds[1:]:
        text += data.draw(st.sampled_from(joints)) + deed
    assert list(split_instruction(text)) == deeds


@settings(max_examples=30, deadline=None)
@given(st.lists(THINGS, min_size=2, max_size=4, unique=True), PLACES)
def test_things_of_one_deed_get_a_request_each(things, place):
    listed = ", ".join(things[:-1]) + " and " + things[-1]
    assert list(split_instruction(f"Put {listed} {place}.")) == [
        f"Put {thing} {place}" for thing in things
    ]


@settings(max_examples=60, deadline=None)
@given(
    st.one_of(
        st.text(max_size=80),
        st.lists(st.sampled_from(WORDS), max_size=14).map(" ".join),
    )
)
def test_any_text_gives_clauses_of_its_own_words(text):
    said = set(words_of(text))
    known = {form for word in said for form in (word, base_of(word) or word, singular(word))}
    known |= {"and", "then", "make", "sure", *table().verbs.third.values()}
    for clause in split_instruction(text):
        assert set(words_of(clause)) <= known


@settings(max_examples=60, deadline=None)
@given(st.lists(DEEDS, min_size=1, max_size=3, unique=True))
def test_cutting_again_changes_nothing(deeds):
    for clause in split_instruction(" and then ".join(deeds)):
        assert split_instruction(clause) == (clause,)
