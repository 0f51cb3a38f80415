"""CAPEAM-style (after Kim et al. 2023): frames from a context, a memory of the environment.

The source's networks are not rebuilt; what stands for them is in docs/methods-capeam.md.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from karma.agent.planner import Planner
from karma.agent.prompt import Facts
from karma.agent.search import cover
from karma.agent.skills import Skills
from karma.contracts import Area, Outcome, Plan, SkillResult, SubTask, World
from karma.household.pieces import base_type
from karma.memory.scene_graph import SceneGraph
from karma.methods.capeam.frames import read
from karma.methods.capeam.memory import EnvironmentMemory
from karma.methods.capeam.run import Limits, Runner
from karma.methods.resources import Kit, settings_of
from karma.methods.tour import cells_of, position_of
from karma.seeds import stream

FINER_M = 0.5  # every cell is this near to a place of the second round, as in KARMA's own search


@dataclass(frozen=True, slots=True, kw_only=True)
class CapeamSettings:
    """The numbers of the source."""

    failures: int = 10  # of one instruction
    steps: int = 1000  # world actions of one instruction
    furniture: bool = False  # whether the planner is told what furniture was seen; the source's not


@dataclass(frozen=True, slots=True, kw_only=True)
class _Room:
    """The map of one room."""

    memory: EnvironmentMemory
    floor: SceneGraph
    finer: tuple[Area, ...]

    @classmethod
    def of(cls, world: World) -> Self:
        """Return the empty map of the room that the agent is in."""
        cells, height = cells_of(world), position_of(world)[1]
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

    def __init__(self, planner: Planner, settings: CapeamSettings | None = None) -> None:
        self.settings = settings or CapeamSettings()
        decoding = replace(planner.decoding, inspected=False)
        self._planner = Planner(planner.model, planner.profile, decoding)
        self.memory = EnvironmentMemory(here=lambda: (0.0, 0.0, 0.0))
        self._world: World | None = None

    @classmethod
    def build(cls, kit: Kit, options: Mapping[str, Any]) -> Self:
        """Make the row from its options (the fields of `CapeamSettings`).

        Raises:
            KarmaError: an option is unknown or of the wrong type.
        """
        return cls(kit.planner, settings_of(CapeamSettings, options))

    def begin(self, world: World, scene: str, *, seed: int, folder: Path) -> None:
        """Start an episode: an empty map."""
        self._world, self._seed = world, seed
        self._number = 0  # of the instruction
        self._rooms: dict[str, _Room] = {}
        self.enter(scene)

    def enter(self, scene: str) -> None:
        """Be in a room: each has a map of its own."""
        if self._world is None:
            raise RuntimeError("begin an episode first")
        self._scene = Path(scene).stem
        if self._scene not in self._rooms:
            self._rooms[self._scene] = _Room.of(self._world)
        room = self._rooms[self._scene]
        self.memory, self._floor, self._finer = room.memory, room.floor, room.finer

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Predict the frames once, then carry them out until one cannot be."""
        if self._world is None:
            raise RuntimeError("begin an episode first")
        if subtask.is_whole:  # what it put where is to be passed over within one task only
            self.memory.put.clear()
        rng = stream(self._seed, "capeam", self._scene, str(self._number))
        self._number += 1
        skills = Skills(self._world, self.memory)
        limits = Limits(failures=self.settings.failures, steps=self.settings.steps)
        runner = Runner(
            skills, self.memory, areas=(self._floor.areas(), self._finer), rng=rng, limits=limits
        )
        skills.look()
        plan = None
        for plan in self._planner.plan(self._facts(subtask, skills)):
            yield plan
        finished = plan is not None and not plan.error
        if plan is not None and not plan.error:
            held = base_type(skills.held.object_type) if skills.held else ""
            predicted = read(plan.calls, held)
            for call in predicted.unsupported:
                finished = False
                yield SkillResult(call=call, ok=False, reason="CAPEAM has no sub-goal for it")
            frames = predicted.frames
            for number, frame in enumerate(frames):
                if not (yield from runner.frame(frame, frames[number + 1 :])):
                    finished = False
                    break
        yield Outcome(finished=finished, resident=(), handled_ids=tuple(skills.handled))

    def _facts(self, subtask: SubTask, skills: Skills) -> Facts:
        """Return what the planner is told: the instruction and the hand."""
        self._floor.observe(self.memory.seen.values())
        told = self.settings.furniture
        return Facts(
            instruction=subtask.instruction,
            areas=self._floor.areas() if told else (),
            graph_text=self._floor.to_text() if told else "",
            held_id=skills.held.object_id if skills.held else None,
            held_type=skills.held.object_type if skills.held else None,
        )
