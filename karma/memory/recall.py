"""Which units go into the prompt: the nearest to the query by cosine (KARMA §3.5)."""

import json
from collections.abc import Callable, Sequence

import numpy as np

from karma.contracts import Embedder, MemoryUnit, Recalled, Vectors
from karma.errors import UnknownNameError
from karma.household.types import in_words
from karma.memory.index import UnitIndex
from karma.memory.short_term import listing

Verbaliser = Callable[[MemoryUnit], str]


def unit_text(unit: MemoryUnit) -> str:
    """Return the unit as the paper's Listing 1 has it: type, position, id, image path as JSON."""
    return json.dumps(listing(unit))


def unit_sentence(unit: MemoryUnit) -> str:
    """Return the unit in plain words: states and name, without its place.

    >>> unit_sentence(MemoryUnit(object_id="a", object_type="DishSponge", position_m=(0, 0, 0),
    ...                          states=("cleaned", "used up")))
    'a cleaned, used up dish sponge'
    """
    name = in_words(unit.object_type)
    states = ", ".join(state for state in unit.states if state != "none")
    phrase = f"{states} {name}" if states else name
    return f"{'an' if phrase[:1] in tuple('aeiou') else 'a'} {phrase}"


VERBALISERS: dict[str, Verbaliser] = {"listing": unit_text, "sentence": unit_sentence}


class CosineRecall:
    """Top-K units by cosine similarity between their text and the query, exactly searched.

    The index is kept and follows the units that it is asked about. Equal similarities keep the
    order of the units, and units of equal text share one row.

    Args:
        embedder: text to vectors; they are brought to length 1 here.
        text: what is embedded of a unit: a name in `VERBALISERS`, or a function.

    Raises:
        UnknownNameError: no verbaliser of that name.
    """

    def __init__(self, embedder: Embedder, *, text: str | Verbaliser = "listing") -> None:
        self._embedder = embedder
        self._index = UnitIndex(self._asked, verbaliser(text) if isinstance(text, str) else text)

    def recall(self, query: str, units: Sequence[MemoryUnit], k: int) -> list[Recalled]:
        """Return the units closest to the query, best first; ties keep the order of `units`.

        Raises:
            ValueError: k < 1.

        Source: KARMA §3.5, "the top-K most similar memories - those with the smallest cosine
        distance to the embedding of the input instruction".
        """
        if k < 1:
            raise ValueError(f"k must be at least 1, not {k}")
        self._index.follow(units)
        return self._index.recalled(self._index.best(self._asked(query), k)) if units else []

    def _asked(self, query: str) -> Vectors:
        return row_of(self._embedder, query)


def verbaliser(name: str) -> Verbaliser:
    """Return how a unit is put in words, by the name of it.

    Raises:
        UnknownNameError: no verbaliser of that name.
    """
    if name not in VERBALISERS:
        raise UnknownNameError(f"no verbaliser named {name!r}. Known: {sorted(VERBALISERS)}")
    return VERBALISERS[name]


def row_of(embedder: Embedder, text: str) -> Vectors:
    """Return a text's vector, shape (1, d), of length 1 (or 0).

    One text at a time: in a batch, padding moves the last digits, and the answer would depend on
    what is asked together.
    """
    vector = np.asarray(embedder.embed([text]), dtype=np.float32)
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    unit: Vectors = vector / np.maximum(length, np.float32(1e-12))
    return unit
