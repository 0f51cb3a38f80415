"""The units of a memory beside a flat FAISS index, which is searched exactly.

What is searched is not the units but the distinct values of what tells them apart: a text that many
units share has one place in the index. A unit's score is the similarity of its value, which FAISS
finds, and what the values of its other properties are worth to a question.
"""

from collections.abc import Callable, Hashable, Iterable, Sequence
from operator import is_
from typing import Any, NamedTuple

import faiss
import numpy as np
from numpy.typing import NDArray

from karma.contracts import MemoryUnit, Recalled, Vectors

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
