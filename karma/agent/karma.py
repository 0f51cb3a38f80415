"""KARMA: both memories in the prompt; without one of them it is the paper's ablation (Table 2)."""

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from msgspec import Meta

from karma.agent.attempts import Programs, after_run, as_left, carried_out, lost
from karma.agent.body.skills import Skills
from karma.agent.experience import shut_away, units_of
from karma.agent.options import settings_of
from karma.agent.planning.full_profile import furniture_names
from karma.agent.planning.planner import Planner
from karma.agent.seeing.perception import BoxSource, Kind, Perception, detector_of
from karma.agent.tour import explore_room, position_of
from karma.contracts import (
    Area,
    Detector,
    Experience,
    Known,
    MemoryChange,
    MemoryUnit,
    Outcome,
    Plan,
    PlanRequest,
    Recall,
    Recalled,
    Resources,
    SceneRef,
    SeenObject,
    SkillResult,
    SubTask,
    VisionModel,
    World,
)
from karma.household.ids import type_of
from karma.household.pieces import goes_by
from karma.household.places import HAND
from karma.household.uses import kind_of
from karma.memory.policies import make_policy
from karma.memory.scene_graph import SceneGraph
from karma.memory.short_term import ShortTermMemory
from karma.plugins.rules.language.clauses import plainly
from karma.plugins.rules.language.request import RequestReader, asked_last
from karma.plugins.rules.object_finder import Came
from karma.plugins.rules.request_executor import GuardedErrand, joined, reader_of
from karma.plugins.rules.types import Mention, Request, SaidDeed


@dataclass(frozen=True, slots=True, kw_only=True)
class KarmaSettings:
    """What makes one row of a table."""

    long_term: bool = True
    short_term: bool = True
    policy: str = "wtinylfu-karma[9,1]"  # of short-term memory (§4.4: the best at 10 units)
    recall_k: Annotated[int, Meta(ge=1)] = 3  # units in the prompt, to the whole memory
    whole_memory: bool | None = None  # the other units too; None: in the full profile only
    map_form: Literal["named", "paper"] = "named"  # of the map in the full profile, §3.3's or ours
    seen_listed: bool = True  # what is in sight and not remembered, in the full profile
    by_name: bool = True  # names are looked up in all of memory, else in what is recalled
    query: Literal["instruction", "subtask"] = "subtask"  # the paper's is the user's whole text
    attempts: Annotated[int, Meta(ge=1)] = 3  # programs per instruction, which quote failures
    seen_kept: Annotated[int, Meta(ge=0)] = 2  # things only seen, remembered per instruction
    perception: Kind = "metadata"  # how the agent sees
    boxes: BoxSource = "given"  # what finds things in pictures
    means: Literal["used", "recalled"] = "used"  # of several `Plate`s: used last, recalled best
    guard: bool = False  # programs are held against what was said, before and afterwards

    def __post_init__(self) -> None:
        """Refuse a policy that is none before a model loads."""
        make_policy(self.policy)


@dataclass(eq=False)
class KarmaMethod:
    """The agent of the paper's Fig. 1.

    `maps` is a folder of long-term memories, one file a scene, made on the first visit and never
    changed by an episode, save where it is to `learn`; None: each explores.
    """

    settings_kind: ClassVar[type] = KarmaSettings
    planner: Planner
    recall: Recall
    vision: VisionModel
    settings: KarmaSettings = field(default_factory=KarmaSettings)
    _: KW_ONLY
    maps: Path | None = None
    learn: bool = False
    detector: Detector | None = None
    reader: RequestReader | None = None
    name: str = field(init=False)  # of the row, as the paper writes it

    def __post_init__(self) -> None:
        """Name the row by the memories that it lacks."""
        kinds = {"long": self.settings.long_term, "short": self.settings.short_term}
        missing = " and ".join(word for word, there in kinds.items() if not there)
        self.name = "KARMA" + (f" (w/o {missing} term memory)" if missing else "")

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make a row from its options, the fields of `KarmaSettings`."""
        settings = settings_of(KarmaSettings, options)
        return cls(
            Planner.of(resources),
            resources.recall,
            resources.vision,
            settings,
            maps=resources.maps,
            learn=resources.learn,
            detector=detector_of(settings.perception, settings.boxes, resources),
            reader=reader_of(resources.embedder) if settings.guard else None,
        )

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "KarmaEpisode":
        """Start an episode: short-term memory empty, long-term memory loaded or explored."""
        return KarmaEpisode(self, world, scene, folder, seed)


class KarmaEpisode:
    """One sequence of instructions, with short-term memory and a map of each room entered."""

    def __init__(
        self, method: KarmaMethod, world: World, scene: SceneRef, folder: Path, seed: int = 0
    ) -> None:
        self._method, self.settings = method, method.settings
        self.short_term = ShortTermMemory(make_policy(self.settings.policy))
        self._beliefs = _Beliefs(world, None, ())
        self._spoken: tuple[Mention, ...] = ()  # of the last instruction that was read here
        self._deeds: tuple[SaidDeed, ...] = ()  # likewise
        self.chosen: dict[tuple[str, int], str] = {}  # what a word of a text was found to mean
        self.decided: dict[tuple[str, ...], bool] = {}  # what was so when a text first asked
        self._world, self._folder, self._seed = world, folder, seed
        self._perception = Perception(self.settings.perception, method.vision, method.detector)
        self._rooms: defaultdict[str, _Room] = defaultdict(_Room)  # by name
        self.clock_s = 0.0  # of the home, set by who keeps it
        self.changes: list[MemoryChange] = []  # of memory, for who keeps it
        self.mine: Mapping[str, str] = {}  # kind -> id that its word means, by what was told
        self.told: Collection[str] = ()  # ids of which somebody else says where or how they are
        self._named: dict[str, dict[str, str]] = {}  # furniture's names -> ids, by the room's name
        self._scene = scene.name  # of the room that the agent is in
        self.skills = Skills(world, self._beliefs)  # of the latest instruction
        self.enter(scene)

    @property
    def graph(self) -> SceneGraph | None:
        """Long-term memory of the room that the agent is in."""
        return self._rooms[self._scene].graph

    def enter(self, scene: SceneRef) -> None:
        """Be in a room: each has a map of its own; short-term memory is one for all."""
        for unit in self.short_term.units():
            if unit.place_id == HAND:  # it was put down at the door
                self.short_term.correct(replace(unit, place_id=None))
        self._scene = scene.name
        if self.settings.long_term and self.graph is None:
            saved = self._map_path()
            graph, is_new = explore_room(self._world, scene, saved, self._perception.fresh())
            self._rooms[self._scene].graph = graph
            if is_new and saved is not None:
                graph.save(saved)

    def _map_path(self) -> Path | None:
        """Return where the map of this room lies; None: nowhere, it is explored each time."""
        name = self._perception.map_file(self._scene, self._seed)
        return self._method.maps / name if self._method.maps and name else None

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Plan and act until a program succeeds or the attempts are used up; then remember."""
        resident = self.short_term.units()
        self._beliefs = _Beliefs(self._world, self.graph, self._found_by_name(()))
        eyes = self._perception.eyes(self._scene, subtask.instruction)
        before = self._rooms[self._scene].seen
        self.skills = Skills(self._world, self._beliefs, eyes=eyes, before=before)
        came = Came()
        asked = self._asked(subtask)
        if asked is None:
            yield from self.planned(subtask, came)
        else:
            yield from GuardedErrand(self, asked, came, subtask).carry_out()
        experience = self.skills.experience
        if came.tried:  # what is refused before a step changes nothing
            self._remember(experience, subtask.instruction)
        yield Outcome(
            finished=came.finished,
            resident=resident,
            handled_ids=experience.handled_ids,
            kept=self.short_term.units(),
            tour=self.graph.tour if self.graph else None,
            checks=came.checks(experience),
        )

    def _asked(self, subtask: SubTask) -> Request | None:
        """Return what an instruction asks, for a guard; None without one."""
        reader = self._method.reader
        if reader is None or subtask.asked is not None:
            return subtask.asked
        asked = joined(reader.read(subtask.instruction, self._spoken, self._deeds))
        if asked is not None:
            self._spoken = tuple(one for one in asked.mentions if one.types) or self._spoken
            self._deeds = asked_last(asked, self._deeds)
        return asked

    def planned(
        self, subtask: SubTask, came: Came, only: Mapping[str, str] | None = None
    ) -> Iterator[Plan | SkillResult]:
        """Plan and act until a program succeeds or the attempts are used up.

        `only`: type -> id of the one thing of the type that is meant.
        """
        request = self._request(subtask)
        self._beliefs.units = self._found_by_name(request.units)
        programs = Programs(subtask.instruction)
        for _ in range(self.settings.attempts):
            plan = None
            updated = self._updated(request, again=bool(programs.results))
            for plan in self._method.planner.plan(updated):
                yield plan
                self._named.setdefault(self._scene, {}).update(furniture_names(plan.names))
                if plan.failure is not None:
                    request = replace(request, failures=(*request.failures, plan.failure))
            if plan is None or not plan.calls:
                break
            results = yield from carried_out(plan, self.skills, only)
            programs.add(plan, results)
            if programs.ran:
                break
            request = after_run(request, programs)
        came.programs.append(programs)

    def where(self, name: str) -> Known | None:
        """Return where the agent believes a thing to be, by its type or id; None if unknown."""
        return _Beliefs(self._world, self.graph, self._found_by_name(())).where(name)

    def remembered(self) -> "Remembered":
        """Return all that is remembered now, apart from what comes later."""
        return deepcopy(Remembered(self._scene, self.short_term, self._rooms))

    def go_back(self, before: "Remembered") -> None:
        """Remember what was remembered then, and nothing since."""
        kept = deepcopy(before)
        self._scene, self.short_term, self._rooms = kept.scene, kept.short_term, kept.rooms
        self.changes.clear()
        self._keep_map()

    def last_seen(self) -> Mapping[str, tuple[SeenObject, float]]:
        """Return the latest sight of each thing of this room, and when it was in view last."""
        room = self._rooms[self._scene]
        return {name: (one, room.seen_s.get(name, 0.0)) for name, one in room.seen.items()}

    # ------------------------------------------------------------- memory into the prompt

    def _request(self, subtask: SubTask) -> PlanRequest:
        """Return what the planner is told at first: the map, and the top K units by last use."""
        units = self.short_term.units(self._scene) if self.settings.short_term else ()
        query = self.settings.query == "instruction" and subtask.whole
        recalled: list[Recalled] = []
        if units:
            k = min(self.settings.recall_k, len(units))
            recalled = self._method.recall.recall(query or subtask.instruction, units, k)
        papers = self.graph is not None and self.settings.map_form == "paper"
        return PlanRequest(
            instruction=subtask.instruction,
            whole="" if subtask.is_whole else subtask.whole,
            areas=self.graph.areas() if self.graph else (),
            graph_text=self.graph.to_text() if self.graph and papers else "",
            recalled=tuple(recalled),
            units=self._shown(units, recalled),
            asked=subtask.asked,
            plain=plainly(subtask.asked) if subtask.asked else "",
        )

    def _shown(
        self, units: tuple[MemoryUnit, ...], recalled: Sequence[Recalled]
    ) -> tuple[MemoryUnit, ...]:
        """Return the units of the prompt: all of this room's, or the recalled ones."""
        whole = self.settings.whole_memory
        tells_all = self._method.planner.profile != "compact" if whole is None else whole
        if self.settings.means == "recalled":  # the last of a type has its bare name
            units = tuple(item.unit for item in reversed(recalled))
        elif not tells_all:
            chosen = {item.unit.object_id for item in recalled}
            units = tuple(unit for unit in units if unit.object_id in chosen)
        return shut_away(units, self.short_term.units(self._scene))

    def here(self) -> frozenset[str]:
        """Return the types that the agent knows of in this room."""
        areas = self.graph.areas() if self.graph else ()
        kinds = {kind for area in areas for kind in area.contains}
        kinds |= {unit.object_type for unit in self.short_term.units(self._scene)}
        return frozenset(kinds | {one.object_type for one in self.sights().values()})

    def places(self, kinds: Collection[str]) -> list[str]:
        """Return the ids of the furniture of some kinds, by the map."""
        nodes = self.graph.objects() if self.graph else ()
        return sorted(one.id for one in nodes if kind_of(one.type) in kinds)

    def sights(self) -> dict[str, SeenObject]:
        """Return the latest sight of all that was seen here and is not known to be gone."""
        experience = self.skills.experience
        seen = {**self._rooms[self._scene].seen, **experience.seen}
        return {name: one for name, one in seen.items() if name not in experience.gone}

    def handled(self) -> list[str]:
        """Return the ids of what was handled in this room and is remembered, the last one last."""
        return [one.object_id for one in self.short_term.units(self._scene) if one.handled]

    def _found_by_name(self, recalled: Sequence[MemoryUnit]) -> tuple[MemoryUnit, ...]:
        """Return the units that a name may mean: the recalled ones first, the last used first."""
        by_name = self.settings.short_term and self.settings.by_name
        others = self.short_term.units(self._scene) if by_name else ()
        return (*reversed(recalled), *reversed(others))

    def _updated(self, request: PlanRequest, *, again: bool) -> PlanRequest:
        """Return the request with hand and sight and, after a failure, what was done so far."""
        self.skills.look()
        experience = self.skills.experience
        held = experience.held
        request = replace(
            request,
            held_id=held.object_id if held else None,
            held_type=held.object_type if held else None,
        )
        if not self.settings.short_term:
            return request
        if self.settings.seen_listed:
            seen = tuple(self.sights().values())
            request = replace(request, seen=seen, named=self._named.get(self._scene, {}))
        if not again:
            return request
        before = as_left(request.units, experience)
        task, scene = request.instruction, self._scene
        fresh = units_of(experience, before, self._method.vision, task, scene=scene, seen_kept=0)
        new = {unit.object_id for unit in (*fresh, *lost(request.units, experience))}
        kept = (unit for unit in before if unit.object_id not in new)
        return replace(request, units=(*kept, *fresh))

    # ------------------------------------------------------------- experience into memory

    def _remember(self, experience: Experience, instruction: str) -> None:
        """Write what was seen, then what was handled in the order of use; forget what is gone."""
        remembered = self.short_term.units(self._scene)
        away, before = lost(remembered, experience), as_left(remembered, experience)
        kept, scene = self.settings.seen_kept, self._scene
        units = units_of(
            experience, away, self._method.vision, instruction,
            scene=scene, seen_kept=kept, folder=self._folder,
        )  # fmt: skip
        change = MemoryChange(
            scene=scene,
            at_s=self.clock_s + self.skills.actions,
            corrected=tuple(unit for unit in before if unit not in remembered),
            forgotten=tuple(unit.object_id for unit in away),
            remembered=tuple(units),
            seen=tuple(experience.seen.values()),
            in_view=tuple(experience.views),
            gone=tuple(sorted(experience.gone)),
            taken=tuple(experience.taken.items()),
        )
        self.learn(change)
        self.changes.append(change)

    def learn(self, change: MemoryChange) -> None:
        """Put into memory what an instruction has left."""
        for unit in change.corrected:
            self.short_term.correct(unit)
        room = self._rooms[change.scene]
        room.seen.update((one.object_id, one) for one in change.seen)
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
        """Write what was learnt of this room, where that is wanted."""
        if self.graph is not None and self._method.learn and (path := self._map_path()) is not None:
            self.graph.save(path)


@dataclass(slots=True)
class _Room:
    """What is remembered of one room for good."""

    graph: SceneGraph | None = None
    seen: dict[str, SeenObject] = field(default_factory=dict)  # the latest sight of each thing
    seen_s: dict[str, float] = field(default_factory=dict)  # when each was in view last


@dataclass(frozen=True, slots=True)
class Remembered:
    """Both memories of an episode at one moment."""

    scene: str
    short_term: ShortTermMemory
    rooms: "defaultdict[str, _Room]"


class _Beliefs:
    """What skills may ask of memory: units by name, then the map, then what holds a unit."""

    def __init__(self, world: World, graph: SceneGraph | None, units: Sequence[MemoryUnit]) -> None:
        self._world, self._graph, self.units = world, graph, units

    def where(self, name: str) -> Known | None:
        """Return the best known place of a name, None if nothing is known of it."""
        for unit in self.units:
            if goes_by(name, unit.object_id, unit.object_type):
                return Known(
                    object_id=unit.object_id,
                    object_type=unit.object_type,
                    position_m=unit.position_m,
                    place_id=None if unit.place_id == HAND else unit.place_id,
                    source="memory",
                )
        near = position_of(self._world)
        found = self._graph.known(name, near=near) if self._graph else None
        inside = next((unit for unit in self.units if unit.place_id == name != HAND), None)
        if found or inside is None:
            return found
        at = inside.position_m
        return Known(object_id=name, object_type=type_of(name), position_m=at, source="memory")

    def areas(self) -> tuple[Area, ...]:
        """Return the area nodes; () without long-term memory."""
        return self._graph.areas() if self._graph else ()
