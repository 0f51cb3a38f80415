"""What a question asks for: kinds, states, places, history and pronouns told apart."""

import pytest

from karma.plugins.rules.stateful import Wanted, question_of


def first(text):
    return question_of(text).things[0]


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("bring me the mug", Wanted(text="mug")),
        ("hand me the washed cutlery", Wanted(text="cutlery", has=frozenset({"cleaned"}))),
        ("get the clean, red food", Wanted(text="red food", has=frozenset({"cleaned"}))),
        ("find the cut up onion", Wanted(text="onion", has=frozenset({"sliced"}))),
        ("the uncut tomato", Wanted(text="tomato", lacks=frozenset({"sliced"}))),
        (
            "take the item that is not clean yet",
            Wanted(text="", has=frozenset({"dirty"}), lacks=frozenset({"cleaned"})),
        ),
        ("the jug with water in it", Wanted(text="jug", has=frozenset({"filled"}))),
        ("the mug on the desk", Wanted(text="mug", places=("desk",))),
        ("bring the mug that is on the desk", Wanted(text="mug", places=("desk",))),
        ("give me the knife you just used", Wanted(text="knife", handled=True)),
        ("bring the tool with a long handle", Wanted(text="tool with a long handle")),
        ("get the thing made of paper", Wanted(text="thing made of paper")),
        ("bring me something to write with", Wanted(text="something to write with")),
        ("hand me the sliced one", Wanted(text="", has=frozenset({"sliced"}))),
        ("umbrella", Wanted(text="umbrella")),
    ],
)
def test_thing_that_is_asked_for_is_told_from_its_state_place_and_history(text, wanted):
    assert first(text) == wanted


def test_destination_is_no_place_of_what_goes_there_and_comes_after_it():
    apple, bowl = question_of("put the apple from the fridge in the bowl").things
    assert (apple.places, apple.is_destination) == (("fridge",), False)
    assert (bowl.text, bowl.is_destination) == ("bowl", True)


@pytest.mark.parametrize(
    ("text", "referents"),
    [
        ("put it in the fridge", 1),
        ("now slice them", 2),
        ("find the fork and hand it over", 0),
        ("bring the fork", 0),
    ],
)
def test_pronoun_means_what_was_handled_unless_the_text_names_it_first(text, referents):
    assert question_of(text).referents == referents


@pytest.mark.parametrize("text", ["", "...", "whatever"])
def test_text_without_a_name_asks_for_anything(text):
    question = question_of(text)
    assert [one.text for one in question.things] in ([""], [text])
    assert question.referents == 0
