"""What things are called, and which of those words no planner is trained on.

`lexicon.toml` has all words; `held_out.toml` lists those that training lacks (the rule is in
`karma.plugins.training.sources`). A lexeme is a word or phrase of one meaning: a name ("tumbler"),
a vaguer word ("drinking vessel"), a use ("write with"), a verb, an adjective.
"""

import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from karma.files import read_toml

HERE = Path(__file__).parent
HELD_OUT = HERE / "held_out.toml"
USE_FIRST = ("some", "any", "where ", "what", "land of ")  # words that take no article


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What one object type is called, the commonest words first."""

    names: tuple[str, ...]
    kinds: tuple[str, ...] = ()
    uses: tuple[str, ...] = ()  # what goes after "thing to"

    @property
    def words(self) -> tuple[str, ...]:
        """All of them; uses as they stand."""
        return (*self.names, *self.kinds, *self.uses)


class UnseenWords(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Lexemes that training lacks, by class."""

    names: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    uses: tuple[str, ...] = ()
    adjectives: tuple[str, ...] = ()
    verbs: tuple[str, ...] = ()

    @property
    def things(self) -> frozenset[str]:
        """What things are called."""
        return frozenset((*self.names, *self.kinds, *self.uses))

    @property
    def texts(self) -> frozenset[str]:
        """All lexemes."""
        return self.things | {*self.adjectives, *self.verbs}


@cache
def every_word() -> Mapping[str, Entry]:
    """Return object type -> all words for it, those that training lacks included."""
    return read_toml(HERE / "lexicon.toml", dict[str, Entry])


@cache
def held_out() -> UnseenWords:
    """Return the lexemes that training lacks."""
    return read_toml(HELD_OUT, UnseenWords)


@cache
def lexicon() -> Mapping[str, Entry]:
    """Return object type -> the words for it that training has."""
    return {kind: _part(entry, unseen=False) for kind, entry in every_word().items()}


@cache
def unseen_lexicon() -> Mapping[str, Entry]:
    """Return object type -> the words for it that training lacks, where there are any."""
    found = {}
    for kind, entry in every_word().items():
        part = _part(entry, unseen=True)
        known = lexicon()[kind]
        bare = not (part.kinds or part.uses)
        found[kind] = Entry(
            names=part.names or known.names,
            kinds=known.kinds if bare else part.kinds,
            uses=known.uses if bare else part.uses,
        )
    return found


def _part(entry: Entry, *, unseen: bool) -> Entry:
    things = held_out().things

    def side(texts: Iterable[str]) -> tuple[str, ...]:
        return tuple(text for text in texts if (text in things) == unseen)

    return Entry(names=side(entry.names), kinds=side(entry.kinds), uses=side(entry.uses))


def types_called(word: str) -> tuple[str, ...]:
    """Return the types that a name, kind or use fits, in the lexicon's order."""
    return _types_by_word().get(word, ())


@cache
def _types_by_word() -> Mapping[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    for kind, entry in every_word().items():
        for word in dict.fromkeys(entry.words):
            found[word] = (*found.get(word, ()), kind)
    return found


def pick_common(rng: np.random.Generator, words: tuple[str, ...]) -> str:
    """Draw a word, the first ones oftener: of twenty the first comes in a fifth of the draws."""
    return words[int(len(words) * rng.random() ** 2)]


def takes_article(noun: str) -> bool:
    """Return whether "the" may stand before a noun phrase.

    >>> takes_article("mug"), takes_article("something to write with")
    (True, False)
    """
    return not noun.startswith(USE_FIRST)


# ----------------------------------------------------------------- words within texts


def plain_words(text: str) -> tuple[str, ...]:
    """Return the words of a text as they are compared: small, and without the "s" of a plural.

    >>> plain_words("The Wine-Glasses' shelf")
    ('the', 'wine', 'glass', 'shelf')
    """
    found = re.findall(r"[^\W_]+", text.lower().replace("'", ""))
    return tuple(map(_singular, found))


def _singular(word: str) -> str:
    if len(word) < 4 or word.endswith("ss"):
        return word
    return re.sub(r"(?<=ss|sh|ch)es$|(?<=x)es$|s$", "", word)


class Lexemes:
    """Finds lexemes in texts, as words in a row.

    Args:
        texts: the lexemes.
    """

    def __init__(self, texts: Iterable[str]) -> None:
        self._by_words = {plain_words(text): text for text in sorted(texts)}
        self._longest = max(map(len, self._by_words), default=0)

    def found_in(self, text: str) -> tuple[str, ...]:
        """Return the lexemes that a text has in it, in the order in which they stand."""
        words = plain_words(text)
        return tuple(one for start in range(len(words)) for one in self._at(words, start))

    def number_in(self, text: str) -> int:
        """Return how many lexemes a text has, one within another not counted."""
        words, start, found = plain_words(text), 0, 0
        while start < len(words):
            here = self._at(words, start)
            found += bool(here)
            start += len(plain_words(here[-1])) if here else 1
        return found

    def _at(self, words: tuple[str, ...], start: int) -> list[str]:
        """Return the lexemes that begin at a word, the shortest first."""
        ends = range(start + 1, min(start + self._longest, len(words)) + 1)
        rows = (words[start:end] for end in ends)
        return [self._by_words[row] for row in rows if row in self._by_words]


@cache
def unseen_lexemes() -> Lexemes:
    """Return what finds held-out lexemes in texts."""
    return Lexemes(held_out().texts)
