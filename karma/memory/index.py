"""The units of a memory in a FAISS index that is kept, and searched exactly.

What is searched is not the units but the distinct values of what tells them apart: a text that many
units share has one place in the index, whatever the number of units. Every unit is a few small
numbers, one for each of its properties, and its score a sum of what the values of these properties
are worth to a question: the similarity of the first, which FAISS finds, and bonuses.
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
_FIRST, _MORE = 64, 8  # rows that FAISS is asked for, and by how much more if they do not decide


class FoundUnit(NamedTuple):
    """A unit that a question found."""

    place: int  # in the units that were followed last
    score: float


class UnitIndex:
    """A FAISS index over the units that were last asked about, changed as they come and go.

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
        self._forget()

    def _forget(self) -> None:
        self._columns = [_Column() for _ in self._properties]
        self._units: tuple[MemoryUnit, ...] = ()
        self._slots: dict[int, int] = {}  # by the identity of units, which `_units` keeps alive
        self._free: list[int] = []
        self._codes = np.zeros((0, len(self._properties)), dtype=np.int32)
        self._order: NDArray[np.intp] = np.zeros(0, dtype=np.intp)  # slots of `_units`
        self._index: Any = None
        self._row_counts = np.zeros(0, dtype=np.intp)  # by the number of a searched value

    def __len__(self) -> int:
        """Return how many vectors FAISS holds."""
        return int(self._index.ntotal) if self._index is not None else 0

    def follow(self, units: Sequence[MemoryUnit]) -> None:
        """Take in the units that are new and let go of those that are not there any more.

        Where all are new it is another memory, and nothing is kept: what is asked of an embedder
        for one episode depends on no other.
        """
        units = tuple(units)
        if len(units) == len(self._units) and all(map(is_, units, self._units)):
            return
        there = set(map(id, units))
        if there.isdisjoint(self._slots):
            self._forget()
        self._add({id(unit): unit for unit in units if id(unit) not in self._slots})
        self._remove([key for key in self._slots if key not in there])
        slots = map(self._slots.__getitem__, map(id, units))
        self._order = np.fromiter(slots, dtype=np.intp, count=len(units))
        self._units = units

    def best(self, asked: Vectors | None, k: int, *worth: Worth | None) -> list[FoundUnit]:
        """Return the k units of the highest scores, best first; of equals the last ones.

        Args:
            asked: shape (1, d), of length 1 or 0; None: no value is more similar than another.
            k: how many; fewer come back when there are fewer units.
            worth: for each property what its values add; none for those left out, or None.
        """
        if not self._units or k < 1:
            return []
        codes = self._codes[self._order]
        bonus = np.zeros(len(codes))
        for at, (column, adds) in enumerate(zip(self._columns, worth, strict=False)):
            if adds is not None:
                bonus += column.table(adds)[codes[:, at]]
        if asked is None:
            return self._top(bonus, k)
        return self._top(self._scores(asked, codes[:, 0], bonus, k), k)

    def _scores(
        self, asked: Vectors, values: NDArray[np.int32], bonus: NDArray[np.float64], k: int
    ) -> NDArray[np.float64]:
        """Return each unit's score, or -inf where it surely is not among the best k.

        A row that FAISS has not named is no more similar than the last one that it has. So there is
        a limit to what the values of these rows are worth, and it is enough to have k units that
        score more than that and the largest bonus together.
        """
        wanted = min(_FIRST, len(self))
        while True:
            found, numbers = self._index.search(asked, wanted)
            similarity, limit = self._similarities(np.clip(found[0], -1.0, 1.0), numbers[0])
            scores = similarity[values] + bonus
            if wanted == len(self) or np.count_nonzero(scores > limit + bonus.max()) >= k:
                return scores
            wanted = min(wanted * _MORE, len(self))

    def _similarities(
        self, found: NDArray[np.float32], numbers: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], float]:
        """Return the similarity of each value, -inf if not yet known, and the limit of these.

        Args:
            found: similarities of the nearest rows, the best first.
            numbers: of their values.
        """
        counted = np.minimum(self._row_counts[: self._columns[0].size], self._nearest)
        order = np.argsort(numbers, kind="stable")
        grouped = numbers[order]
        rank = np.arange(len(order)) - np.searchsorted(grouped, grouped)
        kept = order[rank < self._nearest]
        sums, there = np.zeros(len(counted)), np.zeros(len(counted), dtype=np.intp)
        np.add.at(sums, numbers[kept], found[kept])
        np.add.at(there, numbers[kept], 1)
        unknown = there < counted
        most = (sums + (counted - there) * float(found[-1])) / np.maximum(counted, 1)
        limit = float(most[unknown].max()) if unknown.any() else -np.inf
        return np.where(unknown, -np.inf, most), limit

    def recalled(self, found: Iterable[FoundUnit]) -> list[Recalled]:
        """Return the units that were found, in the order given."""
        return [Recalled(unit=self._units[one.place], similarity=one.score) for one in found]

    def _top(self, scores: NDArray[np.float64], k: int) -> list[FoundUnit]:
        if k < len(scores):
            least = np.partition(scores, len(scores) - k)[len(scores) - k]
            places = np.flatnonzero(scores >= least)
        else:
            places = np.arange(len(scores))
        places = places[np.lexsort((-places, -scores[places]))][:k]  # of equals the last used first
        return [FoundUnit(int(at), float(scores[at])) for at in places]

    # ------------------------------------------------------------- what comes and goes

    def _add(self, units: dict[int, MemoryUnit]) -> None:
        fresh: dict[int, Value] = {}  # new values of the first property, by their numbers
        self._make_room(len(units))
        for key, unit in units.items():
            slot = self._free.pop()
            self._slots[key] = slot
            for at, (column, value_of) in enumerate(
                zip(self._columns, self._properties, strict=True)
            ):
                value = value_of(unit)
                number, is_new = column.take(value)
                self._codes[slot, at] = number
                if is_new and at == 0:
                    fresh[number] = value
        if not fresh:
            return
        rows = [self._rows(value) for value in fresh.values()]
        counts = [len(some) for some in rows]
        numbers = np.fromiter(fresh, dtype=np.int64)
        lacking = max(self._columns[0].size - len(self._row_counts), 0)
        self._row_counts = np.append(self._row_counts, np.zeros(lacking, dtype=np.intp))
        self._row_counts[numbers] = counts
        if self._index is None:
            self._index = faiss.IndexIDMap(faiss.IndexFlatIP(rows[0].shape[1]))
        self._index.add_with_ids(np.concatenate(rows), np.repeat(numbers, counts))

    def _remove(self, keys: Sequence[int]) -> None:
        unused = []
        for key in keys:
            slot = self._slots.pop(key)
            self._free.append(slot)
            for at, column in enumerate(self._columns):
                number = int(self._codes[slot, at])
                if column.release(number) and at == 0:
                    unused.append(number)
        if unused:
            self._row_counts[unused] = 0
            self._index.remove_ids(np.array(unused, dtype=np.int64))

    def _make_room(self, more: int) -> None:
        lacking = more - len(self._free)
        if lacking <= 0:
            return
        old = len(self._codes)
        added = max(lacking, old)
        room = np.zeros((added, len(self._properties)), dtype=np.int32)
        self._codes = np.concatenate([self._codes, room])
        self._free.extend(range(old + added - 1, old - 1, -1))


class _Column:
    """The distinct values of one property, numbered as long as a unit has them."""

    def __init__(self) -> None:
        self._numbers: dict[Value, int] = {}
        self._values: list[Value] = []
        self._uses: list[int] = []
        self._free: list[int] = []

    @property
    def size(self) -> int:
        """One more than the largest number."""
        return len(self._values)

    def take(self, value: Value) -> tuple[int, bool]:
        """Return the number of a value that one more unit has, and whether it is the first."""
        number = self._numbers.get(value)
        if number is not None:
            self._uses[number] += 1
            return number, False
        if self._free:
            number = self._free.pop()
            self._values[number], self._uses[number] = value, 1
        else:
            number = len(self._values)
            self._values.append(value)
            self._uses.append(1)
        self._numbers[value] = number
        return number, True

    def release(self, number: int) -> bool:
        """Let one unit go; return whether no other has the value."""
        self._uses[number] -= 1
        if self._uses[number]:
            return False
        del self._numbers[self._values[number]]
        self._free.append(number)
        return True

    def table(self, worth: Worth) -> NDArray[np.float64]:
        """Return what each value is worth, by its number."""
        found = np.zeros(self.size)
        for value, number in self._numbers.items():
            found[number] = worth(value)
        return found
