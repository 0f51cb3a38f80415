"""A place among the words of an instruction, and what can be told of the words from there on."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from karma.language.words import closed_words, verb_forms, word_lists

_TOKEN = re.compile(r"[^\W_]+(?:['’-][^\W_]+)*|[.,;:!?\n]")
STOPS = frozenset(".,;:!?\n")


@dataclass(frozen=True, slots=True)
class Token:
    """One word in lower case, or a punctuation mark, and where it stands."""

    word: str
    start: int
    end: int


def tokens_of(text: str) -> list[Token]:
    """Return words in lower case and punctuation, with their places."""
    return [
        Token(match[0].lower().replace("’", "'"), match.start(), match.end())
        for match in _TOKEN.finditer(text)
    ]


@dataclass(slots=True)
class Cursor:
    """A place among the words."""

    tokens: Sequence[Token]
    at: int = 0

    def word(self, offset: int = 0) -> str:
        """Return a word from here on, "" beyond the end."""
        place = self.at + offset
        return self.tokens[place].word if 0 <= place < len(self.tokens) else ""

    def is_content(self, offset: int = 0) -> bool:
        """Return whether a word is in no list of function words."""
        lists, word = word_lists(), self.word(offset)
        known = word in closed_words() or word in lists.determiners or word in lists.pronouns
        return bool(word) and word not in STOPS and (not known or word in lists.heads)

    def begins_noun(self, offset: int = 0) -> bool:
        """Return whether a noun phrase or pronoun begins here."""
        lists, word = word_lists(), self.word(offset)
        return word in lists.determiners or word in lists.pronouns or self.is_content(offset)

    def verb_follows(self, offset: int) -> bool:
        """Return whether the word behind "to" is a verb, known or by what follows it."""
        known = verb_forms().get(self.word(offset))
        if known is not None:
            return known.tense == "base" and self.word(offset + 1) not in ("of",)
        if not self.is_content(offset):
            return False
        return self.takes_object(offset + 1)

    def takes_object(self, offset: int) -> bool:
        """Return whether a word can only stand behind a verb: a determiner, pronoun or particle."""
        lists, word = word_lists(), self.word(offset)
        alone = word in lists.pronouns and word not in lists.determiners
        return alone or word in lists.determiners or word in lists.particles - {"on", "in"}
