"""Recall that finds what is meant: kinds by vectors, states, places and history by rules.

Behind the same Protocol as the paper's cosine, which stays as it is. A question is taken apart;
each thing that it names is as similar to a unit as to the nearest of the texts that say what things
of the unit's type are called, look like and are for. To that come fixed bonuses. They were set on
questions of our own and on household questions of the reference data, and are not fitted to any
task.

The noun phrases come from `karma.plugins.rules.wording`. States ("washed", "that is not cut") and
places ("from the fridge") are told apart from the words for the object type, since sentence vectors
tell states and places badly. The destination of a request says nothing about where an object is,
hence it is only asked for as an object of its own, after the others.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, islice

import numpy as np

from karma.household.ids import root_type
from karma.household.pieces import base_type
from karma.household.states import ALIKE, OPPOSITES, state_words
from karma.household.types import in_words
from karma.household.uses import CHANGED_IN
from karma.memory.recall import FoundUnit, UnitIndex, row_of
from karma.plugins.rules.wording.hints import TYPE_WORDS, kept_words, own_texts, singular
from karma.plugins.rules.wording.parts import NounPhrase, Phrases
from karma.plugins.rules.wording.phrases import phrases_of
from karma.plugins.rules.wording.words import word_lists
from karma.types.memory import MemoryUnit, Recalled
from karma.types.roles import Embedder
from karma.types.space import Vectors

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


STATE_BONUS, PLACE_BONUS, NAME_BONUS = 0.25, 0.3, 0.1
HANDLED_BONUS, LATELY_BONUS = 0.05, 0.2  # a small prior; what is said to have been used of late
DESTINATION = -0.3  # where something goes, beside what goes there
REFERENT = 2.0  # what a pronoun stands for, before all else
NEAREST = 3  # texts of a type that count


class StatefulRecall:
    """Top-K by similarity of kinds, and bonuses for names, states, places and handling.

    Args:
        embedder: text to vectors.
        text: accepted so that it can stand in for `CosineRecall`; types alone are embedded here,
            with the vectors that ship or, for another embedder, of a few texts on each type.
    """

    def __init__(self, embedder: Embedder, *, text: str = "sentence") -> None:
        self._embedder = embedder
        self._words = kept_words(TYPE_WORDS, embedder)
        self._index = UnitIndex(
            self._of_type,
            lambda unit: base_type(unit.object_type),
            lambda unit: unit.states,
            lambda unit: root_type(unit.place_id or ""),
            lambda unit: unit.handled,
            nearest=NEAREST,
        )

    def recall(self, query: str, units: Sequence[MemoryUnit], k: int) -> list[Recalled]:
        """Return the best units first; ties keep the order of `units`.

        The similarity given back is the score and may exceed 1.

        Raises:
            ValueError: k < 1.
        """
        if k < 1:
            raise ValueError(f"k must be at least 1, not {k}")
        if not units:
            return []
        self._index.follow(units)
        question = question_of(query)
        found = _last_handled(units, question.referents)
        for wanted in question.things:
            found += self._nearest_to(wanted, k)
        if len(found) < k:
            found += self._index.best(None, k, None, None, None, _handled(HANDLED_BONUS))
        return self._index.recalled(_best(found, k))

    def _nearest_to(self, wanted: Wanted, k: int) -> list[FoundUnit]:
        """Return the units nearest to one thing that is asked for; exact, like each of the lists.

        Whoever is among the best k by the best of several scores is so by that score.
        """
        asked = row_of(self._embedder, wanted.text) if wanted.text else None
        places = [row_of(self._embedder, text)[0] for text in wanted.places]

        def name(kind: str) -> float:
            bonus = _name_bonus(kind, wanted.text)
            return bonus + DESTINATION * wanted.is_destination

        def states(there: tuple[str, ...]) -> float:
            fit = sum(_fits(state, there) for state in wanted.has)
            fit += sum(state not in there for state in wanted.lacks)
            came = (
                self._similar(CHANGED_IN[state], places) for state in there if state in CHANGED_IN
            )
            return STATE_BONUS * fit + PLACE_BONUS / 2 * max(came, default=0.0)

        def place(kind: str) -> float:
            return PLACE_BONUS * self._similar(kind, places) if kind else 0.0

        handled = _handled(LATELY_BONUS if wanted.handled else HANDLED_BONUS)
        return self._index.best(asked, k, name, states, place, handled)

    def _similar(self, kind: str, phrases: Sequence[Vectors]) -> float:
        """Return how similar a type is to the nearest of some phrases; 0 without any."""
        if not phrases:
            return 0.0
        return float(max((self._of_type(kind) @ phrase).max() for phrase in phrases))

    def _of_type(self, kind: str) -> Vectors:
        """Return the vectors of a type's name and of what else is said of it, shape (n, d)."""
        texts = (in_words(kind), *(own_texts().types.get(kind, ()) if not self._words else ()))
        rows = [row_of(self._embedder, text) for text in texts]
        return np.concatenate([*rows, *([self._words.rows_of(kind)] if self._words else ())])


def _fits(state: str, there: Sequence[str]) -> float:
    """Return whether a thing is in a state, or half so in one that goes by the same words."""
    return 1.0 if state in there else 0.5 * (ALIKE.get(state) in there)


def _name_bonus(kind: str, text: str) -> float:
    """Return a bonus for each word of a type's name, if the text has them all.

    "Pens" and "pen" are one word, and so are "remotecontrol" and "remote control".
    """
    name = in_words(kind).split()
    words = [form for word in text.lower().split() for form in (word, singular(word))]
    said = all(word in words for word in name) or "".join(name) in words
    return NAME_BONUS * len(name) * said


def _handled(bonus: float) -> Callable[[bool], float]:
    return lambda handled: bonus * handled


def _last_handled(units: Sequence[MemoryUnit], count: int) -> list[FoundUnit]:
    """Return what was handled last, the very last first."""
    places = (at for at in reversed(range(len(units))) if units[at].handled)
    last = enumerate(islice(places, count))
    return [FoundUnit(place, REFERENT - number / 10) for number, place in last]


def _best(found: Sequence[FoundUnit], k: int) -> list[FoundUnit]:
    """Return the best k units of several lists, each by its best score; of equals the last used."""
    best: dict[int, FoundUnit] = {}
    for one in sorted(found, key=lambda one: (-one.score, -one.place)):
        best.setdefault(one.place, one)
    return list(best.values())[:k]
