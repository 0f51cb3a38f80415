"""The words by which sentences are cut into requests (`sentences.toml`)."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import msgspec

from karma.files import read_toml

TABLE = Path(__file__).parent / "sentences.toml"


class Passing(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is said in passing, as a pattern, and what it comes to."""

    said: str
    means: str


class SentenceVerbs(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Verbs by what they do to a sentence; see the table."""

    carry: frozenset[str]
    prepare: frozenset[str]
    prepare_alone: frozenset[str]
    always_prepare: frozenset[str]
    idle_with: frozenset[str]
    wants: frozenset[str]
    stated: frozenset[str]
    belonging: frozenset[str]
    both_tenses: frozenset[str]
    third: Mapping[str, str]


class SentenceWords(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Other words; see the table."""

    idle_nouns: frozenset[str]
    single: frozenset[str]
    plural: frozenset[str]
    parts: frozenset[str]
    themselves: frozenset[str]
    leads: frozenset[str]
    tellers: frozenset[str]
    frames: frozenset[str]
    asking: frozenset[str]
    relatives: frozenset[str]
    clauses: frozenset[str]
    behind: frozenset[str]
    conjoined: frozenset[str]
    beside: frozenset[str]
    no_place: frozenset[str]


class SentenceTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The whole of `sentences.toml`."""

    passing: tuple[Passing, ...]
    verbs: SentenceVerbs
    words: SentenceWords


@cache
def table() -> SentenceTable:
    """Return the words by which sentences are cut."""
    return read_toml(TABLE, SentenceTable)
