"""Short-term memory: one line per object, in a fixed number of lines (KARMA §3.4).

Looking a unit up is no use of it; the caller remembers a task's units in plan order once the task
is over, and that is the use its policy sees.
"""

from collections import OrderedDict
from dataclasses import replace
from typing import Any

from karma.household.states import ENDS
from karma.types.memory import MemoryUnit
from karma.types.roles import ReplacementPolicy


class ShortTermMemory:
    """Units by room and object id, over one replacement policy.

    Args:
        policy: empty; from now on this memory's own.
    """

    def __init__(self, policy: ReplacementPolicy) -> None:
        self._policy = policy
        self._units: OrderedDict[str, MemoryUnit] = OrderedDict()  # by last touch

    @property
    def capacity(self) -> int:
        """How many units there is room for."""
        return self._policy.capacity

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
        if left_key is None or left_key in self._policy:
            return None
        return self._units.pop(left_key, None)

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
        """Remove the unit of an object that is no more; return whether there was one."""
        key = line_key(object_id, scene)
        if self._units.pop(key, None) is None:
            return False
        self._policy.discard(key)
        return True

    def __contains__(self, key: object) -> bool:
        return key in self._units

    def __len__(self) -> int:
        return len(self._units)


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
        opposite = ENDS.get(state)
        if opposite in history:
            history.remove(opposite)
        if state not in history:
            history.append(state)
    if len(history) > 1 and "none" in history:
        history.remove("none")
    return tuple(history)


def listing(unit: MemoryUnit) -> dict[str, Any]:
    """Return a unit with the keys of Listing 1, in its order."""
    x, y, z = unit.position_m
    line: dict[str, Any] = {
        "objectType": unit.object_type,
        "position": {"x": x, "y": y, "z": z},
        "objectId": unit.object_id,
    }
    if unit.image is not None:
        line["imagePath"] = unit.image
    return line
