"""Which units go into the prompt: the nearest to the query by cosine (KARMA §3.5)."""

import json
import re
from collections.abc import Callable, Sequence

import faiss
import numpy as np
from numpy.typing import NDArray

from karma.contracts import Embedder, MemoryUnit, Recalled, Vectors
from karma.errors import UnknownNameError
from karma.memory.short_term import listing

Verbaliser = Callable[[MemoryUnit], str]

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")  # "TVStand" is TV, Stand


def unit_text(unit: MemoryUnit) -> str:
    """Return the unit as the paper's Listing 1 has it: type, position, id, image path as JSON."""
    return json.dumps(listing(unit))


def unit_sentence(unit: MemoryUnit) -> str:
    """Return the unit in plain words: states and name, without its place.

    >>> unit_sentence(MemoryUnit(object_id="a", object_type="DishSponge", position_m=(0, 0, 0),
    ...                          states=("cleaned", "used up")))
    'a cleaned, used up dish sponge'
    """
    name = " ".join(_WORD.findall(unit.object_type)).lower()
    states = ", ".join(state for state in unit.states if state != "none")
    phrase = f"{states} {name}" if states else name
    return f"{'an' if phrase[:1] in tuple('aeiou') else 'a'} {phrase}"


VERBALISERS: dict[str, Verbaliser] = {"listing": unit_text, "sentence": unit_sentence}


class CosineRecall:
    """Top-K units by cosine similarity between their text and the query, exactly searched.

    Equal similarities keep the order of the units: FAISS itself promises no order of ties, so all
    similarities are fetched and sorted here, and units of equal text share one row of the index.

    Args:
        embedder: text to vectors; they are brought to length 1 here.
        text: what is embedded of a unit: a name in `VERBALISERS`, or a function.

    Raises:
        UnknownNameError: no verbaliser of that name.
    """

    def __init__(self, embedder: Embedder, *, text: str | Verbaliser = "listing") -> None:
        if isinstance(text, str):
            if text not in VERBALISERS:
                raise UnknownNameError(
                    f"no verbaliser named {text!r}. Known: {sorted(VERBALISERS)}"
                )
            text = VERBALISERS[text]
        self._embedder = embedder
        self._text = text

    def recall(self, query: str, units: Sequence[MemoryUnit], k: int) -> list[Recalled]:
        """Return the units closest to the query, best first; ties keep the order of `units`.

        Args:
            query: the instruction, or the phrase that names what is wanted.
            units: what is remembered.
            k: how many; fewer come back when there are fewer units.

        Raises:
            ValueError: k < 1.

        Source: KARMA §3.5, "the top-K most similar memories - those with the smallest cosine
        distance to the embedding of the input instruction".
        """
        if k < 1:
            raise ValueError(f"k must be at least 1, not {k}")
        if not units:
            return []
        texts = [self._text(unit) for unit in units]
        rows = {text: row for row, text in enumerate(dict.fromkeys(texts))}
        similarities = self._similarities(query, list(rows))
        found = [float(similarities[rows[text]]) for text in texts]
        order = sorted(range(len(units)), key=lambda index: (-found[index], index))
        return [Recalled(unit=units[index], similarity=found[index]) for index in order[:k]]

    def _similarities(self, query: str, texts: Sequence[str]) -> NDArray[np.float32]:
        """Return the cosine of the query with each text."""
        rows = np.concatenate([self._embed(text) for text in texts])
        index = faiss.IndexFlatIP(rows.shape[1])
        index.add(rows)
        scores, places = index.search(self._embed(query), len(texts))
        similarities = np.empty(len(texts), dtype=np.float32)
        similarities[places[0]] = np.clip(scores[0], -1.0, 1.0)
        return similarities

    def _embed(self, text: str) -> Vectors:
        """Return one row of length 1 (or 0).

        One text at a time: in a batch, padding moves the last digits, and the answer would depend
        on what the embedder has cached.
        """
        vector = np.asarray(self._embedder.embed([text]), dtype=np.float32)
        length = np.linalg.norm(vector, axis=1, keepdims=True)
        unit: Vectors = vector / np.maximum(length, np.float32(1e-12))
        return unit
