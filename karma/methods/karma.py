"""KARMA: both memories in the prompt; without one of them it is the paper's ablation (Table 2)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self

from karma.agent.planner import Planner, grounded
from karma.agent.prompt import Facts
from karma.agent.skills import Skills
from karma.contracts import (
    Area,
    Known,
    MemoryUnit,
    Outcome,
    Plan,
    Recall,
    Resources,
    SceneRef,
    SkillResult,
    SubTask,
    VisionModel,
    World,
)
from karma.household.ids import type_of, whole_id
from karma.household.pieces import goes_by
from karma.household.places import HAND
from karma.memory.policies import make_policy
from karma.memory.scene_graph import SceneGraph
from karma.memory.short_term import ShortTermMemory, merged
from karma.methods.experience import fresh_units
from karma.methods.options import settings_of
from karma.methods.tour import position_of, survey


@dataclass(frozen=True, slots=True, kw_only=True)
class KarmaSettings:
    """What makes one row of a table."""

    long_term: bool = True
    short_term: bool = True
    policy: str = "wtinylfu-karma[9,1]"  # of short-term memory (§4.4: the best at 10 units)
    recall_k: int = 3  # units in the prompt, 1 to the whole memory
    by_name: bool = True  # names are looked up in all of memory, else in what is recalled
    query: Literal["instruction", "subtask"] = "subtask"  # the paper's is the user's whole text
    attempts: int = 3  # programs per instruction; later ones quote what failed
    witnesses: int = 2  # things only seen that are remembered per instruction


class KarmaMethod:
    """The agent of the paper's Fig. 1.

    Args:
        planner: model and prompt profile.
        recall: chooses units for the prompt.
        vision: reads object states.
        settings: the row.
        maps: folder of long-term memories, one file a scene, made on the first visit and never
            changed by an episode; None to explore each time.
        learn: write what an episode learnt about a scene back to `maps`.
    """

    def __init__(
        self,
        planner: Planner,
        recall: Recall,
        vision: VisionModel,
        settings: KarmaSettings | None = None,
        *,
        maps: Path | None = None,
        learn: bool = False,
    ) -> None:
        self.settings = settings or KarmaSettings()
        self.name = _name(self.settings)
        self.planner, self.recall, self.vision = planner, recall, vision
        self.maps, self.learn = maps, learn
        make_policy(self.settings.policy)  # a wrong one is refused before the first episode

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make a row from its options (the fields of `KarmaSettings`).

        Raises:
            KarmaError: an option is unknown or of the wrong type.
        """
        return cls(
            Planner.of(resources),
            resources.recall,
            resources.vision,
            settings_of(KarmaSettings, options),
            maps=resources.maps,
            learn=resources.learn,
        )

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "KarmaEpisode":
        """Start an episode: short-term memory empty, long-term memory loaded or explored."""
        return KarmaEpisode(self, world, scene, folder)


class KarmaEpisode:
    """One sequence of instructions, with short-term memory and a map of each room entered.

    Args:
        method: models and settings.
        world: has been reset to `scene`.
        scene: the first room.
        folder: takes the pictures that were looked at.
    """

    def __init__(self, method: KarmaMethod, world: World, scene: SceneRef, folder: Path) -> None:
        self.settings = method.settings
        self.short_term = ShortTermMemory(make_policy(self.settings.policy))
        self._planner, self._recall, self._vision = method.planner, method.recall, method.vision
        self._maps, self._learn = method.maps, method.learn
        self._world, self._folder = world, folder
        self._graphs: dict[str, SceneGraph] = {}  # by the room's name
        self._scene = scene.name  # of the room that the agent is in
        self.enter(scene)

    @property
    def graph(self) -> SceneGraph | None:
        """Long-term memory of the room that the agent is in."""
        return self._graphs.get(self._scene)

    def enter(self, scene: SceneRef) -> None:
        """Be in a room: each has a map of its own; short-term memory is one for all."""
        for unit in self.short_term.units():
            if unit.place_id == HAND:  # it was put down at the door
                self.short_term.correct(replace(unit, place_id=None))
        self._scene = scene.name
        if self.settings.long_term and self._scene not in self._graphs:
            saved = self._map_path()
            graph, is_new = survey(self._world, scene, saved)
            self._graphs[self._scene] = graph
            if is_new and saved is not None:
                graph.save(saved)

    def _map_path(self) -> Path | None:
        """Return where the map of this room lies."""
        return self._maps / f"{self._scene}.json" if self._maps else None

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Plan and act until a program succeeds or the attempts are used up; then remember."""
        resident = self.short_term.units()
        recalled = self._recalled(subtask)
        by_name = self.settings.short_term and self.settings.by_name
        known = self.short_term.units(self._scene) if by_name else ()
        turn = _Turn(self._world, self._scene, recalled, self.graph, known=known)
        error, finished = "", False
        for _ in range(self.settings.attempts):
            plan = None
            for plan in self._planner.plan(self._facts(subtask, turn, error)):
                yield plan
            if plan is None or plan.error:
                break
            error = ""
            for call in grounded(plan.calls, plan.names):
                result = turn.skills.run(call)
                yield result
                if not result.ok:
                    error = f"{result.call}: {result.reason}"
                    if call.skill == "Explore":
                        turn.missing.append(call.objects[-1])
                    break
            finished = not error
            if finished:
                break
        self._remember(turn, subtask)
        yield Outcome(
            finished=finished,
            resident=resident,
            handled_ids=tuple(turn.skills.handled),
            kept=self.short_term.units(),
            tour=self.graph.tour if self.graph else None,
        )

    # ------------------------------------------------------------- memory into the prompt

    def _recalled(self, subtask: SubTask) -> tuple[MemoryUnit, ...]:
        """Return the top K units of this room, least recently used first."""
        units = self.short_term.units(self._scene) if self.settings.short_term else ()
        whole = self.settings.query == "instruction" and subtask.whole
        query = whole or subtask.instruction
        if not units:
            return ()
        found = self._recall.recall(query, units, min(self.settings.recall_k, len(units)))
        chosen = {item.unit.object_id for item in found}
        return tuple(unit for unit in units if unit.object_id in chosen)

    def _facts(self, subtask: SubTask, turn: "_Turn", error: str) -> Facts:
        turn.skills.look()
        held = turn.skills.held
        return Facts(
            instruction=subtask.instruction,
            areas=turn.areas(),
            graph_text=self.graph.to_text() if self.graph else "",
            units=turn.units(self._vision, subtask.instruction)
            if error and self.settings.short_term
            else turn.recalled,
            held_id=held.object_id if held else None,
            held_type=held.object_type if held else None,
            error=error,
            missing=tuple(turn.missing),
        )

    # ------------------------------------------------------------- experience into memory

    def _remember(self, turn: "_Turn", subtask: SubTask) -> None:
        """Write what was seen, then what was handled in the order of use; forget what is gone."""
        known = self.short_term.units(self._scene)  # slices inherit from wholes, which are gone
        for object_id in turn.gone():
            self.short_term.forget(object_id, self._scene)
        units = fresh_units(
            turn.skills,
            self._vision,
            subtask.instruction,
            witnesses=self.settings.witnesses,
            folder=self._folder,
            scene=self._scene,
        )
        if self.settings.short_term:
            for unit in _with_history(units, known, turn.skills.cut):
                self.short_term.remember(unit)
        if self.graph is not None:
            self.graph.observe(turn.skills.seen.values())
            if self._learn and (path := self._map_path()) is not None:
                self.graph.save(path)


class _Turn:
    """One instruction being carried out: the skills' log, and memory as skills may ask it.

    Args:
        world: where.
        scene: name of the room.
        recalled: units in the prompt, of this room.
        graph: long-term memory of it.
        known: units of this room that are found by their names only.
    """

    def __init__(
        self,
        world: World,
        scene: str,
        recalled: Sequence[MemoryUnit],
        graph: SceneGraph | None,
        *,
        known: Sequence[MemoryUnit] = (),
    ) -> None:
        self._world, self._scene, self._graph = world, scene, graph
        self.recalled, self._known = tuple(recalled), tuple(known)
        self.missing: list[str] = []  # names that were searched for in vain
        self.skills = Skills(world, self)

    def where(self, name: str) -> Known | None:
        """Return the best known place of a name: units, the map, then what holds a unit."""
        for unit in (*reversed(self.recalled), *reversed(self._known)):
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
        return found or self._holder(name)

    def _holder(self, name: str) -> Known | None:
        """Return the receptacle of that id as known from what memory has in it."""
        for unit in (*reversed(self.recalled), *reversed(self._known)):
            if unit.place_id == name and name != HAND:
                return Known(
                    object_id=name,
                    object_type=type_of(name),
                    position_m=unit.position_m,
                    source="memory",
                )
        return None

    def areas(self) -> tuple[Area, ...]:
        """Return the area nodes; () without long-term memory."""
        return self._graph.areas() if self._graph else ()

    def gone(self) -> frozenset[str]:
        """Return ids that memory had wrong, and wholes that were cut."""
        return (self.skills.missed - set(self.skills.seen)) | self.skills.cut

    def units(self, vision: VisionModel, instruction: str) -> tuple[MemoryUnit, ...]:
        """Return what the next program of the same instruction may build on."""
        fresh = fresh_units(self.skills, vision, instruction, witnesses=0, scene=self._scene)
        fresh = _with_history(fresh, self.recalled, self.skills.cut)
        new = {unit.object_id for unit in fresh} | self.gone()
        return (*(unit for unit in self.recalled if unit.object_id not in new), *fresh)


def _with_history(
    units: Sequence[MemoryUnit], known: Sequence[MemoryUnit], cut: frozenset[str]
) -> list[MemoryUnit]:
    """Let units that are new to memory inherit the states of what they were cut from."""
    by_id = {unit.object_id: unit for unit in known}
    found = []
    for unit in units:
        whole = by_id.get(whole_id(unit.object_id))
        if unit.object_id in by_id:
            unit = merged(by_id[unit.object_id], unit)
        elif whole is not None and whole.object_id in cut:
            unit = replace(merged(whole, unit), object_id=unit.object_id)
        found.append(unit)
    return found


def _name(settings: KarmaSettings) -> str:
    """Return the row's name as the paper writes it."""
    missing = [
        word
        for word, there in (("long", settings.long_term), ("short", settings.short_term))
        if not there
    ]
    return "KARMA" + (f" (w/o {' and '.join(missing)} term memory)" if missing else "")
