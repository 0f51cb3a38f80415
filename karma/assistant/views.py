"""Views of memory: a table of the objects handled last, and a map of the room.

Both show what the agent remembers, which may be out of date, never the room itself.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from karma.household.places import FLOOR
from karma.household.saying import told_place
from karma.household.uses import KNOB
from karma.memory.scene_graph import SceneGraph
from karma.types.memory import Area, MemoryUnit


@dataclass(frozen=True, slots=True, repr=False)
class Memory:
    """Short-term memory at one moment, the last used last."""

    units: tuple[MemoryUnit, ...]
    capacity: int

    def __len__(self) -> int:
        return len(self.units)

    def __iter__(self) -> Iterator[MemoryUnit]:
        return iter(self.units)

    def lines(self) -> list[str]:
        """Return a line for each object."""
        head = f"short-term memory: {len(self)} of {self.capacity} lines"
        return [head, *(f"  {_sentence(unit)}" for unit in self.units)]

    def __repr__(self) -> str:
        return "\n".join(self.lines())


def _sentence(unit: MemoryUnit) -> str:
    states = f": {', '.join(unit.states)}" if unit.states else ""
    return f"{unit.object_type} {told_place(unit.place_id)}{states}"


@dataclass(frozen=True, slots=True, repr=False)
class RoomMap:
    """Long-term memory of a room: places to stand, and the furniture near each."""

    scene: str
    areas: tuple[Area, ...]

    @classmethod
    def of(cls, scene: str, graph: SceneGraph | None) -> "RoomMap":
        """Return the map as it is remembered; an empty one without long-term memory."""
        return cls(scene, graph.areas() if graph else ())

    def types(self) -> tuple[str, ...]:
        """Return the types of furniture on it."""
        kinds = (kind for area in self.areas for kind in area.contains)
        return tuple(sorted({*kinds} - {FLOOR, KNOB}))

    def lines(self) -> list[str]:
        """Return a line for each place to stand."""
        count = sum(len(area.fixtures) for area in self.areas)
        head = f"{self.scene}: {len(self.areas)} places to stand, {count} fixed things"
        return [head, *(f"  {_place(area)}" for area in self.areas)]

    def __repr__(self) -> str:
        return "\n".join(self.lines())


def _place(area: Area) -> str:
    furniture = [kind for kind in area.contains if kind not in (FLOOR, KNOB)]
    return f"{area.name}: {', '.join(furniture) or 'nothing'}"
