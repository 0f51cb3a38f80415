"""The objects of one moment: who lies in whom, and the boxes as arrays."""

import math
from collections.abc import Callable, ItemsView, Iterator, Mapping, Sequence, ValuesView
from functools import cached_property
from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from karma.contracts import Vec3
from karma.world.core.metadata import fields
from karma.world.core.rules import STATES, Effects, effects, rules
from karma.world.core.scene import SceneObject

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Vantage(Protocol):
    """What can be seen from one place."""

    def reaches(self, x0: float, z0: float, x1: float, z1: float) -> bool:
        """Return whether something on this ground may change what is seen."""


class Objects(Mapping[str, SceneObject]):
    """Objects by id, in a fixed order; never changed, `changed` gives the next moment."""

    def __init__(self, items: dict[str, SceneObject]) -> None:
        self._items = items

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

        Args:
            changes: by id.
            in_hand: they hang from the hand, before and after, and only moved: such things hide
                nothing, so all that is known of hiding stays.
        """
        if not changes:
            return self
        after = Objects({**self._items, **changes})
        if changes.keys() <= self._items.keys():
            pairs = [(self._items[key], thing) for key, thing in changes.items()]
            touched = _UNSEEN if in_hand else _touched(pairs)
            for name in self.__dict__.keys() & _DEPENDS.keys():
                if not _DEPENDS[name] & touched:
                    after.__dict__[name] = self.__dict__[name]
            self._patch(after, changes, moved=in_hand or "place" in touched)
            if "vantages" in self.__dict__:
                after.vantages = self._untouched(pairs) if touched else self.vantages
        return after

    def _patch(self, after: "Objects", changes: Mapping[str, SceneObject], *, moved: bool) -> None:
        """Carry over the arrays, with new rows where things moved."""
        for name, (build, still) in _PATCHED.items():
            known = self.__dict__.get(name)
            if known is None:
                continue
            if still and not moved:
                after.__dict__[name] = known
                continue
            known = known.copy()
            for object_id, thing in changes.items():
                known[self.rows[object_id]] = build(thing)
            after.__dict__[name] = known

    def _untouched(self, pairs: Sequence[tuple[SceneObject, SceneObject]]) -> dict[Any, Vantage]:
        """Return the vantages that nothing of what changed is near to."""
        boxes = dict.fromkeys(box for pair in pairs for box in map(_ground, pair))
        return {
            key: vantage
            for key, vantage in self.vantages.items()
            if not any(vantage.reaches(*box) for box in boxes)
        }

    @cached_property
    def children(self) -> dict[str, tuple[str, ...]]:
        """What lies directly in each object that holds anything."""
        found: dict[str, list[str]] = {}
        for object_id, thing in self._items.items():
            for parent in thing.parents:
                found.setdefault(parent, []).append(object_id)
        return {parent: tuple(ids) for parent, ids in found.items()}

    @cached_property
    def by_type(self) -> dict[str, tuple[str, ...]]:
        """Ids of each type."""
        found: dict[str, list[str]] = {}
        for object_id, thing in self._items.items():
            found.setdefault(thing.type, []).append(object_id)
        return {kind: tuple(ids) for kind, ids in found.items()}

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
            queue.extend(p for p in self._items[current].parents if p not in queue)
        return tuple(queue[1:])

    def carried(self, object_id: str) -> tuple[str, ...]:
        """Return what moves along when an object is picked up."""
        found = []
        for child in self.inside(object_id):
            if "pickupable" in self._items[child].capabilities and not is_inert(self[child]):
                found.append(child)
        return tuple(found)

    @cached_property
    def effects(self) -> Effects:
        """What the household does to these objects by itself."""
        return effects(self)

    @cached_property
    def rows(self) -> dict[str, int]:
        """Row of each id in the arrays."""
        return {object_id: row for row, object_id in enumerate(self._items)}

    @cached_property
    def origin(self) -> Floats:
        """Positions, shape (n, 3), metres."""
        return np.array([thing.position for thing in self._items.values()]).reshape(-1, 3)

    @cached_property
    def center(self) -> Floats:
        """Box centres, shape (n, 3), metres."""
        return np.array([thing.center for thing in self._items.values()]).reshape(-1, 3)

    @cached_property
    def half(self) -> Floats:
        """Half the box sizes, shape (n, 3), metres."""
        return np.array([thing.size for thing in self._items.values()]).reshape(-1, 3) / 2

    @cached_property
    def low(self) -> Floats:
        """Lower box corners, shape (n, 3), metres."""
        return self.center - self.half

    @cached_property
    def high(self) -> Floats:
        """Upper box corners, shape (n, 3), metres."""
        return self.center + self.half

    @cached_property
    def records(self) -> list[dict[str, Any]]:
        """Metadata of each object, without what depends on agent and contents."""
        return [fields(thing) for thing in self._items.values()]

    @cached_property
    def holders(self) -> list[tuple[int, str]]:
        """Row and id of each receptacle."""
        return [
            (row, thing.id)
            for row, thing in enumerate(self._items.values())
            if "receptacle" in thing.capabilities
        ]

    @cached_property
    def marks(self) -> dict[str, Any]:
        """What others have worked out from what stands where; forgotten when that changes."""
        return {}

    @cached_property
    def vantages(self) -> dict[Any, Vantage]:
        """What view.py has found out about places to look from; goes when things near it change."""
        return {}

    @cached_property
    def solid(self) -> tuple[Floats, Floats]:
        """Lower and upper corners of the part of each box that hides what is behind it."""
        table = rules().view.solid
        whole = (0.0, 1.0)
        part = np.array([table.get(t.type, whole) for t in self._items.values()]).reshape(-1, 2)
        low, high = self.low.copy(), self.high.copy()
        height = high[:, 1] - low[:, 1]
        low[:, 1], high[:, 1] = low[:, 1] + part[:, 0] * height, low[:, 1] + part[:, 1] * height
        return low, high

    @cached_property
    def inert(self) -> Flags:
        """Whether each object has been replaced by its pieces, shape (n,)."""
        return np.array([is_inert(thing) for thing in self._items.values()], dtype=bool)

    @cached_property
    def hidden(self) -> Flags:
        """Whether each object lies in something closed, or is no longer there, shape (n,)."""
        closes = rules().view.hides_when_closed
        never = rules().view.never
        shut = {
            object_id
            for kind in closes
            for object_id in self.by_type.get(kind, ())
            if "openable" in self[object_id].capabilities and self[object_id].openness <= 0
        }
        found = self.inert.copy()
        for object_id, thing in self._items.items():
            if thing.type in never:
                found[self.rows[object_id]] = True
        for container in shut:
            for child in self.inside(container):
                if container in self._nearest(child):
                    found[self.rows[child]] = True
        return found

    def _nearest(self, object_id: str) -> list[str]:
        """Return the chain of first parents."""
        chain = [object_id]
        while (parents := self[chain[-1]].parents) and parents[0] not in chain:
            chain.append(parents[0])
        return chain[1:]

    @cached_property
    def blocks(self) -> Flags:
        """[t, o]: whether object o can hide object t, shape (n, n).

        Never itself, its contents, what it lies in, or a box that its own centre is inside of
        (boxes are coarser than meshes there).
        """
        center, low, high = self.center[:, None], self.low[None] - 0.05, self.high[None] + 0.05
        found: Flags = ~np.all((center >= low) & (center <= high), axis=2)
        found &= ~self.inert[None]
        for object_id, row in self.rows.items():
            if self[object_id].parents:
                others = [self.rows[other] for other in self.around(object_id)]
                found[row, others] = False
                found[others, row] = False
        for object_id, row in self.rows.items():
            for holder in self._open_holders(object_id):
                found[row, self._built_round(self.rows[holder])] = False
        np.fill_diagonal(found, False)
        return found

    def _open_holders(self, object_id: str) -> list[str]:
        """Return the open doors and drawers that an object lies behind."""
        return [
            other
            for other in self.around(object_id)
            if (thing := self.get(other)) is not None
            and "openable" in thing.capabilities
            and "pickupable" not in thing.capabilities
            and thing.openness > 0
            and object_id not in self.around(other)
        ]

    def _built_round(self, row: int) -> Flags:
        """Return the fixed boxes that adjoin a container: an open one shows its contents past them.

        Drawers do not slide out and doors do not swing here, so the worktop over an open drawer
        would hide what a robot in front of the real one sees.
        """
        touch: Flags = np.all(
            (self.low <= self.high[row] + 0.06) & (self.high >= self.low[row] - 0.06), axis=1
        )
        return touch & self._fixed

    @cached_property
    def _fixed(self) -> Flags:
        free = {"pickupable", "moveable"}
        return np.array([not free & set(thing.capabilities) for thing in self.values()])


# What of the objects each cached property depends on; a change of anything else leaves it true.
_DEPENDS: Mapping[str, frozenset[str]] = {
    "rows": frozenset(),
    "by_type": frozenset(),
    "holders": frozenset(),
    "_fixed": frozenset(),
    "children": frozenset({"parents"}),
    "solid": frozenset({"place"}),
    "inert": frozenset({"inert"}),
    "effects": frozenset({"parents", "inert", "state"}),
    "hidden": frozenset({"parents", "inert", "open"}),
    "blocks": frozenset({"place", "parents", "inert", "open", "held"}),
    "marks": frozenset({"place", "parents", "inert", "held"}),
}
_UNSEEN: frozenset[str] = frozenset()  # what a move of something in the hand touches of these
_PATCHED: Mapping[str, tuple[Callable[[SceneObject], Any], bool]] = {
    "origin": (lambda thing: thing.position, True),
    "center": (lambda thing: thing.center, True),
    "half": (lambda thing: np.array(thing.size) / 2, True),
    "low": (lambda thing: np.array(thing.center) - np.array(thing.size) / 2, True),
    "high": (lambda thing: np.array(thing.center) + np.array(thing.size) / 2, True),
    "records": (fields, False),
}  # property -> (a row from an object, whether it stays true while nothing moves)


def _touched(pairs: Sequence[tuple[SceneObject, SceneObject]]) -> set[str]:
    """Return what of some objects has changed, in the words of `_DEPENDS`."""
    return {
        aspect
        for before, after in pairs
        for aspect, changed in (
            ("place", before.center != after.center or before.size != after.size),
            ("place", before.position != after.position),
            ("parents", before.parents != after.parents),
            ("inert", is_inert(before) != is_inert(after)),
            ("open", (before.openness > 0) != (after.openness > 0)),
            ("held", before.is_picked_up != after.is_picked_up),
            ("state", any(getattr(before, key) != getattr(after, key) for key in STATES)),
        )
        if changed
    }


def _ground(thing: SceneObject) -> tuple[float, float, float, float]:
    """Return the ground under a box: x0, z0, x1, z1."""
    (x, _, z), (long, _, wide) = thing.center, thing.size
    return (x - long / 2, z - wide / 2, x + long / 2, z + wide / 2)


def is_inert(thing: SceneObject) -> bool:
    """Return whether an object is only kept for its id: sliced, or broken to pieces."""
    return thing.is_sliced or (thing.is_broken and shatters(thing))


def shatters(thing: SceneObject) -> bool:
    """Return whether only pieces are left of an object that breaks; screens and panes stay."""
    return "pickupable" in thing.capabilities and thing.type not in rules().fragile.stays_whole


def moved(thing: SceneObject, by: Vec3) -> SceneObject:
    """Return the object shifted by a vector."""
    return msgspec.structs.replace(
        thing,
        position=_add(thing.position, by),
        center=_add(thing.center, by),
        corners=None if thing.corners is None else tuple(_add(c, by) for c in thing.corners),
    )


def turned(thing: SceneObject, degrees: float, about: Vec3) -> SceneObject:
    """Return the object turned round a vertical axis; clockwise seen from above, as yaw."""
    if degrees % 360 == 0:
        return thing
    x, y, z = thing.rotation
    change: dict[str, Any] = {
        "rotation": (x, (y + degrees) % 360, z),
        "position": _turn(thing.position, degrees, about),
        "center": _turn(thing.center, degrees, about),
    }
    if thing.corners is not None:
        corners = tuple(_turn(corner, degrees, about) for corner in thing.corners)
        low = [min(c[axis] for c in corners) for axis in range(3)]
        high = [max(c[axis] for c in corners) for axis in range(3)]
        change["corners"] = corners
        change["center"] = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
        change["size"] = tuple(b - a for a, b in zip(low, high, strict=True))
    elif round(degrees / 90) % 2:
        change["size"] = (thing.size[2], thing.size[1], thing.size[0])
    return msgspec.structs.replace(thing, **change)


def bottom(thing: SceneObject) -> float:
    """Return the height of the box's lower side, metres."""
    return thing.center[1] - thing.size[1] / 2


def top(thing: SceneObject) -> float:
    """Return the height of the box's upper side, metres."""
    return thing.center[1] + thing.size[1] / 2


def _add(a: Vec3, b: Vec3) -> Vec3:
    return (round(a[0] + b[0], 6), round(a[1] + b[1], 6), round(a[2] + b[2], 6))


def _turn(point: Vec3, degrees: float, about: Vec3) -> Vec3:
    sine, cosine = heading(degrees)
    x, z = point[0] - about[0], point[2] - about[2]
    return (about[0] + x * cosine + z * sine, point[1], about[2] + z * cosine - x * sine)


def heading(yaw_deg: float) -> tuple[float, float]:
    """Return (x, z) of the direction a yaw points to; exact for multiples of 90.

    >>> heading(90)
    (1.0, 0.0)
    """
    quarter, rest = divmod(yaw_deg % 360, 90)
    if rest == 0:
        return [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][int(quarter)]
    return math.sin(math.radians(yaw_deg)), math.cos(math.radians(yaw_deg))
