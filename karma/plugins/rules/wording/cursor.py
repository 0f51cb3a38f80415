"""A place among the words of an instruction, and what can be told of the words from there on.

What stands behind a noun is read here too: uses ("to write with"), clauses ("you just washed").
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from karma.plugins.rules.wording.words import closed_words, verb_forms, verb_tense, word_lists

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


# ----------------------------------------------------------------- behind a noun

FORMS_OF_BE = frozenset(
    ["is", "are", "was", "were", "be", "been", "i'm", "you're", "it's", "there's", "isn't",
     "aren't", "wasn't"]
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Tail:
    """What stands behind a noun."""

    start: int  # number of its first word
    describes: bool  # it says what the thing is or is for, not which one


def read_tail(cursor: Cursor, *, needs_place: bool) -> Tail | None:
    """Read one relative clause or use behind a noun; None, and nothing read, without one."""
    start, lists = cursor.at, word_lists()
    word = cursor.word()
    if word == "to" and _is_purpose(cursor):
        cursor.at += 1
        _run(cursor, needs_place=needs_place)
        return Tail(start, describes=True)
    if word == "for" and verb_tense(cursor.word(1)) == "ing":
        cursor.at += 1
        _run(cursor, needs_place=needs_place)
        return Tail(start, describes=True)
    relative = word in ("that", "which", "who")
    if relative or (word in lists.persons and _is_clause(cursor)):
        cursor.at += 1
        describes = not _is_history(cursor, relative=relative)
        _run(cursor, needs_place=needs_place)
        if cursor.at > start + 1:
            return Tail(start, describes=describes)
        cursor.at = start
    return None


def _is_clause(cursor: Cursor) -> bool:
    """Return whether a person and a verb follow: "you washed", "i can drink from"."""
    ahead = 1
    lists = word_lists()
    if any(mark in cursor.word() for mark in ("'ve", "'d", "'re")):
        return True
    while cursor.word(ahead) in lists.adverbs or cursor.word(ahead) in lists.auxiliaries:
        ahead += 1
    return ahead > 1 or cursor.word(1) in verb_forms() or cursor.is_content(1)


def _is_purpose(cursor: Cursor) -> bool:
    """Return whether "to write with" is what a thing is for, not a deed of the request."""
    known = cursor.verb_follows(1) or verb_tense(cursor.word(1)) == "base"
    if not known and (not cursor.is_content(1) or cursor.is_content(2)):
        return False
    heads = word_lists().heads | {"one", "ones"}
    pronouns = word_lists().pronoun_heads
    if cursor.word(-1) in heads or {cursor.word(-2), cursor.word(-3)} & pronouns:
        return True
    return _stranded_ahead(cursor)


def _stranded_ahead(cursor: Cursor) -> bool:
    """Return whether a preposition without a noun follows within the clause."""
    lists = word_lists()
    for ahead in range(2, 8):
        word = cursor.word(ahead)
        if word in ("", *STOPS) or word in ("and", "then"):
            return False
        after = cursor.word(ahead + 1)
        stranded = after in ("", *STOPS, "and", "then") or after in lists.prepositions
        if word in ("with", "from", "in", "on") and stranded:
            return verb_tense(cursor.word(1)) != "" and cursor.word(1) not in lists.switching
    return False


def _is_history(cursor: Cursor, *, relative: bool) -> bool:
    """Return whether a clause says what was done to a thing, or where or how it is now."""
    lists = word_lists()
    ahead = 0
    subject = "" if relative and cursor.word() not in lists.persons else cursor.word(-1)
    if relative and cursor.word() in lists.persons:
        ahead, subject = 1, cursor.word()
    while cursor.word(ahead) in ("just", "recently", "already", "still", "now", "always"):
        ahead += 1
    word = cursor.word(ahead)
    if "'ve" in subject or word in ("have", "had", "has", "was", "were", "did"):
        return True
    if word in ("is", "are", "isn't", "aren't"):
        return cursor.word(ahead + 1) not in ("used", "for", "made", "good", "usually", "meant")
    past = verb_forms().get(word)
    if past is not None and past.tense == "past":
        return True
    if not subject:
        return word in ("sits", "lies", "stands", "lay", "stood", "belongs", "needs")
    return ahead > 0 or (past is not None and past.base == word and word in ("put", "cut", "set"))


def _run(cursor: Cursor, *, needs_place: bool) -> None:
    """Step over a clause behind a noun, up to the next request or its place.

    The last place of the clause is where the thing goes, if a verb that needs one governs it.
    """
    lists = word_lists()
    first, ends = cursor.at, len(cursor.tokens)
    places = []
    for number in range(first, len(cursor.tokens)):
        word = cursor.tokens[number].word
        offset = number - cursor.at
        if word in STOPS or (word in lists.conjunctions and number > first):
            ends = number
            break
        place = word in lists.destinations and word != "at" and cursor.begins_noun(offset + 1)
        is_there = cursor.word(offset - 1) in FORMS_OF_BE
        infinitive = word == "to" and verb_tense(cursor.word(offset + 1)) == "base"
        if place and not is_there and not infinitive:
            places.append(number)
    cursor.at = min(ends, places[-1]) if places and needs_place else ends
