"""CAPEAM-style (after Kim et al. 2023): frames from a context, a memory of the environment.

The memory is of objects instead of pictures, over one sequence of instructions.

The source's networks are not rebuilt; what stands for them is in docs/plugins/baselines.md.
"""

import math
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from karma.agent.body.search import cover
from karma.household.pieces import base_type
from karma.household.types import object_types
from karma.household.uses import FOUND_BY_SKILL, covers
from karma.plugins.baselines.baseline import (
    BaselineSettings,
    MappedEpisode,
    MappedRoom,
    PlannerRow,
    RoomMemory,
    RowBody,
    likely_places,
)
from karma.plugins.baselines.capeam_frames import ProgramReader, SubGoal, expand
from karma.types.events import Outcome, Plan, SkillResult
from karma.types.memory import Area
from karma.types.observation import SeenObject
from karma.types.planning import SkillCall
from karma.types.roles import World
from karma.types.space import SceneRef, Vec3
from karma.types.tasks import SubTask

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


class Runner(RowBody[EnvironmentMemory]):
    """Carries out the frames of one instruction.

    `room` tells where to look from; once that was in vain, from where every cell is near.
    """

    def __init__(
        self,
        world: World,
        room: MappedRoom[EnvironmentMemory],
        settings: BaselineSettings,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(world, room.memory, settings)
        self._room, self._areas = room, room.floor.areas()
        self._finer = False  # whether cells between the areas count by now
        self._rng = rng
        self._searched: set[str] = set()  # places looked at for this sub-goal
        self._bound: dict[str, str] = {}  # type -> the object that this sub-goal means

    def frame(self, frame: SubGoal, rest: Sequence[SubGoal]) -> Work:
        """Carry out one sub-goal; the pointer into its actions moves on success only.

        `rest`, the sub-goals after it, tell where a thing is to go.
        """
        self._begin(frame, rest)
        steps: tuple[SkillCall, ...] = ()
        while not steps and not self.is_spent:
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
        while pointer < len(steps) and not self.is_spent:
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
        result = self.run(SkillCall.of(step.skill, *names))
        yield result
        if not result.ok:
            self.failures += 1
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
        known = held is not None or self.is_known_tap(name)
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
        while self.memory.best(kind) is None and not self.is_spent:
            place = self._draw(kind, first)
            if place is None:
                self.failures += 1
                if not self._finer:
                    self._areas, self._finer = (*self._areas, *_between(self._room)), True
                return False
            # a look for a thing ends at the first one, which may be one that is passed over
            name = "" if self.memory.passes_over(kind) else kind
            result = self.search(name, place)
            if isinstance(place, Area):
                self.memory.explored.add(place.name)
            self._searched.add(place.name if isinstance(place, Area) else place.object_id)
            if result.actions or result.explorations:  # else it was looked at before
                yield result
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


def _between(room: MappedRoom[EnvironmentMemory]) -> Iterator[Area]:
    """Yield places to look from between the areas of a room."""
    looked = [(x, z) for x, _, z in (area.position_m for area in room.floor.areas())]
    for number, point in enumerate(cover(room.cells, looked, FINER_M), start=1):
        yield Area(name=f"finer_{number}", position_m=point)


class CapeamMethod(PlannerRow):
    """The `capeam` row: the planner's program is only read for frames."""

    name = "CAPEAM-style"
    settings_kind: ClassVar[type] = BaselineSettings

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "CapeamEpisode":
        """Start an episode: an empty map."""
        return CapeamEpisode(EnvironmentMemory, self, world, scene, seed)


class CapeamEpisode(MappedEpisode[EnvironmentMemory]):
    """One sequence of instructions; each room has its own map."""

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Predict the frames once, then carry them out until one cannot be."""
        if subtask.is_whole:  # what it put where is to be passed over within one task only
            self.memory.put.clear()
        runner = Runner(self._world, self._room, self.settings, self._draws("capeam"))
        self._number += 1
        plan = yield from self._ask(runner, subtask.instruction)
        finished = plan is not None
        if plan is not None:
            held = runner.skills.experience.held
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
        handled = runner.skills.experience.handled_ids
        yield Outcome(finished=finished, resident=(), handled_ids=handled)
