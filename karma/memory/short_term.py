"""Short-term memory: one line per object, in a fixed number of lines (KARMA §3.4).

A query is a pure read and no use; the caller remembers a task's units in plan order once the task
is over, and that is the use its policy sees.
"""

import copy
import json
from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import msgspec

from karma.contracts import MemoryUnit, ReplacementPolicy
from karma.files import decode_json

_OPPOSITES = {
    "opened": "closed", "closed": "opened",
    "on": "off", "off": "on",
    "dirty": "cleaned", "cleaned": "dirty",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class MemoryStatistics:
    """What a memory was asked and what it gave up, since it was made or cleared."""

    queries: int = 0
    hits: int = 0
    remembered: int = 0  # calls of `remember`
    left: int = 0  # units that left a full memory, refused newcomers among them

    @property
    def hit_rate(self) -> float | None:
        """Queries answered over queries asked (KARMA §3.6); None when none was asked."""
        return self.hits / self.queries if self.queries else None


@runtime_checkable
class _Discarding(Protocol):
    """A policy that can free a line on request."""

    def discard(self, key: str) -> None: ...


class ShortTermMemory:
    """Units by room and object id, over one replacement policy.

    Args:
        policy: empty; from now on this memory's own.
    """

    def __init__(self, policy: ReplacementPolicy) -> None:
        self._fresh = copy.deepcopy(policy)
        self._policy = policy
        self._units: OrderedDict[str, MemoryUnit] = OrderedDict()  # by last touch
        self._statistics = MemoryStatistics()

    @property
    def capacity(self) -> int:
        """How many units there is room for."""
        return self._policy.capacity

    @property
    def statistics(self) -> MemoryStatistics:
        """The counts so far."""
        return self._statistics

    def remember(self, unit: MemoryUnit) -> MemoryUnit | None:
        """Store a unit, or merge it into the line of its object, as one use of it.

        Returns:
            The unit that left: an older one, or `unit` itself (merged) when it was refused.
        """
        key = line_key(unit.object_id, unit.scene)
        old = self._units.get(key)
        self._units[key] = merged(old or replace(unit, states=()), unit)
        self._units.move_to_end(key)
        left_key = self._policy.touch(key)
        left = None
        if left_key is not None and left_key not in self._policy:
            left = self._units.pop(left_key, None)
        counts = self._statistics
        self._statistics = replace(
            counts, remembered=counts.remembered + 1, left=counts.left + (left is not None)
        )
        return left

    def query(self, name: str, scene: str | None = None) -> MemoryUnit | None:
        """Look a required unit up and count whether it was there; changes no line.

        Args:
            name: an object id, or a type: then its most recently used unit.
            scene: the room that it is in; None: any.
        """
        found = self.find(name, scene)
        counts = self._statistics
        self._statistics = replace(
            counts, queries=counts.queries + 1, hits=counts.hits + (found is not None)
        )
        return found

    def find(self, name: str, scene: str | None = None) -> MemoryUnit | None:
        """Look up as `query` does, without counting."""
        units = self.units(scene)[::-1]
        named = next((unit for unit in units if unit.object_id == name), None)
        return named or next((unit for unit in units if unit.object_type == name), None)

    def units(self, scene: str | None = None) -> tuple[MemoryUnit, ...]:
        """Return all units, or those of one room, least recently used first."""
        units = self._units.values()
        return tuple(unit for unit in units if scene is None or unit.scene == scene)

    def correct(self, unit: MemoryUnit) -> None:
        """Write the line of an object anew, if there is one; that is no use of it."""
        key = line_key(unit.object_id, unit.scene)
        if key in self._units:
            self._units[key] = unit

    def forget(self, object_id: str, scene: str = "") -> bool:
        """Remove the unit of an object that is no more; return whether there was one.

        A policy without `discard` keeps the line reserved until it would have left anyway.
        """
        key = line_key(object_id, scene)
        if self._units.pop(key, None) is None:
            return False
        if isinstance(self._policy, _Discarding):
            self._policy.discard(key)
        return True

    def clear(self) -> None:
        """Start anew: no units, no use counts, no statistics (§3.4, "volatile")."""
        self._policy = copy.deepcopy(self._fresh)
        self._units.clear()
        self._statistics = MemoryStatistics()

    def __contains__(self, key: object) -> bool:
        return key in self._units

    def __len__(self) -> int:
        return len(self._units)

    def to_json(self) -> str:
        """Return the units as a JSON list in the form of Listing 1, least recently used first."""
        return json.dumps([listing(unit, full=True) for unit in self.units()], indent=4)

    @classmethod
    def from_json(
        cls, text: str | bytes, policy: ReplacementPolicy, *, path: str | Path = "short_term_memory"
    ) -> "ShortTermMemory":
        """Return a memory that was told the units of `to_json`, in that order.

        Use counts are not part of the text: to the policy each unit is used once.

        Args:
            text: a JSON list of units.
            policy: empty.
            path: where the text came from, for the error.

        Raises:
            FileError: torn, an unknown key, or a value of the wrong kind.
        """
        memory = cls(policy)
        for line in decode_json(text, list[_Line], path=path):
            memory.remember(line.unit())
        memory._statistics = MemoryStatistics()
        return memory


def line_key(object_id: str, scene: str) -> str:
    """Return what the policy calls an object's line: rooms may have equal ids.

    >>> line_key("Mug|1", "kitchen_1"), line_key("Mug|1", "")
    ('kitchen_1/Mug|1', 'Mug|1')
    """
    return f"{scene}/{object_id}" if scene else object_id


def merged(old: MemoryUnit, new: MemoryUnit) -> MemoryUnit:
    """Return the unit after a newer look: place and picture of `new`, states of both.

    Handled once is handled; states are a history (see `merged_states`).
    """
    states = merged_states(old.states, new.states)
    return replace(new, states=states, handled=old.handled or new.handled)


def merged_states(old: tuple[str, ...], new: tuple[str, ...]) -> tuple[str, ...]:
    """Add states to a history, in the order they came about.

    A state ends when its opposite comes (opened/closed, on/off, dirty/cleaned), and only then:
    a cleaned apple that is sliced stays cleaned. "none" stands only alone.

    >>> merged_states(("dirty",), ("cleaned", "sliced"))
    ('cleaned', 'sliced')
    """
    history = list(dict.fromkeys(old))
    for state in new:
        opposite = _OPPOSITES.get(state)
        if opposite in history:
            history.remove(opposite)
        if state not in history:
            history.append(state)
    if len(history) > 1 and "none" in history:
        history.remove("none")
    return tuple(history)


def listing(unit: MemoryUnit, *, full: bool = False) -> dict[str, Any]:
    """Return a unit with the keys of Listing 1, in its order.

    Args:
        unit: what to write.
        full: also write what the listing leaves out: states, placeId, handled, scene.
    """
    x, y, z = unit.position_m
    line: dict[str, Any] = {
        "objectType": unit.object_type,
        "position": {"x": x, "y": y, "z": z},
        "objectId": unit.object_id,
    }
    if unit.image is not None:
        line["imagePath"] = unit.image
    if full:
        line |= {"states": list(unit.states), "placeId": unit.place_id, "handled": unit.handled}
        line |= {"scene": unit.scene} if unit.scene else {}
    return line


class _Position(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    x: float
    y: float
    z: float


class _Line(msgspec.Struct, frozen=True, rename="camel", forbid_unknown_fields=True):
    """One unit as `to_json` writes it; the paper's own four keys suffice."""

    object_type: str
    position: _Position
    object_id: str
    image_path: str | None = None
    states: tuple[str, ...] = ()
    place_id: str | None = None
    handled: bool = False
    scene: str = ""

    def unit(self) -> MemoryUnit:
        """Return the unit that the line describes."""
        return MemoryUnit(
            object_id=self.object_id,
            object_type=self.object_type,
            position_m=(self.position.x, self.position.y, self.position.z),
            states=self.states,
            place_id=self.place_id,
            handled=self.handled,
            image=self.image_path,
            scene=self.scene,
        )
