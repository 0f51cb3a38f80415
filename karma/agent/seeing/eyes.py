"""How the agent sees: by the simulator's metadata, or as a plug-in of `karma.perceptions` does."""

import math
from collections.abc import Collection, Container, Iterable, Mapping
from typing import Any, Protocol

from karma import registry
from karma.agent.seeing import perceive
from karma.types.observation import Observation, SeenObject
from karma.types.roles import Event, VisionModel

METADATA = "metadata"  # the default perception
SWITCH_M = 1.0  # how far a switch may be from what it switches, and a tap from what it is over


class Eyes(Protocol):
    """What turns an event into what the agent knows."""

    def observe(
        self, event: Event, *, touched: Collection[str] = (), known: Container[str] = ()
    ) -> Observation:
        """Return what the agent learns from one action; arguments as in `perceive.observe`."""

    def aim(self, object_id: str) -> Mapping[str, Any]:
        """Return the arguments by which an action means an object in view."""


class Perception(Protocol):
    """The eyes of one episode, made as `made(vision, detail)` (group `karma.perceptions`)."""

    def eyes(self, room: str, instruction: str) -> Eyes:
        """Return the eyes for a room and an instruction."""

    def fresh(self) -> Eyes:
        """Return eyes that have seen nothing yet, for the first tour of a room."""

    def map_file(self, room: str, seed: int) -> str | None:
        """Return the file name of a room's map, or None if the room is explored each time."""


class MetadataEyes:
    """Eyes that see what the simulator reports of objects in view."""

    def observe(
        self, event: Event, *, touched: Collection[str] = (), known: Container[str] = ()
    ) -> Observation:
        """Return the agent's share of the event's metadata."""
        return perceive.observe(event, touched=touched, known=known)

    def aim(self, object_id: str) -> Mapping[str, Any]:
        """Return the object's id."""
        return {"objectId": object_id}


class MetadataPerception:
    """The simulator's metadata in every room."""

    def __init__(self, vision: VisionModel, detail: str = "") -> None:
        """Ignore the vision model: states are metadata too."""

    def eyes(self, room: str, instruction: str) -> Eyes:
        """Return eyes that read metadata."""
        return MetadataEyes()

    def fresh(self) -> Eyes:
        """Return eyes that read metadata."""
        return MetadataEyes()

    def map_file(self, room: str, seed: int) -> str | None:
        """Return the same file name for all seeds: furniture stays where it is."""
        return f"{room}.json"


def perception_of(name: str, vision: VisionModel) -> Perception:
    """Make the perception of an episode from its name, and a detail after ":"."""
    kind, _, detail = name.partition(":")
    made: Perception = registry.load("perceptions", kind)(vision, detail)
    return made


def nearest(sight: SeenObject, kind: str, others: Iterable[SeenObject]) -> SeenObject | None:
    """Return the nearest object of a type within `SWITCH_M`, or None."""
    near = [
        (math.dist(sight.box_center_m, other.box_center_m), other.object_id, other)
        for other in others
        if other.object_type == kind
    ]
    gap, _, found = min(near, default=(math.inf, "", sight))
    return found if gap <= SWITCH_M else None
