"""How far templates and sentences lie from each other, by their words and by how they ask.

A template is a sentence whose things are slots. Two templates are as far apart as the words that
must be put in, taken out or replaced to turn one into the other; a slot counts as a word.
"""

import re
import sys
from collections.abc import Iterable
from functools import cache
from itertools import chain

from karma.bench.drawing.phrases import Book
from karma.language.lexemes import every_word

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
    """Return every template of a book, of all kinds of requests: mined, and of its patterns."""
    every = (*book.templates.values(), *book.mined.values())
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
