"""Questions to recall: memories can answer them, and held-out words are in none of the texts."""

from collections import Counter
from pathlib import Path

import pytest
from support.recall_questions import (
    CONTROLS,
    InOrder,
    ask,
    is_right,
    marked,
    memory_of,
    read_questions,
)

from karma.files import read_json
from karma.household.pieces import base_type
from karma.plugins.rules.language.lexemes import held_out, lexicon, unseen_lexemes
from karma.plugins.rules.wording.hints import TYPE_WORDS, WordFile

OURS = Path(__file__).parents[3] / "eval" / "recall" / "questions.jsonl"


@pytest.fixture(scope="module")
def questions():
    return read_questions(OURS)


def test_shipped_questions_are_of_every_class_in_words_that_training_lacks(questions):
    kinds = Counter(question.kinds[0] for question in questions)
    assert min(kinds[kind] for kind in ("composite", "complex", "vague")) >= 150
    known = {word for entry in lexicon().values() for word in entry.words}
    for question in questions:
        word = question.group.removeprefix("something to ")
        assert word in held_out().things
        assert word not in known


@pytest.mark.parametrize("size", [4, 10, 40])
def test_memory_has_what_is_meant_once_and_nothing_else_that_fits(questions, size):
    for question in questions[::25]:
        units = memory_of(question, size, 0)
        assert units == memory_of(question, size, 0)
        assert units != memory_of(question, size, 1) or size <= len(question.told)
        assert len(units) == max(size, len(question.told))
        assert len({unit.object_id for unit in units}) == len(units)
        assert [unit for unit in units if unit in question.told] == list(question.told)
        drawn = [unit for unit in units if unit not in question.told]
        assert not question.barred_types & {base_type(unit.object_type) for unit in drawn}


def test_marks_tell_what_was_handled_or_not_or_mislead(questions):
    question = questions[0]
    units = memory_of(question, 10, 0)
    handled = {
        marks: {one.object_id for one in marked(units, question, marks) if one.handled}
        for marks in ("lived", "none", "against")
    }
    assert handled["lived"] == {one.object_id for one in question.told}
    assert handled["none"] == set()
    assert handled["against"]
    assert not handled["against"] & question.right


def test_control_rows_are_as_good_as_chance_and_recency(questions):
    composite = [question for question in questions if question.kinds == ("composite",)]
    rows = {(by, "lived"): InOrder(by) for by in CONTROLS}
    chance, _, handled = ask(rows, composite, 10, draws=2)
    value = {row.row: row.by_kind["composite"].value for row in (chance, handled)}
    assert 0.05 < value["chance"] < 0.15
    assert 0.18 < value["handled"] < 0.33  # one of four that were handled


def test_right_unit_is_counted_behind_those_that_are_skipped(questions):
    question = questions[0]
    (right,) = (one for one in question.told if one.object_id in question.right)
    assert is_right(InOrder("handled"), question, [right])
    others = [one for one in question.told if one is not right]
    assert not is_right(InOrder("handled"), question, others)


def test_texts_that_recall_reads_hold_no_word_that_training_lacks():
    file = read_json(TYPE_WORDS, WordFile)
    texts = [text for texts in file.types.values() for text in texts]
    assert len(texts) > 4000
    assert not [text for text in texts if unseen_lexemes().found_in(text)]
