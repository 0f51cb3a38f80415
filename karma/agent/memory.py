"""Both memories of an agent: their units in prompts, and their update after an instruction."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path

from karma.agent.experience import as_left, lost, shut_away, units_of
from karma.agent.knowledge import RoomKnowledge
from karma.agent.planning.full_profile import furniture_names
from karma.agent.seeing.eyes import Perception
from karma.agent.settings import KarmaSettings
from karma.agent.tour import explore_room, seen_on_tour
from karma.files import inside
from karma.household.places import HAND
from karma.memory.policies import make_policy
from karma.memory.scene_graph import SceneGraph
from karma.memory.short_term import ShortTermMemory
from karma.types.memory import Exchange, Experience, MemoryChange, MemoryUnit, Recalled
from karma.types.observation import SeenObject
from karma.types.planning import Advice, PlanRequest
from karma.types.roles import Recall, VisionModel, World
from karma.types.space import SceneRef
from karma.types.tasks import SubTask

KEPT_EXCHANGES = 4  # of the conversation


@dataclass(slots=True)
class _Room:
    """Long-term memory of one room."""

    graph: SceneGraph | None = None
    seen: dict[str, SeenObject] = field(default_factory=dict)  # the latest sight of each object
    seen_s: dict[str, float] = field(default_factory=dict)  # when each was in view last
    names: dict[str, str] = field(default_factory=dict)  # of furniture in prompts (-> id)


Snapshot = tuple[  # both memories at one moment
    str, ShortTermMemory, "defaultdict[str, _Room]", tuple[Exchange, ...]
]


class AgentMemory:
    """Short-term memory, and a map of each room entered; `scene` is the room the agent is in.

    `maps` is a folder with one map a room, or None if each room is explored anew; to `learn` is to
    write the maps back. If it `keeps_tour`, what was in view on the first visit to a room stands in
    prompts.
    """

    def __init__(
        self,
        settings: KarmaSettings,
        recall: Recall,
        vision: VisionModel,
        *,
        maps: Path | None,
        learn: bool,
        keeps_tour: bool = False,
        perception: Perception,
        seed: int,
        pictures: Path,
    ) -> None:
        self.settings, self._recall, self._vision = settings, recall, vision
        self._learn_maps, self._keeps_tour = learn, keeps_tour
        self._maps, self._perception, self._seed, self._pictures = maps, perception, seed, pictures
        self.short_term = ShortTermMemory(make_policy(settings.policy))
        self._rooms: defaultdict[str, _Room] = defaultdict(_Room)  # by name
        self.scene = ""
        self.exchanges: tuple[Exchange, ...] = ()  # of the conversation, the last one last

    @property
    def graph(self) -> SceneGraph | None:
        """The map of the current room."""
        return self._rooms[self.scene].graph

    @property
    def room(self) -> _Room:
        """Long-term memory of the current room."""
        return self._rooms[self.scene]

    def enter(self, scene: SceneRef, world: World) -> None:
        """Move to a room: each has its own map, all share the short-term memory."""
        for unit in self.short_term.units():
            if unit.place_id == HAND:  # the agent put it down at the door
                self.short_term.correct(replace(unit, place_id=None))
        self.scene = scene.name
        if self.settings.long_term and self.graph is None:
            saved = self._map_path()
            graph, is_new = explore_room(world, scene, saved, self._perception.fresh())
            self.room.graph = graph
            if is_new and saved is not None:
                graph.save(saved)
            if self._keeps_tour and self.settings.short_term:
                eyes = self._perception.fresh()
                sights = seen_on_tour(world, scene, graph, saved, eyes)
                self.room.seen.update((sight.object_id, sight) for sight in sights)

    def _map_path(self) -> Path | None:
        """Return where the map of this room lies, or None if it is explored each time."""
        name = self._perception.map_file(self.scene, self._seed)
        return inside(self._maps, name) if self._maps and name else None

    # ------------------------------------------------------------- what is known

    def knowledge(self, world: World, recalled: Sequence[MemoryUnit] = ()) -> RoomKnowledge:
        """Return the knowledge of skills: recalled units first, then all others, then the map."""
        others = self.short_term.units(self.scene) if self.settings.short_term else ()
        return RoomKnowledge(world, self.graph, (*reversed(recalled), *reversed(others)))

    def sights(self, experience: Experience) -> dict[str, SeenObject]:
        """Return the latest sight of each object of this room that is not known to be gone."""
        seen = {**self.room.seen, **experience.seen}
        return {name: sight for name, sight in seen.items() if name not in experience.gone}

    def may_tell(self, sight: SeenObject) -> bool:
        """Return whether a prompt may tell of a sight: without short-term memory a new one only."""
        return self.settings.short_term or self.room.seen.get(sight.object_id) is not sight

    # ------------------------------------------------------------- memory into the prompt

    def request(self, subtask: SubTask, advice: Advice, *, tells_all: bool) -> PlanRequest:
        """Return the first request to the planner: the map, and the top K units by last use.

        `tells_all`: also the units that recall did not choose.
        """
        settings = self.settings
        units = self.short_term.units(self.scene) if settings.short_term else ()
        query = settings.paper_prompt and subtask.whole
        recalled: list[Recalled] = []
        if units:
            k = min(settings.recall_k, len(units))
            recalled = self._recall.recall(query or subtask.instruction, units, k)
        return PlanRequest(
            instruction=subtask.instruction,
            whole="" if subtask.is_whole else subtask.whole,
            areas=self.graph.areas() if self.graph else (),
            graph_text=self.graph.to_text() if self.graph and settings.paper_prompt else "",
            recalled=tuple(recalled),
            units=self._shown(units, recalled, tells_all=tells_all and not settings.paper_prompt),
            advice=advice,
        )

    def _shown(
        self, units: tuple[MemoryUnit, ...], recalled: Sequence[Recalled], *, tells_all: bool
    ) -> tuple[MemoryUnit, ...]:
        """Return the units of the prompt: all units of this room, or the recalled units."""
        chosen = tuple(item.unit for item in recalled)
        if self.settings.means == "recalled":  # the last unit of a type has its bare name
            units = chosen[::-1]
        elif not tells_all:
            units = tuple(unit for unit in units if unit in chosen)
        return shut_away(units, self.short_term.units(self.scene))

    def updated(self, request: PlanRequest, experience: Experience, *, again: bool) -> PlanRequest:
        """Return the request with hand and sights and, after a failure, the updated units."""
        held = experience.held
        request = replace(
            request,
            held_id=held.object_id if held else None,
            held_type=held.object_type if held else None,
        )
        if not self.settings.short_term:
            return request
        if not self.settings.paper_prompt:
            seen = tuple(self.sights(experience).values())
            request = replace(request, seen=seen, named=self.room.names)
        if not again:
            return request
        before = as_left(request.units, experience)
        fresh = units_of(
            experience, before, self._vision, request.instruction, scene=self.scene, seen_kept=0
        )
        new = {unit.object_id for unit in (*fresh, *lost(request.units, experience))}
        kept = (unit for unit in before if unit.object_id not in new)
        return replace(request, units=(*kept, *fresh))

    def keep_names(self, names: Mapping[str, str]) -> None:
        """Keep the names of furniture in a prompt (-> id) for all later prompts."""
        self.room.names.update(furniture_names(names))

    def keep_all_names(self, names: Mapping[str, str]) -> None:
        """Keep the names of objects of any kind (-> id) for all later prompts."""
        self.room.names.update(names)

    def keep_exchange(self, exchange: Exchange) -> None:
        """Remember a request and its report; without short-term memory nothing is."""
        if self.settings.short_term:
            self.exchanges = (*self.exchanges, exchange)[-KEPT_EXCHANGES:]

    # ------------------------------------------------------------- experience into memory

    def remember(self, experience: Experience, instruction: str, at_s: float) -> MemoryChange:
        """Store seen objects, then handled objects by use; forget the objects that are gone."""
        remembered = self.short_term.units(self.scene)
        away, before = lost(remembered, experience), as_left(remembered, experience)
        units = units_of(
            experience, away, self._vision, instruction,
            scene=self.scene, seen_kept=self.settings.seen_kept, folder=self._pictures,
        )  # fmt: skip
        change = MemoryChange(
            scene=self.scene,
            at_s=at_s,
            corrected=tuple(unit for unit in before if unit not in remembered),
            forgotten=tuple(unit.object_id for unit in away),
            remembered=tuple(units),
            seen=tuple(experience.seen.values()),
            in_view=tuple(experience.views),
            gone=tuple(sorted(experience.gone)),
            taken=tuple(experience.taken.items()),
        )
        self.learn(change)
        return change

    def learn(self, change: MemoryChange) -> None:
        """Apply the memory change of an instruction."""
        for unit in change.corrected:
            self.short_term.correct(unit)
        room = self._rooms[change.scene]
        room.seen.update((sight.object_id, sight) for sight in change.seen)
        for object_id in (*change.gone, *change.forgotten):
            room.seen.pop(object_id, None)
        for object_id in change.forgotten:
            self.short_term.forget(object_id, change.scene)
        room.seen_s.update(dict.fromkeys(change.in_view, change.at_s))
        if self.settings.short_term:
            for unit in change.remembered:
                self.short_term.remember(unit)
        if room.graph is not None:
            room.graph.observe(change.seen)
            for object_id in change.gone:
                room.graph.forget(object_id)
            self._keep_map()

    def _keep_map(self) -> None:
        """Save the map of this room if maps learn."""
        if self.graph is not None and self._learn_maps and (path := self._map_path()) is not None:
            self.graph.save(path)

    def snapshot(self) -> Snapshot:
        """Return a copy of both memories."""
        return deepcopy((self.scene, self.short_term, self._rooms, self.exchanges))

    def go_back(self, before: Snapshot) -> None:
        """Restore both memories from a snapshot."""
        self.scene, self.short_term, self._rooms, self.exchanges = deepcopy(before)
        self._keep_map()
