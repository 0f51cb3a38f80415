"""Keep the objects of one moment, and hand on to the next what is known of them and still true."""

from collections.abc import Callable, ItemsView, Iterable, Iterator, Mapping, Sequence, ValuesView
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from karma.world.core.boxes import BoxArrays
from karma.world.core.rules import STATES
from karma.world.core.scene import SceneObject
from karma.world.core.thing import is_inert, is_movable

T = TypeVar("T")
Aspect = Literal["place", "parents", "inert", "open", "held", "state"]


@dataclass(frozen=True, slots=True)
class Change:
    """What became of some objects from one moment to the next; none is new."""

    pairs: Sequence[tuple[SceneObject, SceneObject]]  # before, after
    aspects: frozenset[Aspect]  # of them that differ
    moved: bool

    @classmethod
    def between(
        cls, before: "Objects", after: Mapping[str, SceneObject], *, in_hand: bool
    ) -> "Change":
        """Return how some objects differ; a move in the hand counts for no aspect."""
        pairs = [(before[object_id], thing) for object_id, thing in after.items()]
        if in_hand:
            return cls(pairs, frozenset(), True)
        aspects = frozenset(aspect for pair in pairs for aspect in _differing(*pair))
        return cls(pairs, aspects, "place" in aspects)


def _differing(before: SceneObject, after: SceneObject) -> Iterator[Aspect]:
    if before.center != after.center or before.size != after.size:
        yield "place"
    if before.position != after.position:
        yield "place"
    if before.parents != after.parents:
        yield "parents"
    if is_inert(before) != is_inert(after):
        yield "inert"
    if (before.openness > 0) != (after.openness > 0):
        yield "open"
    if before.is_picked_up != after.is_picked_up:
        yield "held"
    if any(getattr(before, key) != getattr(after, key) for key in STATES):
        yield "state"


class Derived(Generic[T]):
    """A function of the objects: its result is kept with them, and carried on while it is true.

    As an attribute of `Objects` it reads like a property. It depends on `aspects` of the objects:
    a change of anything else leaves it true. `patch` brings it up to date instead, from the objects
    before, the result and the change.
    """

    def __init__(
        self,
        build: "Callable[[Objects], T]",
        *aspects: Aspect,
        patch: "Callable[[Objects, T, Change], T] | None" = None,
    ) -> None:
        self._build, self._aspects, self._patch = build, frozenset(aspects), patch
        self.__doc__ = build.__doc__

    def __call__(self, objects: "Objects") -> T:
        """Return the result for these objects."""
        known = objects.known
        if self not in known:
            known[self] = self._build(objects)
        found: T = known[self]
        return found

    def __get__(self, objects: "Objects", owner: type) -> T:
        return self(objects)

    def carry(self, before: "Objects", after: "Objects", change: Change) -> None:
        """Hand the result on to the objects of the next moment, if it holds there."""
        if self._patch is not None:
            after.known[self] = self._patch(before, before.known[self], change)
        elif not self._aspects & change.aspects:
            after.known[self] = before.known[self]


def derived(*aspects: Aspect) -> "Callable[[Callable[[Objects], T]], Derived[T]]":
    """Return the decorator that keeps a function's result with the objects, see `Derived`."""
    return lambda build: Derived(build, *aspects)


def per_object(make: Callable[[SceneObject], T]) -> Derived[list[T]]:
    """Return a function of each object by itself, as a list in their order."""

    def patch(before: "Objects", known: list[T], change: Change) -> list[T]:
        found = known.copy()
        for _, thing in change.pairs:
            found[before.rows[thing.id]] = make(thing)
        return found

    return Derived(lambda objects: [make(thing) for thing in objects.values()], patch=patch)


def _by_type(objects: "Objects") -> dict[str, tuple[str, ...]]:
    found: dict[str, list[str]] = {}
    for object_id, thing in objects.items():
        found.setdefault(thing.type, []).append(object_id)
    return {kind: tuple(ids) for kind, ids in found.items()}


def _moved_rows(before: "Objects", known: BoxArrays, change: Change) -> BoxArrays:
    if not change.moved:
        return known
    return known.replaced({before.rows[thing.id]: thing for _, thing in change.pairs})


class Objects(Mapping[str, SceneObject]):
    """Objects by id, in a fixed order; never changed, `changed` gives the next moment."""

    rows = Derived(lambda objects: {object_id: row for row, object_id in enumerate(objects)})
    by_type = Derived(_by_type)  # ids of each type
    boxes = Derived(lambda objects: BoxArrays.of(objects.values()), patch=_moved_rows)
    containment = Derived(lambda objects: Containment(objects.values()), "parents")

    def __init__(self, items: dict[str, SceneObject]) -> None:
        self._items = items
        self.known: dict[Derived[Any], Any] = {}  # results

    def __getitem__(self, object_id: str) -> SceneObject:
        return self._items[object_id]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def items(self) -> ItemsView[str, SceneObject]:
        """Ids with objects."""
        return self._items.items()

    def values(self) -> ValuesView[SceneObject]:
        """All objects."""
        return self._items.values()

    def changed(self, changes: Mapping[str, SceneObject], *, in_hand: bool = False) -> "Objects":
        """Return the objects with some replaced or added; keeps what is known and still true.

        `in_hand`: they hang from the hand, before and after, and only moved. Such things hide
        nothing, so all that is known of hiding stays.
        """
        if not changes:
            return self
        after = Objects({**self._items, **changes})
        if changes.keys() <= self._items.keys():
            change = Change.between(self, changes, in_hand=in_hand)
            for part in tuple(self.known):
                part.carry(self, after, change)
        return after

    def of_types(self, *kinds: str) -> list[SceneObject]:
        """Return the objects of some types, type by type."""
        return [self._items[one] for kind in kinds for one in self.by_type.get(kind, ())]

    def carried(self, object_id: str) -> tuple[str, ...]:
        """Return what moves along when an object is picked up."""
        return tuple(c for c in self.containment.inside(object_id) if is_movable(self._items[c]))


class Containment:
    """The parents and children of each object, and of those in turn."""

    def __init__(self, things: Iterable[SceneObject]) -> None:
        self.parents = {thing.id: thing.parents for thing in things}
        found: dict[str, list[str]] = {}
        for object_id, parents in self.parents.items():
            for parent in parents:
                found.setdefault(parent, []).append(object_id)
        self.children = {parent: tuple(ids) for parent, ids in found.items()}  # direct ones

    def inside(self, object_id: str) -> tuple[str, ...]:
        """Return everything in an object, also within other things; each once, not itself."""
        found = dict.fromkeys([object_id])
        queue = [object_id]
        for current in queue:
            fresh = [child for child in self.children.get(current, ()) if child not in found]
            found.update(dict.fromkeys(fresh))
            queue.extend(fresh)
        return tuple(queue[1:])

    def around(self, object_id: str) -> tuple[str, ...]:
        """Return everything an object lies in, the nearest first; each once, not itself."""
        queue = [object_id]
        for current in queue:
            queue.extend(parent for parent in self.parents[current] if parent not in queue)
        return tuple(queue[1:])

    def nearest(self, object_id: str) -> list[str]:
        """Return the chain of first parents, the object left out."""
        chain = [object_id]
        while (parents := self.parents[chain[-1]]) and parents[0] not in chain:
            chain.append(parents[0])
        return chain[1:]
