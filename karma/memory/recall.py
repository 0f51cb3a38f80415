"""Which units go into the prompt: the nearest to the query by cosine (KARMA §3.5).

The units stand beside a flat FAISS index, which is searched exactly. What is searched is not the
units but the distinct values of what tells them apart: a text that many units share has one place
in the index. A unit's score is the similarity of its value, which FAISS finds, and what the values
of its other properties are worth to a question.
"""

import json
from collections.abc import Callable, Hashable, Iterable, Sequence
from operator import is_
from typing import Any, NamedTuple

import faiss
import numpy as np
from numpy.typing import NDArray

from karma.errors import UnknownNameError
from karma.household.types import in_words
from karma.memory.short_term import listing
from karma.types.memory import MemoryUnit, Recalled
from karma.types.roles import Embedder
from karma.types.space import Vectors

Value = Hashable
Property = Callable[[MemoryUnit], Value]
Worth = Callable[[Any], float]  # what a value of a property adds to the score; any sign


class FoundUnit(NamedTuple):
    """A unit that a question found."""

    place: int  # in the units that were followed last
    score: float


class UnitIndex:
    """A FAISS index over the units that were last asked about.

    Args:
        rows: value of the first property -> its vectors, shape (n, d), n >= 1, of length 1 or 0.
        searched: the first property, by which FAISS searches.
        others: more properties, for bonuses.
        nearest: of the vectors of a value so many count, those nearest to the question; their mean
            is its similarity.
    """

    def __init__(
        self,
        rows: Callable[[Any], Vectors],
        searched: Property,
        *others: Property,
        nearest: int = 1,
    ) -> None:
        self._rows, self._nearest = rows, nearest
        self._properties = (searched, *others)
        self._units: tuple[MemoryUnit, ...] = ()
        self._columns: list[_Column] = []  # of each property
        self._vectors: dict[Value, Vectors] = {}  # of the first property's values
        self._owners: NDArray[np.intp] = np.zeros(0, np.intp)  # numbers of FAISS's rows
        self._index: Any = None

    def __len__(self) -> int:
        """Return how many vectors FAISS holds."""
        return len(self._owners)

    def follow(self, units: Sequence[MemoryUnit]) -> None:
        """Take in the units that are new and let go of those that are not there any more.

        Where all are new it is another memory, and nothing is kept: what is asked of an embedder
        for one episode depends on no other.
        """
        units = tuple(units)
        if len(units) == len(self._units) and all(map(is_, units, self._units)):
            return
        known = self._vectors
        if {*map(id, units)}.isdisjoint(map(id, self._units)):
            known = {}
        self._units = units
        self._columns = [_column(map(value_of, units)) for value_of in self._properties]
        distinct = self._columns[0].values
        vectors = {one: known[one] if one in known else self._rows(one) for one in distinct}
        if list(vectors) != list(self._vectors):
            self._owners = np.repeat(np.arange(len(vectors)), list(map(len, vectors.values())))
            self._index = _flat(np.concatenate(list(vectors.values()))) if vectors else None
        self._vectors = vectors

    def best(self, asked: Vectors | None, k: int, *worth: Worth | None) -> list[FoundUnit]:
        """Return the k units of the highest scores, best first; of equals the last ones.

        Args:
            asked: shape (1, d), of length 1 or 0; None: no value is more similar than another.
            k: how many; fewer come back when there are fewer units.
            worth: for each property what its values add; none for those left out, or None.
        """
        if not self._units or k < 1:
            return []
        bonus = np.zeros(len(self._units))
        for column, adds in zip(self._columns, worth, strict=False):
            if adds is not None:
                bonus += np.array([adds(value) for value in column.values])[column.numbers]
        if asked is not None:
            bonus += self._similarities(asked)[self._columns[0].numbers]
        scores, places = bonus, np.arange(len(bonus))
        if k < len(scores):
            places = np.flatnonzero(scores >= np.partition(scores, -k)[-k])
        places = places[np.lexsort((-places, -scores[places]))][:k]  # of equals the last used first
        return [FoundUnit(int(at), float(scores[at])) for at in places]

    def _similarities(self, asked: Vectors) -> NDArray[np.float64]:
        """Return the similarity of each value: the mean of its nearest rows."""
        rows, question = self._index, np.ascontiguousarray(asked, np.float32)
        found = np.empty(len(self), np.float32)
        # what a search finds, to the bit, without sorting it all
        faiss.fvec_inner_products_ny(  # type: ignore[attr-defined]
            *map(faiss.swig_ptr, (found, question)), rows.get_xb(), rows.d, len(self)
        )
        near: NDArray[np.float64] = np.clip(found, -1.0, 1.0).astype(np.float64)
        if len(near) == len(self._vectors):
            return near
        order = np.lexsort((-near, self._owners))  # a value's rows together, the nearest first
        owners = self._owners[order]
        kept = np.arange(len(order)) - np.searchsorted(owners, owners) < self._nearest
        owners, size = owners[kept], len(self._vectors)
        sums = np.bincount(owners, near[order][kept], size)
        return sums / np.bincount(owners, minlength=size)

    def recalled(self, found: Iterable[FoundUnit]) -> list[Recalled]:
        """Return the units that were found, in the order given."""
        return [Recalled(unit=self._units[one.place], similarity=one.score) for one in found]


class _Column(NamedTuple):
    """A property of all units."""

    values: list[Value]  # those that there are
    numbers: NDArray[np.intp]  # which of them each unit has


def _column(values: Iterable[Value]) -> _Column:
    number: dict[Value, int] = {}
    numbers = [number.setdefault(value, len(number)) for value in values]
    return _Column(list(number), np.array(numbers, np.intp))


def _flat(rows: Vectors) -> Any:
    index = faiss.IndexFlatIP(rows.shape[1])
    index.add(rows)
    return index


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
