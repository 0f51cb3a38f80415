"""One moment's objects, by what a name covers and what holds what; and what was done to them.

Deeds, as ALFRED keeps them, per object, for ever:

* cleaned: it was in a basin under running water (`Truth.washed`).
* heated: Hot at some moment, or once in a running microwave.
* cooled: it was in a fridge when that was shut, or turned Cold elsewhere.

States, though a temperature fades within seconds in AI2-THOR:

* hot / cold: heated, or Cold at some moment or in a shut fridge; the later of the two counts.

A new slice has all that is so of the whole that it was cut from.
"""

from collections.abc import Sequence

from karma.contracts import TrueObject, Truth
from karma.household.ids import is_id, is_part, type_of, whole_id
from karma.household.pieces import is_piece
from karma.household.places import FLOOR
from karma.household.uses import FRIDGE, covers


class ObjectIndex:
    """Finds the objects of one moment."""

    def __init__(self, truth: Truth) -> None:
        self.by_id = {thing.object_id: thing for thing in truth.objects}
        self.held = truth.held_ids
        things = self.by_id.items()
        self._replaced = {whole_id(key) for key, thing in things if is_piece(thing.object_type)}
        self._holders: dict[str, frozenset[str]] = {}

    def named(self, names: Sequence[str]) -> list[TrueObject]:
        """Return the objects that types or ids cover; a cut whole gives way to its pieces."""
        return [
            thing
            for key, thing in self.by_id.items()
            if key not in self._replaced and any(_covers(name, thing) for name in names)
        ]

    def holders(self, thing: TrueObject) -> frozenset[str]:
        """Return what a thing is in or on, also through receptacles that can be carried."""
        if thing.object_id not in self._holders:
            self._holders[thing.object_id] = frozenset(self._climb(thing))
        return self._holders[thing.object_id]

    def is_carried(self, object_id: str) -> bool:
        """Return whether something is in the hand, or in what is there."""
        thing = self.by_id.get(object_id)
        return thing is not None and bool(self.held & {object_id, *self.holders(thing)})

    def _climb(self, thing: TrueObject) -> set[str]:
        found: set[str] = set()
        todo = [thing]
        while todo:
            for parent in todo.pop().parent_ids:
                if parent in found:
                    continue
                found.add(parent)
                if parent in self.by_id and self.by_id[parent].pickupable:
                    todo.append(self.by_id[parent])
        return found


def _covers(name: str, thing: TrueObject) -> bool:
    """Return whether a name means a thing; ALFRED's ids keep words that are no types any more."""
    if is_id(name):
        return thing.object_id == name or is_part(thing.object_id, of=name)
    return covers(name, thing.object_type) or name == type_of(thing.object_id)


DEEDS = ("cleaned", "heated", "cooled")
TEMPERATURES = ("hot", "cold")


class RememberedDeeds:
    """Remembers what was done to things, over the events of one task."""

    def __init__(self) -> None:
        self._done: dict[str, set[str]] = {deed: set() for deed in DEEDS}
        self._now: dict[str, set[str]] = {state: set() for state in TEMPERATURES}
        self._inherited: dict[str, set[str]] = {}  # of a slice: what was done to its whole
        self._ids: set[str] = set()
        self._cold: set[str] = set()  # at the event before
        self._shut_in: set[str] = set()  # likewise: in fridges that are shut

    def update(self, truth: Truth) -> None:
        """Take in one event, in order."""
        ids = {thing.object_id for thing in truth.objects}
        for new in ids - self._ids:
            self._cut_off(new)
        self._ids = ids
        cold = {one.object_id for one in truth.objects if one.temperature == "Cold"}
        cold -= {one.object_id for one in truth.objects if one.object_type == FLOOR}
        self._done["cleaned"] |= truth.washed
        self._done["heated"] |= truth.heated
        self._done["cooled"] |= self._newly_cooled(truth, cold)
        self._become("hot", "cold", set(truth.heated))
        self._become("cold", "hot", cold | truth.cooled)
        self._cold = cold

    def done(self, object_id: str, deed: str, *, itself: bool = False) -> bool:
        """Return whether a deed was done to a thing, or to the whole before it was cut off.

        With `itself` what was done to the whole does not count.
        """
        inherited = not itself and deed in self._inherited.get(object_id, ())
        return inherited or object_id in self._done[deed]

    def is_now(self, object_id: str, temperature: str) -> bool:
        """Return whether a thing is of one of the `TEMPERATURES`."""
        return object_id in self._now[temperature]

    def _cut_off(self, new: str) -> None:
        whole = whole_id(new)
        if whole in self._ids:
            self._inherited[new] = {deed for deed in DEEDS if self.done(whole, deed)}
        for ids in self._now.values():
            if whole in ids:
                ids.add(new)

    def _newly_cooled(self, truth: Truth, cold: set[str]) -> set[str]:
        """Return what was shut in a fridge just now, and what turned cold in none."""
        index = ObjectIndex(truth)
        fridges = {one.object_id for one in truth.objects if one.object_type == FRIDGE}
        shut = {key for key in fridges if "opened" not in index.by_id[key].states}
        chilled = {key: index.holders(index.by_id[key]) for key in cold | truth.cooled}
        turned = {key for key in cold - self._cold if not chilled[key] & fridges}
        found = turned | (truth.cooled - self._shut_in)
        self._shut_in = {one.object_id for one in truth.objects if index.holders(one) & shut}
        return found

    def _become(self, state: str, instead_of: str, ids: set[str]) -> None:
        self._now[state] |= ids
        self._now[instead_of] -= ids
