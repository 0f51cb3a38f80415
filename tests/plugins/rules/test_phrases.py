"""Noun phrases, pronouns and verbs of sentences that were written for this test."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from karma.plugins.rules.wording.phrases import phrases_of
from karma.plugins.rules.wording.words import word_lists

NOUNS = {
    "put something to write with on the old desk": ["something to write with", "old desk"],
    "bring me a thing you can drink from": ["thing you can drink from"],
    "put the clean red fruit in the fridge": ["clean red fruit", "fridge"],
    "find me something to dry my hands with": ["something to dry my hands with"],
    "put the thing for cutting bread next to the toaster": ["thing for cutting bread", "toaster"],
    "fetch the thing you use to open bottles": ["thing you use to open bottles"],
    "i need something that tells the time": ["something that tells the time"],
    "place the bottle of wine and the glass on the dining table": [
        "bottle of wine", "glass", "dining table"],
    "put a slice of bread on a plate": ["slice of bread", "plate"],
    "place one of the keys in the drawer": ["keys", "drawer"],
    "salt and pepper on the table": ["salt", "pepper", "table"],
    "chill the can of soda in the fridge": ["can of soda", "fridge"],
    "throw away the newspaper that is on the sofa": ["newspaper"],
    "wash and dry the two forks, then put them away": ["forks"],
    "nuke the leftovers": ["leftovers"],
    "would you mind putting the book back where it belongs": ["book"],
    "i'm cold, switch on the heater": ["heater"],
    "on the desk put a pen": ["desk", "pen"],
    "is there anything to read": ["anything to read"],
    "put it there": [],
    "": [],
}  # fmt: skip

VERBS = {
    "turn the lamp on": ["turn on"],
    "turn on the floor lamp, please": ["turn on"],
    "could you pick up the knife and slice the bread with it?": ["pick up", "slice"],
    "give the mug a quick wash": ["wash"],
    "nuke the leftovers": ["nuke"],
    "zap pizza": ["zap"],
    "get rid of the tissues": ["get rid of"],
    "i want the apple sliced": ["want", "slice"],
    "the mug needs washing": ["need", "wash"],
    "make sure that the tv is off": [],
    "wash and dry the two forks, then put them away": ["wash", "dry", "put away"],
}

ROLES = {
    "put the mug in the sink": {"mug": "thing", "sink": "destination"},
    "wash the mug on the desk": {"mug": "thing", "desk": "modifier"},
    "wash the mug in the sink": {"mug": "thing", "sink": "destination"},
    "take the whisk out of the rack": {"whisk": "thing", "rack": "modifier"},
    "put the mug on the desk in the drawer": {
        "mug": "thing", "desk": "modifier", "drawer": "destination"},
    "turn off the light next to the bed": {"light": "thing", "bed": "modifier"},
    "the dirty plate should go in the sink": {"dirty plate": "thing", "sink": "destination"},
    "there is an apple on the table, slice it": {"apple": "thing", "table": "modifier"},
    "make sure the mug is on the shelf": {"mug": "thing", "shelf": "destination"},
}  # fmt: skip


@pytest.mark.parametrize("text", NOUNS)
def test_noun_phrases_of_a_sentence_are_found_without_their_determiners(text):
    assert [noun.text for noun in phrases_of(text).nouns] == NOUNS[text]


@pytest.mark.parametrize("text", VERBS)
def test_verbs_of_a_sentence_come_in_their_base_form_with_their_particle(text):
    assert [verb.text for verb in phrases_of(text).verbs] == VERBS[text]


@pytest.mark.parametrize("text", ROLES)
def test_places_are_told_apart_by_the_verb_that_governs_them(text):
    assert {noun.text: noun.role for noun in phrases_of(text).nouns} == ROLES[text]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("put the mug you just washed on the shelf", "you just washed"),
        ("put the mug that is on the table in the cabinet", "that is on the table"),
        ("get the mug from the fridge", "from the fridge"),
        ("put the mug with the handle on the shelf", "with the handle"),
    ],
)
def test_what_says_which_one_is_meant_is_a_modifier_and_no_part_of_the_phrase(text, said):
    mug = phrases_of(text).nouns[0]
    assert (mug.text, mug.modifiers) == ("mug", (said,))


@pytest.mark.parametrize(
    ("text", "head"),
    [
        ("slice the loaf of rye bread", "bread"),
        ("open the bottle of wine", "bottle"),
        ("get the big old kitchen knife", "knife"),
        ("get something to read", "something"),
    ],
)
def test_head_of_a_phrase_is_the_word_that_says_what_it_is(text, head):
    assert phrases_of(text).nouns[0].head == head


SOME_WORDS = sorted({"mug", "nuke", "red", "that", "you", "to", ",", "the", "with", "of"}
                    | word_lists().destinations | word_lists().particles
                    | {"put", "washed", "washing", "is", "something"})  # fmt: skip


@given(st.one_of(st.text(), st.lists(st.sampled_from(SOME_WORDS), max_size=12).map(" ".join)))
def test_phrases_of_any_text_lie_within_it_in_order_and_apart(text):
    found = phrases_of(text)
    ends = [0]
    for noun in found.nouns:
        assert ends[-1] <= noun.start < noun.end <= len(text)
        assert noun.text.split()[-1][-1] == text[noun.end - 1].lower()[-1]
        assert noun.head in noun.text.split()
        ends.append(noun.end)
    for one in (*found.pronouns, *found.verbs):
        assert 0 <= one.start < one.end <= len(text)
