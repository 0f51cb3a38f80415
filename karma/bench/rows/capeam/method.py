"""CAPEAM-style (after Kim et al. 2023): frames from a context, a memory of the environment.

The source's networks are not rebuilt; what stands for them is in docs/methods.md.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from karma.agent.body.search import cover
from karma.agent.body.skills import Skills
from karma.agent.options import settings_of
from karma.agent.planning.planner import Planner
from karma.agent.tour import floor_of, position_of
from karma.bench.rows.baseline import Budget, request_for
from karma.bench.rows.capeam.frames import read
from karma.bench.rows.capeam.memory import EnvironmentMemory
from karma.bench.rows.capeam.run import Runner
from karma.contracts import (
    Area,
    Outcome,
    Plan,
    PlanRequest,
    Resources,
    SceneRef,
    SkillResult,
    SubTask,
    World,
)
from karma.household.pieces import base_type
from karma.memory.scene_graph import SceneGraph
from karma.seeds import stream

FINER_M = 0.5  # every cell is this near to a place of the second round, as in KARMA's own search


@dataclass(frozen=True, slots=True, kw_only=True)
class CapeamSettings:
    """The numbers of the source."""

    failures: int = 10  # of one instruction
    steps: int = 1000  # world actions of one instruction
    furniture: bool = False  # whether the planner is told what furniture was seen; the source's not


@dataclass(frozen=True, slots=True, kw_only=True)
class _CapeamRoom:
    """The map of one room."""

    memory: EnvironmentMemory
    floor: SceneGraph
    finer: tuple[Area, ...]

    @classmethod
    def of(cls, world: World) -> Self:
        """Return the empty map of the room that the agent is in."""
        cells, height = floor_of(world), position_of(world)[1]
        floor = SceneGraph.over(cells, height_m=height)
        looked = [(x, z) for x, _, z in (area.position_m for area in floor.areas())]
        finer = enumerate(cover(cells, looked, FINER_M), start=1)
        return cls(
            memory=EnvironmentMemory(here=lambda: position_of(world)),
            floor=floor,
            finer=tuple(Area(name=f"finer_{number}", position_m=point) for number, point in finer),
        )


class CapeamMethod:
    """The `capeam` row.

    Args:
        planner: model and prompt profile; its program is only read for frames, never mended.
        settings: the limits.
    """

    name = "CAPEAM-style"
    settings_kind: ClassVar[type] = CapeamSettings

    def __init__(self, planner: Planner, settings: CapeamSettings | None = None) -> None:
        self.settings = settings or CapeamSettings()
        decoding = replace(planner.decoding, inspected=False)
        self.planner = planner.drawn_by(decoding)

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row from its options (the fields of `CapeamSettings`).

        Raises:
            KarmaError: an option is unknown or of the wrong type.
        """
        settings = settings_of(CapeamSettings, options)
        return cls(Planner.of(resources), settings)

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "CapeamEpisode":
        """Start an episode: an empty map."""
        return CapeamEpisode(self, world, scene, seed)


class CapeamEpisode:
    """One sequence of instructions, in a world reset to its first room: each has its own map."""

    def __init__(self, method: CapeamMethod, world: World, scene: SceneRef, seed: int) -> None:
        self.settings, self._planner = method.settings, method.planner
        self._world, self._seed = world, seed
        self._number = 0  # of the instruction
        self._scene, self._room = scene, _CapeamRoom.of(world)
        self._rooms = {scene: self._room}

    @property
    def memory(self) -> EnvironmentMemory:
        """The map of the room that the agent is in."""
        return self._room.memory

    def enter(self, scene: SceneRef) -> None:
        """Go on in a room, with the map of earlier visits."""
        if scene not in self._rooms:
            self._rooms[scene] = _CapeamRoom.of(self._world)
        self._scene, self._room = scene, self._rooms[scene]

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Predict the frames once, then carry them out until one cannot be."""
        if subtask.is_whole:  # what it put where is to be passed over within one task only
            self.memory.put.clear()
        rng = stream(self._seed, "capeam", self._scene.name, str(self._number))
        self._number += 1
        skills = Skills(self._world, self.memory)
        budget = Budget(skills, self.settings.steps, self.settings.failures)
        areas = self._room.floor.areas(), self._room.finer
        runner = Runner(budget, self.memory, areas, rng)
        skills.look()
        plan = None
        for plan in self._planner.plan(self._request(subtask, skills)):
            yield plan
        finished = plan is not None and bool(plan.calls)
        if plan is not None and plan.calls:
            held = skills.experience.held
            predicted = read(plan.calls, base_type(held.object_type) if held else "")
            for call in predicted.unsupported:
                finished = False
                yield SkillResult(call=call, ok=False, reason="CAPEAM has no sub-goal for it")
            frames = predicted.frames
            for number, frame in enumerate(frames):
                if not (yield from runner.frame(frame, frames[number + 1 :])):
                    finished = False
                    break
        yield Outcome(finished=finished, resident=(), handled_ids=skills.experience.handled_ids)

    def _request(self, subtask: SubTask, skills: Skills) -> PlanRequest:
        """Return what the planner is told: the instruction and the hand."""
        self._room.floor.observe(self.memory.seen.values())
        told = self._room.floor if self.settings.furniture else None
        return request_for(subtask.instruction, skills.experience.held, told)
