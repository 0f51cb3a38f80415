"""The agent's knowledge of one room, as its skills ask for it."""

from collections.abc import Sequence
from dataclasses import dataclass

from karma.agent.seeing.perceive import pose_of
from karma.household.ids import type_of
from karma.household.pieces import goes_by
from karma.household.places import HAND
from karma.memory.scene_graph import SceneGraph
from karma.types.memory import Area, Known, MemoryUnit
from karma.types.roles import World


@dataclass(slots=True)
class RoomKnowledge:
    """Units of short-term memory by name, then the map, then the receptacles of units."""

    world: World
    graph: SceneGraph | None
    units: Sequence[MemoryUnit] = ()

    def where(self, name: str) -> Known | None:
        """Return the best known place of a name, or None if it is unknown."""
        for unit in self.units:
            if goes_by(name, unit.object_id, unit.object_type):
                return Known(
                    object_id=unit.object_id,
                    object_type=unit.object_type,
                    position_m=unit.position_m,
                    place_id=None if unit.place_id == HAND else unit.place_id,
                )
        near = pose_of(self.world.last_event).position_m
        if self.graph and (found := self.graph.known(name, near=near)):
            return found
        for unit in self.units:
            if unit.place_id == name != HAND:
                return Known(object_id=name, object_type=type_of(name), position_m=unit.position_m)
        return None

    def areas(self) -> tuple[Area, ...]:
        """Return the area nodes; () without long-term memory."""
        return self.graph.areas() if self.graph else ()
