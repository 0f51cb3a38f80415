"""The words that a request is read by, from `request_words.toml`."""

import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import msgspec

from karma.files import read_toml

TABLE = Path(__file__).with_name("request_words.toml")
_ENDINGS = (("ing", ""), ("ing", "e"), ("ed", ""), ("ed", "e"), ("es", ""), ("s", ""))
_USUAL = re.compile(r"\b(?:from now on|in (?:the )?future|as a rule|from this day)\b")
_LEADS_ON = frozenset(("go", "run", "come", "show", "like", "start", "use", "need", "want"))


class RequestWords(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The lists as their file has them."""

    every: frozenset[str]
    anything: frozenset[str]
    vague: frozenset[str]
    me: frozenset[str]
    elsewhere: frozenset[str]
    destinations: frozenset[str]
    sequence: frozenset[str]
    near: frozenset[str]
    sources: frozenset[str]
    tools: frozenset[str]
    passed_over: frozenset[str]
    asking: frozenset[str]
    be: frozenset[str]
    auxiliaries: frozenset[str]
    needs: frozenset[str]
    habits: frozenset[str]
    taught: frozenset[str]
    negations: frozenset[str]
    needs_place: frozenset[str]
    only_at: frozenset[str]
    of_itself: frozenset[str]
    small_verbs: frozenset[str]
    dropped: frozenset[str]
    compared: frozenset[str]
    marks: frozenset[str]
    never_mind: frozenset[str]
    rooms: frozenset[str]
    own_plurals: frozenset[str]
    regions: frozenset[str]
    beside: frozenset[str]
    general: frozenset[str]
    pieces: frozenset[str]
    measures: frozenset[str]
    containers: frozenset[str]
    results: frozenset[str]
    talk: frozenset[str]
    so_far: frozenset[str]
    rules_out: frozenset[str]
    before_nouns: frozenset[str]
    moved: frozenset[str]
    starts: frozenset[str]
    alone: frozenset[str]
    before_verbs: frozenset[str]
    numbers: Mapping[str, int]
    past: Mapping[str, str]
    of_a_part: Mapping[str, str]
    called: Mapping[str, tuple[str, ...]]
    seen: Mapping[str, str]
    deeds: Mapping[str, tuple[str, ...]]
    states: Mapping[str, tuple[str, ...]]

    @property
    def links(self) -> frozenset[str]:
        """All words that join a noun to what stands before it."""
        return self.destinations | self.sources | self.tools | self.passed_over


@cache
def request_words() -> RequestWords:
    """Return the lists, read once."""
    return read_toml(TABLE, RequestWords)


@cache
def deed_verbs() -> Mapping[str, str]:
    """Return verb, with its particle where it has one -> deed."""
    found: dict[str, str] = {}
    for deed, verbs in request_words().deeds.items():
        for verb in verbs:
            found.setdefault(verb, deed)
    return found


def is_usual(words: Sequence[str]) -> bool:
    """Return whether words in small letters tell of what is always so, not once.

    >>> is_usual(["it", "always", "goes", "there"]), is_usual("from now on it goes there".split())
    (True, True)
    """
    lists, text = request_words(), " ".join(words)
    return bool((lists.habits - lists.negations) & {*words}) or _USUAL.search(text) is not None


@cache
def deed_states() -> Mapping[str, str]:
    """Return how a thing is to be -> the deed that makes it so."""
    return {word: deed for deed, words in request_words().states.items() for word in words}


@cache
def _first_words() -> frozenset[str]:
    return frozenset(verb.split()[0] for verb in deed_verbs())


def base_of_deed(word: str) -> str:
    """Return the base of a verb that asks for something, "" for any other word.

    >>> base_of_deed("fetching"), base_of_deed("turned"), base_of_deed("taken"), base_of_deed("dog")
    ('fetch', 'turn', 'take', '')
    """
    past = request_words().past
    if word in past or word in _first_words():
        return past.get(word, word)
    for ending, instead in _ENDINGS:
        stem = f"{word.removesuffix(ending)}{instead}"
        if word.endswith(ending) and stem in _first_words():
            return stem
        once = stem[:-1] if stem[-1:] == stem[-2:-1] else stem  # "putting"
        if word.endswith(ending) and once in _first_words():
            return once
    return ""


def is_deed(word: str) -> bool:
    """Return whether a word is a form of a verb that asks for something by itself."""
    base = base_of_deed(word)
    return bool(base) and base not in _LEADS_ON
