"""What baselines share: what an instruction may cost, what usually lies where, what is asked."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from karma.agent.body.sightings import known
from karma.agent.body.skills import Skills
from karma.agent.options import settings_of
from karma.agent.seeing.perceive import place_of
from karma.contracts import (
    Area,
    Experience,
    Known,
    PlanRequest,
    Resources,
    SceneRef,
    SeenObject,
    Vec3,
    World,
)
from karma.files import read_toml
from karma.household.pieces import base_type
from karma.household.places import surface_for
from karma.household.uses import TAPS
from karma.memory.scene_graph import SceneGraph

TABLE = Path(__file__).parent / "likely_places.toml"
Room = TypeVar("Room")


@dataclass(slots=True)
class Budget:
    """What a body has spent of the most that one instruction may take."""

    skills: Skills
    steps: int  # world actions at most
    most_failures: int
    failures: int = 0

    @property
    def is_spent(self) -> bool:
        """Whether nothing more may be tried."""
        return self.skills.actions >= self.steps or self.failures >= self.most_failures

    @property
    def left(self) -> int:
        """How many world actions the next skill may take, at least 1."""
        return max(self.steps - self.skills.actions, 1)


@dataclass
class RoomMemory:
    """What was seen of one room, which skills may ask: a name is an id or a type."""

    here: Callable[[], Vec3]  # where the agent stands
    seen: dict[str, SeenObject] = field(default_factory=dict)  # by id

    def observe(self, experience: Experience) -> None:
        """Take in the latest sights; what was missed or cut is forgotten."""
        self.seen |= experience.seen
        for object_id in experience.missed | experience.cut:
            self.seen.pop(object_id, None)

    def best(self, name: str) -> SeenObject | None:
        """Return the object that a type means now; None without one that may be used."""
        raise NotImplementedError

    def where(self, name: str) -> Known | None:
        """Return the best known place of an id or type."""
        one = self.seen.get(name) or self.best(name)
        return known(one, "memory") if one is not None else None

    def areas(self) -> tuple[Area, ...]:
        """Return no areas: objects only are remembered."""
        return ()

    def shut_in(self, one: SeenObject) -> SeenObject | None:
        """Return the closed receptacle that a thing was last seen in, if any."""
        holder = self.seen.get(place_of(one) or "")
        return holder if holder is not None and "closed" in holder.states else None

    def surface(self, kind: str) -> str:
        """Return the type of surface to free the hand on: a known one, if any is."""
        return surface_for(kind, lambda name: self.best(name) is not None)


class RoomByRoom(Generic[Room]):
    """An episode that keeps what `know` makes of each room at the first visit."""

    def __init__(self, world: World, scene: SceneRef, know: Callable[[World], Room]) -> None:
        self._world, self._know = world, know
        self._rooms: dict[SceneRef, Room] = {}
        self.enter(scene)

    def enter(self, scene: SceneRef) -> None:
        """Go on in a room, with what is known of it from earlier visits."""
        if scene not in self._rooms:
            self._rooms[scene] = self._know(self._world)
        self._scene, self._room = scene, self._rooms[scene]


@dataclass(frozen=True, slots=True)
class _NoOptions:
    pass


class WithoutOptions:
    """A row that has no options."""

    settings_kind: ClassVar[type] = _NoOptions

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row; KarmaError for any option."""
        settings_of(_NoOptions, options)
        return cls()


def is_known_tap(name: str, skills: Skills) -> bool:
    """Return whether a name is that of a tap which the skill finds over the basin last used."""
    return name in TAPS and bool(skills.experience.handled_ids)


def request_for(
    instruction: str, held: SeenObject | None, furniture: SceneGraph | None = None, **more: Any
) -> PlanRequest:
    """Return a request: the instruction, what is in the hand, furniture where that is told."""
    return PlanRequest(
        instruction=instruction,
        areas=furniture.areas() if furniture else (),
        graph_text=furniture.to_text(edges=False) if furniture else "",
        held_id=held.object_id if held else None,
        held_type=held.object_type if held else None,
        **more,
    )


@cache
def _table() -> Mapping[str, Mapping[str, float]]:
    return read_toml(TABLE, dict[str, dict[str, float]])


def likely_places(kind: str) -> Mapping[str, float]:
    """Return receptacle type -> share of such things, the likeliest first; {} for none counted.

    Stands for what the sources ask a large model (HELPER) or a trained network (CAPEAM).
    Counted in rooms of our generator that are in no task; the counter is in the history, at
    commit cb939ce. FileError if the table is damaged.
    """
    return _table().get(base_type(kind), {})
