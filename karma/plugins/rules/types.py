"""Nouns of parsed English: words, mentions, actions, conditions, and the request they add up to."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class Word:
    """A word of a sentence as a parser has it (Penn tags, ClearNLP's dependencies)."""

    text: str
    start: int  # in characters of the text
    lemma: str
    tag: str
    dep: str
    head: int  # number of the word that it hangs on; its own for a root

    @property
    def end(self) -> int:
        """Where it ends, in characters of the text."""
        return self.start + len(self.text)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mention:
    """A thing or place that words name."""

    text: str  # without its determiner: "blue plate"
    start: int  # in characters of the text, with its determiner
    end: int
    types: tuple[str, ...] = ()  # object types that it may mean; () no thing is called so
    number: int | None = None  # that was said: "two", "both"
    every: bool = False  # all that there are: "every", "all", a plural
    vague: bool = False  # it names nothing by itself: "it", "that thing"
    anything: bool = False  # whatever is at its place: "everything on the table"
    told: bool = False  # known by what was done or is elsewhere: "the thing you just closed"
    at: tuple[str, ...] = ()  # types of the place that it is told by: "on the side table"
    other: bool = False  # not the one that was meant before: "the other one"
    besides: tuple[str, ...] = ()  # types that are called so where none of `types` is at hand
    holding: tuple[str, ...] = ()  # types of what lies in or on it: "the plate with the potato"
    states: tuple[str, ...] = ()  # of `household.states`, that it is told by: "that is open"
    marks: tuple[str, ...] = ()  # words it is told by and that no look shows: "red", "second"


@dataclass(frozen=True, slots=True, kw_only=True)
class SaidDeed:
    """Something that is to be done, as words say it."""

    verb: str  # "switch off"
    deed: str  # of `household.deeds`; "" no skill is called so
    start: int
    things: tuple[Mention, ...] = ()
    place: Mention | None = None
    near: bool = False  # beside the place, not in or on it


Quantity = Literal["one", "any", "each", "all"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """What has to be so for a request to be carried out."""

    text: str  # "if the plate is dirty"
    thing: Mention | None = None
    state: str = ""  # of `household.states`, or "there"; "" it was not understood
    at: tuple[str, ...] = ()  # types of the place where a thing that is to be "there" is
    holds: bool = True  # False: where it is not so
    of: Quantity = "one"  # of several: "either", "they", "both"


Form = Literal["errand", "question", "statement", "teaching", "talk", "incomplete"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What was asked, from the words alone, before any planner: nothing of it is guessed."""

    text: str  # as it was said, one sentence
    form: Form
    whole: str = ""  # all sentences; the places of words are counted in it
    errand: str = ""  # the words to plan by: without times, conditions, exclusions and slips
    deeds: tuple[SaidDeed, ...] = ()  # in their order
    forbidden: tuple[SaidDeed, ...] = ()  # deeds that it says not to do
    exclusions: tuple[Mention, ...] = ()  # things and places that it rules out
    times: tuple[str, ...] = ()  # when, and for how long
    conditions: tuple[Condition, ...] = ()
    unread: tuple[str, ...] = ()  # words that no field holds
    lacking: str = ""  # what an incomplete request lacks: "what", "where"
    alone: tuple[Mention, ...] = ()  # things that are spoken of without any deed
    english: bool = True  # enough of its words are
    rest: tuple[SaidDeed, ...] = ()  # deeds of the same sentence that may be done as well

    @property
    def mentions(self) -> tuple[Mention, ...]:
        """All things and places of its deeds."""
        named = (one for deed in self.deeds for one in (*deed.things, deed.place))
        return tuple(one for one in named if one is not None)


class Parser(Protocol):
    """Sentences to words with their tags and what they hang on."""

    name: str

    def parse(self, text: str) -> Sequence[Word]:
        """Return the words of a text, without blanks."""

    def knows(self, word: str) -> bool:
        """Return whether a word, in small letters, is one of the language."""
