"""CAPEAM-style (after Kim et al. 2023): frames from a context, a memory of the environment.

The source's networks are not rebuilt; what stands for them is in docs/methods.md.
"""

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from karma.agent.body.search import cover
from karma.agent.body.skills import Skills
from karma.agent.options import settings_of
from karma.agent.planning.planner import Planner
from karma.agent.tour import floor_of, position_of
from karma.bench.rows.baseline import Budget, RoomByRoom, is_known_tap, request_for
from karma.bench.rows.capeam.frames import ProgramReader, SubGoal, expand
from karma.bench.rows.capeam.memory import EnvironmentMemory
from karma.contracts import (
    Area,
    Outcome,
    Plan,
    PlanRequest,
    Resources,
    SceneRef,
    SeenObject,
    SkillCall,
    SkillResult,
    SubTask,
    World,
)
from karma.household.pieces import base_type
from karma.household.uses import FOUND_BY_SKILL
from karma.memory.scene_graph import SceneGraph
from karma.seeds import stream

UNIFORM_STEPS = 30  # so early nothing is known that could tell areas apart
_OF_THE_THING = ("Pickup", "Slice", "ToggleOn", "ToggleOff")  # acts on what must be found first

Work = Generator[SkillResult, None, bool]  # returns whether it worked


class Runner:
    """Carries out the frames of one instruction.

    `areas`: where to look from, and once that was in vain, where to look from then.
    """

    def __init__(
        self,
        budget: Budget,
        memory: EnvironmentMemory,
        areas: tuple[Sequence[Area], Sequence[Area]],
        rng: np.random.Generator,
    ) -> None:
        self.skills, self.memory, self.budget = budget.skills, memory, budget
        self._areas, self._finer = areas
        self._rng = rng
        self._searched: set[str] = set()  # places looked at for this sub-goal
        self._bound: dict[str, str] = {}  # type -> the object that this sub-goal means

    def frame(self, frame: SubGoal, rest: Sequence[SubGoal]) -> Work:
        """Carry out one sub-goal; the pointer into its actions moves on success only.

        `rest`, the sub-goals after it, tell where a thing is to go.
        """
        self._begin(frame, rest)
        steps: tuple[SkillCall, ...] = ()
        while not steps and not self.budget.is_spent:
            if frame.action in _OF_THE_THING and self._held(frame.thing) is None:
                if not (yield from self._find(frame.thing, first=frame.place)):
                    continue
                target = self.memory.best(frame.thing)
                holder = self.memory.shut_in(target) if target is not None else None
                box = holder.object_type if holder is not None else ""
                if holder is not None:
                    self._bound[box] = holder.object_id
                steps = expand(frame, shut_in=box)
            elif frame.action == "Pickup":
                return True
            else:
                place = frame.place or self.memory.surface(frame.thing)
                frame = SubGoal(action=frame.action, thing=frame.thing, place=place)
                steps = expand(frame)
        pointer = 0
        while pointer < len(steps) and not self.budget.is_spent:
            pointer += yield from self._step(steps[pointer])
        return bool(steps) and pointer == len(steps)

    def _begin(self, frame: SubGoal, rest: Sequence[SubGoal]) -> None:
        goes_to = next((f.place for f in rest if f.action == "Put" and f.thing == frame.thing), "")
        taking = frame.action == "Pickup"
        self.memory.begin_subgoal(frame.thing if taking else "", goes_to)
        self._searched, self._bound = set(), {}

    # ------------------------------------------------------------- one action

    def _step(self, step: SkillCall) -> Work:
        """Do one action on the objects that the sub-goal means; a failure masks the one it hit."""
        for name in step.objects:
            if name not in self._bound and not (yield from self._bind(name)):
                return False
        names = [name if name in FOUND_BY_SKILL else self._bound[name] for name in step.objects]
        sight = self.memory.seen.get(names[-1])
        if step.skill == "OpenObject" and sight is not None and "opened" in sight.states:
            return True
        held = self.skills.experience.held
        call = SkillCall.of(step.skill, *names)
        result = self.skills.run(call, max_actions=self.budget.left)
        self._look()
        yield result
        if not result.ok:
            self.budget.failures += 1
            self.memory.masked.add(names[-1])
            self._bound.pop(step.objects[-1], None)
        elif step.skill == "PutObject" and held is not None:
            self.memory.was_put(step.objects[0], step.objects[1], held.object_id)
        elif step.skill == "SliceObject":
            self.memory.sliced_at[step.objects[0]] = self.memory.here()
        return result.ok

    def _bind(self, name: str) -> Work:
        """Choose the object that a type means in this sub-goal: what is held, or the nearest."""
        held = self._held(name)
        known = held is not None or is_known_tap(name, self.skills)
        if not known and not (yield from self._find(name)):
            return False
        target = held or self.memory.best(name)
        self._bound[name] = target.object_id if target is not None else name
        return True

    def _held(self, name: str) -> SeenObject | None:
        held = self.skills.experience.held
        if held is None or name not in (held.object_type, base_type(held.object_type)):
            return None
        return held

    def _look(self) -> None:
        self.memory.observe(self.skills.experience)

    # ------------------------------------------------------------- exploring

    def _find(self, kind: str, *, first: str = "") -> Work:
        """Look for a type until the map has one; False when everything was looked at in vain.

        What was looked at in vain is passed over until the next sub-goal.

        `first`: type of a closed receptacle that the program opens for it.
        """
        while self.memory.best(kind) is None and not self.budget.is_spent:
            place = self._draw(kind, first)
            if place is None:
                self.budget.failures += 1
                self._areas = (*self._areas, *self._finer)
                self._finer = ()
                return False
            # a look for a thing ends at the first one, which may be one that is passed over
            name = "" if self.memory.passes_over(kind) else kind
            if isinstance(place, Area):
                result = self.skills.look_from(name, place, max_actions=self.budget.left)
                self.memory.explored.add(place.name)
                self._searched.add(place.name)
            else:
                result = self.skills.look_into(name, place, max_actions=self.budget.left)
                self._searched.add(place.object_id)
            if result.actions or result.explorations:  # else it was looked at before
                yield result
            self._look()
        return self.memory.best(kind) is not None

    def _draw(self, kind: str, first: str) -> Area | SeenObject | None:
        """Draw the place to look at next, by how likely the type is there; None without any left.

        Areas never seen come before those where the map would show it.
        """
        left = [area for area in self._areas if area.name not in self._searched]
        new = [area for area in left if area.name not in self.memory.explored]
        shut = [(o, w) for o, w in self.memory.closed(kind) if o.object_id not in self._searched]
        for one, _ in shut:
            if one.object_type == first:
                return one
        areas = new or ([] if shut else left)
        places: list[Area | SeenObject] = [*areas, *(one for one, _ in shut)]
        if not places:
            return None
        if self.skills.actions < UNIFORM_STEPS and not self.memory.explored:
            return areas[int(self._rng.integers(len(areas)))] if areas else places[0]
        weights = np.array([*self.memory.weights(kind, areas), *(weight for _, weight in shut)])
        return places[int(self._rng.choice(len(places), p=weights / weights.sum()))]


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

    The planner's program is only read for frames, never mended.
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

        KarmaError if an option is unknown or of the wrong type.
        """
        settings = settings_of(CapeamSettings, options)
        return cls(Planner.of(resources), settings)

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "CapeamEpisode":
        """Start an episode: an empty map."""
        return CapeamEpisode(self, world, scene, seed)


class CapeamEpisode(RoomByRoom[_CapeamRoom]):
    """One sequence of instructions; each room has its own map."""

    def __init__(self, method: CapeamMethod, world: World, scene: SceneRef, seed: int) -> None:
        super().__init__(world, scene, _CapeamRoom.of)
        self.settings, self._planner, self._seed = method.settings, method.planner, seed
        self._number = 0  # of the instruction

    @property
    def memory(self) -> EnvironmentMemory:
        """The map of the room that the agent is in."""
        return self._room.memory

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
            hand = base_type(held.object_type) if held else ""
            predicted = ProgramReader(plan.calls, hand=hand)
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
