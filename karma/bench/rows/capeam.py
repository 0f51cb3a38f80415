"""CAPEAM-style (after Kim et al. 2023): frames from a context, a memory of the environment.

The memory is of objects instead of pictures, over one sequence of instructions.

The source's networks are not rebuilt; what stands for them is in docs/methods.md.
"""

import math
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from karma.agent.body.search import cover
from karma.agent.body.skills import Skills
from karma.agent.options import settings_of
from karma.agent.planning.planner import Planner
from karma.agent.tour import floor_of, position_of
from karma.bench.rows.baseline import (
    Budget,
    RoomByRoom,
    RoomMemory,
    is_known_tap,
    likely_places,
    request_for,
)
from karma.bench.rows.capeam_frames import ProgramReader, SubGoal, expand
from karma.contracts import (
    Area,
    Outcome,
    Plan,
    Resources,
    SceneRef,
    SeenObject,
    SkillCall,
    SkillResult,
    SubTask,
    Vec3,
    World,
)
from karma.household.pieces import base_type
from karma.household.types import object_types
from karma.household.uses import FOUND_BY_SKILL, covers
from karma.memory.scene_graph import SceneGraph
from karma.seeds import stream

NEAR_M = 1.5  # furniture this near to an area speaks for it
ANYWHERE = 0.05  # what a place weighs of which nothing is known
UNIFORM_STEPS = 30  # so early nothing is known that could tell areas apart
_OF_THE_THING = ("Pickup", "Slice", "ToggleOn", "ToggleOff")  # acts on what must be found first

Work = Generator[SkillResult, None, bool]  # returns whether it worked


@dataclass
class EnvironmentMemory(RoomMemory):
    """Maps the objects of one room that were seen, and where the agent cut and put them."""

    put: dict[tuple[str, str], list[str]] = field(default_factory=dict)  # thing, place -> ids
    sliced_at: dict[str, Vec3] = field(default_factory=dict)  # type -> where it was cut
    explored: set[str] = field(default_factory=set)  # areas looked round from
    masked: set[str] = field(default_factory=set)  # ids that this sub-goal passes over

    # ------------------------------------------------------------- writing

    def was_put(self, thing: str, place: str, object_id: str) -> None:
        """Note where a thing was put."""
        ids = self.put.setdefault((thing, place), [])
        if object_id not in ids:
            ids.append(object_id)

    def begin_subgoal(self, thing: str = "", place: str = "") -> None:
        """Set the objects to ignore: only things of a type that already are at a type of place."""
        self.masked = set(self.put.get((thing, place), ()))

    # ------------------------------------------------------------- reading

    def best(self, name: str) -> SeenObject | None:
        """Return the nearest object of a type or piece of one that is not masked.

        Of what was cut the pieces count, the nearest to where that was.
        """
        cut = self.sliced_at.get(name)
        x, _, z = cut or self.here()

        def rank(one: SeenObject) -> tuple[bool, float, str]:
            whole = cut is not None and one.object_type == name
            at = one.box_center_m
            return whole, round(math.dist((at[0], at[2]), (x, z)), 3), one.object_id

        fitting = [one for one in self._all(name) if one.object_id not in self.masked]
        return min(fitting, key=rank, default=None)

    def passes_over(self, kind: str) -> bool:
        """Return whether an object of this type is masked."""
        return any(one.object_id in self.masked for one in self._all(kind))

    def _all(self, kind: str) -> list[SeenObject]:
        return [one for one in self.seen.values() if covers(kind, one.object_type)]

    # ------------------------------------------------------------- where to look

    def weights(self, kind: str, areas: Iterable[Area]) -> list[float]:
        """Return how likely a thing of a type is near each area, from the furniture seen there."""
        shares = likely_places(kind)
        found = []
        for area in areas:
            near = {
                one.object_type for one in self.seen.values() if _gap(one, area.position_m) < NEAR_M
            }
            found.append(ANYWHERE + sum(shares.get(name, 0.0) for name in sorted(near)))
        return found

    def closed(self, kind: str) -> list[tuple[SeenObject, float]]:
        """Return the closed receptacles that can hold a type, by id, and how likely it is there."""
        shares, kinds = likely_places(kind), object_types()
        thing = kinds.get(kind)
        if thing is None or not thing.can("pickupable"):
            return []
        shut = [
            one
            for _, one in sorted(self.seen.items())
            if "closed" in one.states and (box := kinds.get(one.object_type)) is not None
            if box.can("receptacle") and thing.fits(box)
        ]
        types = [one.object_type for one in shut]
        return [
            (one, (ANYWHERE + shares.get(one.object_type, 0.0)) / types.count(one.object_type))
            for one in shut
        ]


def _gap(one: SeenObject, point: Vec3) -> float:
    gaps = (
        max(abs(point[axis] - one.box_center_m[axis]) - one.box_size_m[axis] / 2, 0.0)
        for axis in (0, 2)
    )
    return math.hypot(*gaps)


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
        self.memory.observe(self.skills.experience)
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
            self.memory.observe(self.skills.experience)
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
        self.planner = planner.drawn_by(replace(planner.decoding, inspected=False))

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
        self._room.floor.observe(self.memory.seen.values())
        furniture = self._room.floor if self.settings.furniture else None
        request = request_for(subtask.instruction, skills.experience.held, furniture)
        for plan in self._planner.plan(request):
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
