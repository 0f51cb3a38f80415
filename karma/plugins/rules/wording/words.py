"""The closed word lists that an instruction is read by, and verbs in all their forms."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec

from karma.files import read_toml

TABLE = Path(__file__).parent / "words.toml"
_VOWELS = frozenset("aeiou")


class WordLists(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The lists as their file has them."""

    determiners: frozenset[str]
    pronouns: frozenset[str]
    persons: frozenset[str]
    heads: frozenset[str]  # so vague that what follows says what is meant
    pronoun_heads: frozenset[str]  # that need no determiner
    measures: frozenset[str]  # before "of"
    destinations: frozenset[str]
    sources: frozenset[str]
    others: frozenset[str]  # prepositions that name no place
    conjunctions: frozenset[str]
    auxiliaries: frozenset[str]
    negations: frozenset[str]
    adverbs: frozenset[str]
    particles: frozenset[str]
    switching: frozenset[str]  # verbs that take "on" and "off" as particles
    qualifiers: frozenset[str]  # before a noun: its state, size or order
    deeds: Mapping[str, frozenset[str]]  # base forms by what their prepositions say
    irregular: Mapping[str, str]  # form -> base

    @property
    def prepositions(self) -> frozenset[str]:
        """Every preposition, of places and others."""
        return self.destinations | self.sources | self.others


@dataclass(frozen=True, slots=True, kw_only=True)
class VerbForm:
    """One form of a known verb."""

    base: str
    tense: str  # "base", "s", "past", "ing"


@cache
def word_lists() -> WordLists:
    """Return the closed lists."""
    return read_toml(TABLE, WordLists)


@cache
def closed_words() -> frozenset[str]:
    """Return every word that is in a list of function words: no noun phrase begins with it."""
    lists = word_lists()
    small = (lists.conjunctions, lists.auxiliaries, lists.negations, lists.adverbs, lists.particles)
    return lists.persons.union(lists.prepositions, *small)


@cache
def verb_forms() -> Mapping[str, VerbForm]:
    """Return form -> verb, of every known verb."""
    lists = word_lists()
    bases = sorted(set().union(*lists.deeds.values()))
    found = {form: VerbForm(base=base, tense="past") for form, base in lists.irregular.items()}
    for base in bases:
        for form, tense in _regular(base):
            found.setdefault(form, VerbForm(base=base, tense=tense))
    found.update({base: VerbForm(base=base, tense="base") for base in bases})
    found["lying"] = VerbForm(base="lie", tense="ing")
    return found


def _regular(base: str) -> Iterator[tuple[str, str]]:
    """Yield the regular forms of a verb, doubled last letter and bare ones both."""
    yield base + ("es" if base.endswith(("s", "sh", "ch", "x", "z", "o")) else "s"), "s"
    if base.endswith("y") and base[-2] not in _VOWELS:
        yield f"{base[:-1]}ies", "s"
        yield f"{base[:-1]}ied", "past"
        yield f"{base}ing", "ing"
        return
    stem = base.removesuffix("e")
    yield f"{stem}ed", "past"
    yield f"{stem if base[-2:] not in ('ee', 'ye') else base}ing", "ing"
    short = len(base) > 2 and base[-1] not in _VOWELS | set("wxy") and base[-2] in _VOWELS
    if short and (len(base) < 3 or base[-3] not in _VOWELS):
        yield f"{base}{base[-1]}ed", "past"
        yield f"{base}{base[-1]}ing", "ing"


def base_of(word: str) -> str | None:
    """Return the base of a known verb's form; None of any other word.

    >>> base_of("slicing"), base_of("chopped"), base_of("took"), base_of("nuked"), base_of("mug")
    ('slice', 'chop', 'take', 'nuke', None)
    """
    form = verb_forms().get(word)
    return form.base if form else None


def verb_tense(word: str) -> str:
    """Return "base", "s", "past" or "ing" of a known verb's form, else ""."""
    known = verb_forms().get(word)
    if known is not None:
        return known.tense
    return "ing" if len(word) > 5 and word.endswith("ing") else ""
