"""Recall that also reads states, places, names and pronouns, which sentence vectors tell badly.

Behind the same Protocol as the paper's cosine, which stays as it is: similarity to the unit's name,
plus fixed bonuses. The weights were set once, from the reference measurements on household
questions (state 0.2, handled 0.05 to 0.1), and are not fitted to any task.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

from karma.contracts import Embedder, MemoryUnit, Recalled
from karma.household.ids import root_type
from karma.household.pieces import base_type
from karma.household.states import STATE_WORDS
from karma.memory.recall import CosineRecall, unit_sentence

PRONOUNS = frozenset(("it", "its", "that", "them", "this", "they"))
STATE_BONUS, PLACE_BONUS, HANDLED_BONUS = 0.2, 0.2, 0.1
NAME_BONUS, PRONOUN_BONUS = 0.5, 0.5
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


class StatefulRecall:
    """Top-K by cosine of the name plus bonuses for state, place, handling, name and pronoun.

    Args:
        embedder: text to vectors.
        text: accepted so that it can stand in for `CosineRecall`; names alone are embedded here.
    """

    def __init__(self, embedder: Embedder, *, text: str = "sentence") -> None:
        self._cosine = CosineRecall(embedder, text=_name)

    def recall(self, query: str, units: Sequence[MemoryUnit], k: int) -> list[Recalled]:
        """Return the best units first; ties keep the order of `units`.

        The similarity given back is the score and may exceed 1.

        Args:
            query: the sub-task, or the phrase that names what is wanted.
            units: what is remembered, the last used last.
            k: how many; fewer come back when there are fewer units.

        Raises:
            ValueError: k < 1.
        """
        if k < 1:
            raise ValueError(f"k must be at least 1, not {k}")
        words = re.findall(r"[a-z]+", query.lower())
        asked = words[1:]  # the first word is the verb: "clean the fork" asks for no clean fork
        states = {s for s, said in STATE_WORDS.items() if set(said) & set(asked)}
        said = {word for state in states for word in STATE_WORDS[state]}
        plain = " ".join(word for word in words if word not in said)
        found = self._cosine.recall(plain, units, max(len(units), 1))
        order = {id(unit): number for number, unit in enumerate(units)}
        last = next((unit for unit in reversed(units) if unit.handled), None)
        pronoun = bool(PRONOUNS & set(words))
        scored = [
            replace(item, similarity=item.similarity + _bonus(item.unit, words, states))
            if not (pronoun and item.unit is last)
            else replace(item, similarity=item.similarity + PRONOUN_BONUS)
            for item in found
        ]
        scored.sort(key=lambda item: (-item.similarity, order[id(item.unit)]))
        return scored[:k]


def _bonus(unit: MemoryUnit, words: Sequence[str], states: set[str]) -> float:
    bonus = HANDLED_BONUS if unit.handled else 0.0
    bonus += STATE_BONUS * bool(states & set(unit.states))
    place = _words(root_type(unit.place_id or ""))
    bonus += PLACE_BONUS * bool(place and place[-1] in words)
    named = _words(base_type(unit.object_type))
    return bonus + NAME_BONUS * bool(named and named[-1] in words)


def _name(unit: MemoryUnit) -> str:
    return unit_sentence(replace(unit, states=()))


def _words(name: str) -> list[str]:
    return [word.lower() for word in _WORD.findall(name)]
