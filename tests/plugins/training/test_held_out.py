"""What training has not seen, and how far that is from what it has: figures that cannot flatter."""

import re
import sys
from collections.abc import Iterable
from functools import cache
from itertools import chain

import pytest
from support.paths import ROOT

from karma.goals.files import load_tasks, load_texts
from karma.plugins.alfred.published_tasks import load_authors_tasks
from karma.plugins.alfred.sentences import plain
from karma.plugins.rules.language.lexemes import every_word
from karma.plugins.training.drawing.phrases import Book, disjoint_book, our_book
from karma.plugins.training.goal_sentences import read_sentences
from karma.plugins.training.sources import Sources

_SLOT = re.compile(r"\{\w+\}")
_WORD = re.compile(r"[a-z]+")


def words_apart(one: str, other: str) -> int:
    """Return how many words must change to turn one text into the other.

    >>> words_apart("put {x} in {r}", "put {x} down on {r}")
    2
    """
    first, second = one.split(), other.split()
    row = list(range(len(second) + 1))
    for number, word in enumerate(first, 1):
        above, row = row, [number]
        for at, rival in enumerate(second, 1):
            row.append(min(above[at] + 1, row[-1] + 1, above[at - 1] + (word != rival)))
    return row[-1]


def nearest(template: str, trained: Iterable[str]) -> int:
    """Return how many words a template lies from the nearest of some others."""
    words, best = frozenset(template.split()), sys.maxsize
    for other in trained:
        others = _said(other)
        if max(len(words - others), len(others - words)) < best:  # at least so far
            best = min(best, words_apart(template, other))
    return best


@cache
def _said(template: str) -> frozenset[str]:
    return frozenset(template.split())


def templates_of(book: Book) -> tuple[str, ...]:
    """Return every template of a book, those of its patterns included."""
    every = book.templates.values()
    patterns = (pattern for texts in book.spoken.values() for pattern in texts)
    stated = (text for pattern in patterns for text in book.stated(pattern))
    return tuple(dict.fromkeys(chain((text for texts in every for text in texts), stated)))


def words_of(templates: Iterable[str]) -> frozenset[str]:
    """Return the words of templates, slots left out."""
    return frozenset(word for text in templates for word in _WORD.findall(_SLOT.sub(" ", text)))


def form_of(text: str) -> str:
    """Return a sentence or template with its things masked: what is left is how it is asked.

    >>> form_of("Put the clean mug into the sink!"), form_of("put a clean {x0} into {r}")
    ('put the clean _ into _', 'put a clean _ into _')
    """
    text = _SLOT.sub(" _ ", text.lower())
    text = " ".join(re.findall(r"[a-z0-9]+|_", text))
    return _things().sub("_", text)


@cache
def _things() -> re.Pattern[str]:
    """Match what things are called, with an article, and "it"."""
    called = {name for entry in every_word().values() for name in entry.words}
    plain = (" ".join(re.findall(r"[a-z0-9]+", name)) for name in called)
    names = "|".join(sorted(plain, key=lambda name: (-len(name), name)))
    return re.compile(rf"\b(?:(?:the|a|an|some|one|my|that|this) )?(?:{names}|it)\b")


def forms_of(templates: Iterable[str]) -> frozenset[str]:
    """Return the forms of templates."""
    return frozenset(map(form_of, templates))


TASKS = ROOT / "eval" / "alfred_l" / "tasks.jsonl"
BOOK, DISJOINT = our_book(), disjoint_book()
OURS = templates_of(BOOK)
TRAINED = templates_of(BOOK.part(held_out=False))


# ----------------------------------------------------------------- templates


def test_held_out_templates_are_one_word_from_trained_ones():
    """Nearly all: they show that a sentence was not learnt by heart, and no more than that."""
    trained = BOOK.part(held_out=False).templates
    apart = [
        nearest(text, trained[kind])
        for kind, texts in BOOK.templates.items()
        for text in texts
        if BOOK.is_held_out(text)
    ]
    assert (len(apart), apart.count(1)) == (234, 228)


def test_held_out_patterns_are_not_in_the_training_part():
    """Each with all that its alternatives stand for."""
    trained, held_out = (BOOK.part(held_out=side).spoken for side in (False, True))
    assert not [one for kind, texts in held_out.items() for one in texts if one in trained[kind]]


def test_held_out_patterns_are_mostly_more_than_one_word_from_trained_ones():
    """Of the wording of each that is nearest to a trained one: 9 are the same, 30 far from all."""
    part = BOOK.part(held_out=False)
    apart = []
    for kind, patterns in BOOK.part(held_out=True).spoken.items():
        said = (text for pattern in part.spoken[kind] for text in BOOK.stated(pattern))
        trained = {*part.templates[kind], *said}
        apart += [min(nearest(text, trained) for text in BOOK.stated(one)) for one in patterns]
    assert [sum(low <= far for far in apart) for low in (0, 1, 2, 3)] == [68, 59, 50, 30]


def test_disjoint_templates_are_three_words_or_more_from_all_of_ours():
    assert len(templates_of(DISJOINT)) == 68
    assert [text for text in templates_of(DISJOINT) if nearest(text, OURS) < 3] == []


def test_disjoint_templates_each_have_a_word_that_none_of_ours_has():
    known = words_of(OURS)
    assert [text for text in templates_of(DISJOINT) if words_of([text]) <= known] == []


@pytest.mark.parametrize("part", ["adjectives", "just", "around", "references"])
def test_disjoint_words_are_not_among_ours(part):
    ours, others = getattr(BOOK, part), getattr(DISJOINT, part)
    assert ours.keys() == others.keys()
    for name, texts in others.items():
        assert not set(texts) & set(ours[name])


@pytest.mark.parametrize("kind", BOOK.templates)
def test_disjoint_templates_of_a_kind_have_its_slots(kind):
    def slots(texts):
        return {slot for text in texts for slot in re.findall(r"\{(\w)", text)}

    assert slots(DISJOINT.templates[kind]) == slots(BOOK.templates[kind])


# ----------------------------------------------------------------- the tests' sentences


def instructions(tasks):
    return [sub.instruction for task in tasks for sub in task.subtasks]


def authors_instructions(shared):
    files = sorted((shared / "data" / "alfred_l").glob("*_tasks.json"))
    if not files:
        pytest.skip(f"needs {shared}/data/alfred_l")
    return instructions(load_authors_tasks(files))


def with_trained_form(sentences):
    forms = forms_of(TRAINED)
    return [text for text in sentences if form_of(text) in forms]


def test_over_half_of_our_tasks_sentences_have_the_form_of_a_trained_template():
    """The phrase book was extended after they had been read: they are no unseen phrasings."""
    sentences = instructions(load_tasks(TASKS))
    assert (len(sentences), len(with_trained_form(sentences))) == (182, 100)


@pytest.mark.shared
def test_over_half_of_the_authors_sentences_have_the_form_of_a_trained_template(shared):
    sentences = authors_instructions(shared)
    assert (len(sentences), len(with_trained_form(sentences))) == (81, 52)


@pytest.mark.shared
def test_some_sentences_of_the_tests_stand_in_alfreds_training_split(shared):
    """Word for word, as short sentences do; a draw that says one of them is drawn again."""
    path = shared / "data" / "alfred" / "train.jsonl.gz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    said = {plain(one.text) for one in read_sentences(path)}
    ours, authors = instructions(load_tasks(TASKS)), authors_instructions(shared)
    assert [sum(plain(text) in said for text in texts) for texts in (ours, authors)] == [6, 2]


def test_what_requests_say_is_kept_out_of_training(tmp_path):
    said = [ROOT / "eval" / "requests" / f"{name}.jsonl" for name in ("do", "refuse", "several")]
    sources = Sources(folder=tmp_path, shared=tmp_path, tests=(TASKS,), said=tuple(said))
    forbidden = sources.unseen().sentences
    for path in said:
        assert {plain(text) for text in load_texts(path)} - {""} <= forbidden
    assert plain("Put a fork in the sink.") in forbidden  # a task's
    assert plain("\u628a\u676f\u5b50") not in forbidden  # else all Chinese would be
