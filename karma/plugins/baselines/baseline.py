"""What baselines share: what an instruction may cost, what usually lies where, what is asked."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np

from karma.agent.body.sightings import known
from karma.agent.body.skills import Skills
from karma.agent.options import settings_of
from karma.agent.planning.planner import Planner
from karma.agent.seeing.perceive import place_of
from karma.agent.tour import floor_of, position_of
from karma.files import read_toml
from karma.household.pieces import base_type
from karma.household.places import surface_for
from karma.household.uses import TAPS
from karma.memory.scene_graph import SceneGraph
from karma.seeds import stream
from karma.types.events import Plan, SkillResult
from karma.types.memory import Area, Experience, Known
from karma.types.observation import SeenObject
from karma.types.planning import PlanRequest, SkillCall
from karma.types.roles import Resources, World
from karma.types.space import SceneRef, Vec3

TABLE = Path(__file__).parent / "likely_places.toml"
Room = TypeVar("Room")
Memory = TypeVar("Memory", bound="RoomMemory")


@dataclass(frozen=True, slots=True, kw_only=True)
class BaselineSettings:
    """What one instruction may cost, and what the planner is told; a row has its own numbers."""

    steps: int = 1000  # world actions
    failures: int = 10
    furniture: bool = False  # whether the planner is told what furniture was seen; the source's not


@dataclass
class RoomMemory(ABC):
    """What was seen of one room, which skills may ask: a name is an id or a type."""

    here: Callable[[], Vec3]  # where the agent stands
    seen: dict[str, SeenObject] = field(default_factory=dict)  # by id

    def observe(self, experience: Experience) -> None:
        """Take in the latest sights; what was missed or cut is forgotten."""
        self.seen |= experience.seen
        for object_id in {*experience.missed, *experience.cut}:
            self.seen.pop(object_id, None)

    @abstractmethod
    def best(self, name: str) -> SeenObject | None:
        """Return the object that a type means now, by the row's order; None without any."""

    def where(self, name: str) -> Known | None:
        """Return the best known place of an id or type."""
        one = self.seen.get(name) or self.best(name)
        return known(one) if one is not None else None

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


@dataclass(kw_only=True)
class MappedRoom(Generic[Memory]):
    """One room: its floor, and what was seen there."""

    memory: Memory
    cells: list[tuple[float, float]]  # that can be stood on, (x, z)
    floor: SceneGraph  # areas over them, with the furniture that was seen

    @classmethod
    def of(cls, kind: type[Memory], world: World) -> Self:
        """Return the room that the agent is in at its first visit: nothing was seen yet."""
        cells, height = floor_of(world), position_of(world)[1]
        floor = SceneGraph.over(cells, height_m=height)
        return cls(memory=kind(here=lambda: position_of(world)), cells=cells, floor=floor)


class RowBody(Generic[Memory]):
    """Acts for one instruction within its budget; the memory takes in what is seen by acting."""

    def __init__(self, world: World, memory: Memory, settings: BaselineSettings) -> None:
        self.skills, self.memory, self.settings = Skills(world, memory), memory, settings
        self.failures = 0

    @property
    def is_spent(self) -> bool:
        """Whether nothing more may be tried."""
        used_up = self.skills.actions >= self.settings.steps
        return used_up or self.failures >= self.settings.failures

    @property
    def left(self) -> int:
        """How many world actions the next skill may take, at least 1."""
        return max(self.settings.steps - self.skills.actions, 1)

    def run(self, call: SkillCall) -> SkillResult:
        """Run one skill."""
        result = self.skills.run(call, max_actions=self.left)
        self.memory.observe(self.skills.experience)
        return result

    def search(self, name: str, place: SeenObject | Area, most: int | None = None) -> SkillResult:
        """Look for a thing from an area or into a receptacle, within `most` actions."""
        limit = self.left if most is None else min(most, self.left)
        result = self.skills.look_for(name, place, max_actions=limit)
        self.memory.observe(self.skills.experience)
        return result

    def is_known_tap(self, name: str) -> bool:
        """Return whether a name is that of a tap which is found over the basin last used."""
        return name in TAPS and bool(self.skills.experience.handled_ids)


class PlannerRow:
    """A row that is made of a planner, whose programs nobody mends, and of its options."""

    settings_kind: ClassVar[type]

    def __init__(self, planner: Planner, settings: Any) -> None:
        self.settings = settings
        self.planner = replace(planner, decoding=replace(planner.decoding, inspected=False))

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row; KarmaError if an option is unknown or of the wrong type."""
        settings: Any = settings_of(cls.settings_kind, options)
        return cls(Planner.of(resources), settings)


class MappedEpisode(RoomByRoom[MappedRoom[Memory]]):
    """An episode of a row that asks its planner, and remembers objects room by room."""

    settings: Any  # of the row

    def __init__(
        self, kind: type[Memory], row: PlannerRow, world: World, scene: SceneRef, seed: int
    ) -> None:
        super().__init__(world, scene, partial(MappedRoom.of, kind))
        self.settings, self._planner, self._seed = row.settings, row.planner, seed
        self._number = 0  # of the instruction

    @property
    def memory(self) -> Memory:
        """What was seen of the room that the agent is in."""
        return self._room.memory

    def _draws(self, row: str) -> np.random.Generator:
        return stream(self._seed, row, self._scene.name, str(self._number))

    def _ask(
        self, body: RowBody[Memory], instruction: str, **more: Any
    ) -> Generator[Plan, None, Plan | None]:
        """Ask for a program; the prompt holds no memory, and no map but where that is an option."""
        body.skills.look()
        self._room.floor.observe(self.memory.seen.values())
        furniture = self._room.floor if self.settings.furniture else None
        held = body.skills.experience.held
        answer = None
        for answer in self._planner.plan(request_for(instruction, held, furniture, **more)):
            yield answer
        return answer if answer is not None and answer.calls else None


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
