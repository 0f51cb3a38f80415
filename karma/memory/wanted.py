"""What a question to memory asks for: the things that it names, their states, places and history.

The noun phrases come from `karma.language`. What says how a thing is ("washed", "that is not cut")
or where it lies ("from the fridge") is told apart from what says which kind of thing it is, since
sentence vectors tell states and places badly. Where something is to go says nothing about where it
is, so the destination of a request is only asked for as a thing of its own, after the others.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain

from karma.household.states import OPPOSITES, state_words
from karma.language.parts import NounPhrase, Phrases
from karma.language.phrases import phrases_of
from karma.language.words import word_lists

_NOT = r"(?:not|never|no longer|\w+n't)(?: yet| been| being| very| so)*"
_PLURAL = frozenset(("them", "they", "these", "those", "both", "'em"))
_JOINING = frozenset(("with", "of", "made of", "for", "made from", "without"))
_PARTICIPLE = re.compile(  # "the cut up onion"
    r"(?<=\bthe )(\w+ed|cut|lit|shut) (up|off|on|down|out)(?= [a-z])"
)
_HISTORY = frozenset(("just", "recently", "earlier", "before", "last", "previously"))
_ANYTHING = frozenset((
    "thing", "things", "item", "items", "object", "objects", "stuff", "one", "ones",
))  # heads that leave open what is meant  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """One thing that a question asks for."""

    text: str  # says what it is; "" where only its state, place or history does
    has: frozenset[str] = frozenset()  # states
    lacks: frozenset[str] = frozenset()  # states that it is not in
    places: tuple[str, ...] = ()  # phrases for where it lies or comes from
    handled: bool = False  # somebody used it of late
    is_destination: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """Everything that a question asks for."""

    things: tuple[Wanted, ...]
    referents: int = 0  # things handled last that a pronoun stands for


def question_of(text: str) -> Question:
    """Return what a request, or a noun phrase alone, asks memory for.

    >>> found = question_of("Put the clean mug from the desk in the sink")
    >>> [(one.text, sorted(one.has), one.places, one.is_destination) for one in found.things]
    [('mug', ['cleaned'], ('desk',), False), ('sink', [], (), True)]
    >>> question_of("Now slice it").referents
    1
    """
    text = _whole_adjectives(text.lower())
    phrases = phrases_of(text)
    things = _with_parts(phrases, text)
    if not phrases.verbs:  # a noun phrase alone: what stands behind it says where it is
        places = tuple(noun.text for noun in things[1:] if noun.is_destination)
        found = tuple(_wanted(noun, places=places) for noun in things[:1])
    else:
        found = tuple(_wanted(noun) for noun in things)
    referents = _referents(phrases)
    if not found and not referents:
        found = (_wanted_as(text),)
    return Question(things=found, referents=referents)


def _whole_adjectives(text: str) -> str:
    """Return a text in which no comma and no particle cuts adjectives off from their noun.

    >>> _whole_adjectives("the clean, red food"), _whole_adjectives("get the cut up onion")
    ('the clean red food', 'get the cut-up onion')
    """
    text = re.sub(rf"\b({_any_of(_by_word()[0])}),(?= \w+ \w)", r"\1", text)
    return _PARTICIPLE.sub(r"\1-\2", text)


def _with_parts(phrases: Phrases, text: str) -> list[NounPhrase]:
    """Return what is named, "a pot with a lid" and "food for a cat" as one thing each."""
    tool = any(verb.base in word_lists().deeds["with_a_tool"] for verb in phrases.verbs)
    found: list[NounPhrase] = []
    for noun in phrases.nouns:
        between = text[found[-1].end : noun.start].split() if found else []
        joined = " ".join(between) in _JOINING and not (tool and between == ["with"])
        if joined:
            start = max(text.find(found[-1].text, found[-1].start), found[-1].start)
            found[-1] = replace(found[-1], text=text[start : noun.end], end=noun.end)
        elif noun.role != "modifier":
            found.append(noun)
    return found


def _referents(phrases: Phrases) -> int:
    """Return how many earlier things a pronoun stands for; 0 if for something in the text."""
    first = min((n.start for n in phrases.nouns if not n.is_destination), default=None)
    for pronoun in phrases.pronouns:
        if first is None or pronoun.start < first:
            return 2 if pronoun.text in _PLURAL else 1
    return 0


def _wanted(noun: NounPhrase, places: tuple[str, ...] = ()) -> Wanted:
    described = [noun.text]
    said, handled = [noun.text], False
    for modifier in noun.modifiers:
        words = set(modifier.split())
        where = _places(modifier)
        if where:
            places = (*places, *where)
        elif words & (word_lists().persons | _HISTORY):
            handled = True
            said.append(re.sub(r"\bused\b", "", modifier))
        elif _states(modifier):
            said.append(modifier)
        elif modifier not in noun.text:  # not joined to it yet
            described.append(modifier)
    found = _wanted_as(" ".join(described), " ".join(said))
    return replace(found, places=places, handled=handled, is_destination=noun.is_destination)


def _wanted_as(described: str, said: str | None = None) -> Wanted:
    """Return what a text asks for, its states told apart; `said` is where these stand."""
    states = _states(described if said is None else said)
    plain = " ".join(_all_states().sub(" ", described.replace("-", " ")).split())
    vague = word_lists().pronoun_heads | word_lists().determiners | _ANYTHING
    named = any(word not in vague for word in re.findall(r"[\w'-]+", plain))
    return Wanted(
        text=plain if named else "",
        has=frozenset(state for state, has in states if has),
        lacks=frozenset(state for state, has in states if not has),
    )


def _places(modifier: str) -> tuple[str, ...]:
    """Return the places that a modifier names: "from the fridge", "that is on the desk"."""
    lists = word_lists()
    near = lists.destinations | lists.sources
    return tuple(noun.text for noun in phrases_of(modifier).nouns if noun.preposition in near)


# ----------------------------------------------------------------- states


def _states(text: str) -> set[tuple[str, bool]]:
    """Return the states that a text names, and whether the thing is in them.

    >>> sorted(_states("that is not clean yet")), sorted(_states("raw"))
    ([('cleaned', False), ('dirty', True)], [('cooked', False)])
    """
    found, (has, lacks) = set(), _by_word()
    for match in _all_states().finditer(text.replace("-", " ")):
        denied = match["no"] is not None
        for state in has.get(match["state"], ()):
            found.add((state, not denied))
            if denied and state in OPPOSITES:
                found.add((OPPOSITES[state], True))
        for state in lacks.get(match["state"], ()):
            found.add((state, denied))
    return found


@cache
def _all_states() -> re.Pattern[str]:
    words = _any_of(chain(*_by_word()))
    return re.compile(rf"(?<![\w-])(?:(?P<no>{_NOT}) )?(?P<state>{words})(?![\w-])")


def _any_of(words: Iterable[str]) -> str:
    return "|".join(sorted(map(re.escape, set(words)), key=lambda word: (-len(word), word)))


@cache
def _by_word() -> tuple[Mapping[str, Sequence[str]], Mapping[str, Sequence[str]]]:
    """Return word -> states that a thing called so is in, and those that it is not in."""
    found: tuple[dict[str, list[str]], dict[str, list[str]]] = ({}, {})
    for by_word, words_of in zip(found, (state_words().has, state_words().lacks), strict=True):
        for state, words in words_of.items():
            for word in words:
                by_word.setdefault(word, []).append(state)
    return found
