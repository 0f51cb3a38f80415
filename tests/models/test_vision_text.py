"""The question is the paper's; the answer is read strictly and nothing is guessed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.sights import seen

from karma.models.picture_questions import STATES, again, names_of, question, read_answer


def thing(kind, number=1, left=0.0):
    return seen(f"{kind}|{number}", region=(left, 10.0, left + 20, 30.0))


MUG, APPLE = thing("Mug"), thing("AppleSliced")


def test_the_question_has_the_four_steps_the_task_and_the_objects():
    role, text = question("full", "wash the mug", [MUG, APPLE])
    assert "image analysis expert" in role
    assert [line[:2] for line in text.splitlines()[:4]] == ["1.", "2.", "3.", "4."]
    assert '"wash the mug"' in text
    assert "Mug, Apple." in text
    assert "Sliced" not in text.replace("sliced", "")
    assert ", ".join(STATES) in text


def test_several_of_a_type_are_numbered_from_left_to_right():
    names = names_of([thing("Mug", 1, left=200), thing("Mug", 2, left=5), APPLE])
    assert names == {"Mug|2": "Mug 1", "Mug|1": "Mug 2", "AppleSliced|1": "Apple"}


@pytest.mark.parametrize(
    ("text", "states"),
    [
        ("Mug: dirty", ("dirty",)),
        ("1. A mug.\n2. Brown.\n3. It is dirty.\n4.\nMug: dirty, filled", ("dirty", "filled")),
        ("mug :  Dirty , FILLED.", ("dirty", "filled")),
        ("- **Mug**: used up", ("used up",)),
        ("Mug: none", ()),
        ("Mug: dirty\nMug: cleaned", ("cleaned",)),
        ("Mug : off , closed", ("closed", "off")),
    ],
)  # fmt: skip
def test_lines_are_read(text, states):
    reading = read_answer(text, [MUG])
    assert reading.states == {"Mug|1": states}
    assert (reading.unread, reading.faults) == ((), ())


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", None),
        ("the mug is dirty", None),
        ("Cup: dirty", None),
        ("Mug: quite dirty", "quite dirty"),
        ("Mug: dirty, none", "none and something"),
        ("Mug: dirty\nMug: broken", "broken"),
        ("Mug:", "''"),
    ],
)
def test_nothing_is_guessed(text, fault):
    reading = read_answer(text, [MUG])
    assert reading.states == {}
    assert reading.unread == ("Mug|1",)
    assert bool(reading.faults) == (fault is not None)
    if fault:
        assert fault in reading.faults[0]
        assert reading.faults[0].startswith("line ")


@given(st.text())
def test_any_text_is_read_or_left(text):
    reading = read_answer(text, [MUG, APPLE])
    assert set(reading.states) | set(reading.unread) == {"Mug|1", "AppleSliced|1"}
    assert all(set(words) <= set(STATES) - {"none"} for words in reading.states.values())


def test_asking_again_keeps_the_numbers_of_the_question():
    mugs = [thing("Mug", 1, left=5), thing("Mug", 2, left=200)]
    reading = read_answer("Mug 1: dirty", mugs)
    assert "about: Mug 2." in again(reading, mugs)
