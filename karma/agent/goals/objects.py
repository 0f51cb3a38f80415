"""One moment's objects: by id, by what a name covers, and what holds what."""

from collections.abc import Sequence

from karma.contracts import TrueObject, Truth
from karma.household.ids import is_id, is_part, type_of, whole_id
from karma.household.pieces import is_piece
from karma.household.uses import covers


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
