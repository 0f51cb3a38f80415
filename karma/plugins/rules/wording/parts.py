"""The parts of an instruction: its noun phrases with their roles, its pronouns and its verbs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from karma.plugins.rules.wording.words import closed_words, word_lists

Role = Literal["thing", "destination", "modifier"]  # a modifier says which other thing is meant

_CERTAIN = ("into", "onto")  # prepositions that only ever name where something goes
_TELLING = ("with", "without", "of", "about", "than")  # what a thing is like
_CONTAINED = ("in", "under", "inside", "with", "using", "into", "beneath")


@dataclass(frozen=True, slots=True, kw_only=True)
class NounPhrase:
    """One thing that an instruction speaks of."""

    text: str  # lower case, without its determiner
    head: str  # the word that says what it is
    start: int  # of the text with its determiner, in characters of the instruction
    end: int
    role: Role = "thing"
    preposition: str = ""  # that it stands behind
    modifiers: tuple[str, ...] = ()  # "you just washed", "from the fridge"
    determiner: str = ""

    @property
    def is_destination(self) -> bool:
        """Whether something is to go there, or is to be done there."""
        return self.role == "destination"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pronoun:
    """A word that stands for a thing spoken of or handled before."""

    text: str
    start: int
    end: int


@dataclass(frozen=True, slots=True, kw_only=True)
class VerbPhrase:
    """One deed that an instruction speaks of."""

    text: str  # base form with its particle: "pick up", "nuke"
    base: str
    start: int  # of the verb, in characters of the instruction
    end: int
    negated: bool = False  # "don't", "never" before it


@dataclass(frozen=True, slots=True, kw_only=True)
class Phrases:
    """What an instruction speaks of, each in the order of the text."""

    nouns: tuple[NounPhrase, ...] = ()
    pronouns: tuple[Pronoun, ...] = ()
    verbs: tuple[VerbPhrase, ...] = ()


def with_roles(nouns: Sequence[NounPhrase], base: str) -> list[NounPhrase]:
    """Return the noun phrases of one verb with their roles, modifiers with what they say it of."""
    lists = word_lists()
    placed = [n for n, one in enumerate(nouns) if one.preposition in lists.destinations]
    goes, done_at = base in lists.deeds["put"], base in lists.deeds["done_at"]
    last = placed[-1] if placed and (goes or not base) else -1
    found: list[NounPhrase] = []
    for number, one in enumerate(nouns):
        role: Role = "thing"
        contained = done_at and one.preposition in _CONTAINED
        if number == last or contained or one.preposition in _CERTAIN:
            role = "destination"
        elif one.preposition in lists.destinations | lists.sources:
            role = "modifier"
        elif one.preposition in _TELLING and number and not done_at:
            role = "modifier" if base not in lists.deeds["other"] else "thing"
        if role == "modifier" and found:
            said = f"{one.preposition} {one.determiner} {one.text}"
            modifiers = (*found[-1].modifiers, " ".join(said.split()))
            found[-1] = replace(found[-1], modifiers=modifiers)
        found.append(replace(one, role=role))
    return found


def head_of(words: Sequence[str]) -> str:
    """Return the word that says what a phrase is.

    >>> head_of("bottle of wine".split()), head_of("thin slice of rye bread".split())
    ('bottle', 'bread')
    """
    lists = word_lists()
    if words[0] in lists.pronoun_heads:
        return words[0]
    for at, word in enumerate(words):
        if at and (word in closed_words() or word in lists.pronouns) and word != "of":
            return head_of(words[:at])
    if "of" in words[1:-1]:
        at = list(words).index("of", 1)
        whole = words[at - 1] in lists.measures and words[at - 1] not in ("bottle", "box", "roll")
        return words[-1] if whole else words[at - 1]
    return words[-1]
