"""Recall that finds what is meant: kinds by vectors, states, places and history by rules.

Behind the same Protocol as the paper's cosine, which stays as it is. A question is taken apart
(`karma/memory/wanted.py`); each thing that it names is as similar to a unit as to the nearest of
the texts that say what things of the unit's type are called, look like and are for. To that come
fixed bonuses. They were set on questions of our own and on household questions of the reference
data, and are not fitted to any task.
"""

from collections.abc import Callable, Sequence
from itertools import islice

import numpy as np

from karma.contracts import Embedder, MemoryUnit, Recalled, Vectors
from karma.household.ids import root_type
from karma.household.pieces import base_type
from karma.household.states import ALIKE
from karma.household.types import in_words
from karma.household.uses import CHANGED_IN
from karma.language.hints import TYPE_WORDS, kept_words, own_texts, singular
from karma.memory.index import FoundUnit, UnitIndex
from karma.memory.recall import row_of
from karma.memory.wanted import Wanted, question_of

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
            bonus = _named(kind, wanted.text)
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


def _named(kind: str, text: str) -> float:
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
