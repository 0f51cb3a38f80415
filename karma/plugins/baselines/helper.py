"""HELPER (Sarch et al. 2023), rebuilt: examples for the planner, an object memory for the body.

Where it deviates from its source is in docs/plugins/baselines.md.
"""

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np

from karma.agent.options import settings_of
from karma.agent.planning.planner import Planner
from karma.agent.planning.program import parse_program
from karma.agent.tour import position_of
from karma.errors import FileError, KarmaError, ProgramError
from karma.files import read_toml
from karma.household.uses import FOUND_BY_SKILL
from karma.loading.planner_files import ExampleMemory
from karma.plugins.baselines.baseline import (
    BaselineSettings,
    MappedEpisode,
    PlannerRow,
    RowBody,
    likely_places,
)
from karma.plugins.baselines.helper_memory import (
    ObjectMemory,
    ends_there,
    idle,
    whole_first,
    with_object,
    without_object,
)
from karma.types.events import Outcome, Plan, SkillResult
from karma.types.memory import Area
from karma.types.observation import SeenObject
from karma.types.planning import SkillCall, WorkedExample
from karma.types.roles import Embedder, Resources, World
from karma.types.space import SceneRef, Vec3
from karma.types.tasks import SubTask

LIKELY = 3  # kinds of places asked for
INSTANCES = 2  # of each kind
NEAR_STEPS = 75  # for one of those
POINT_STEPS = 50  # for one point anywhere
POINTS = 20

Ending = Literal["done", "failed", "skipped"]
Deed = Generator[SkillResult, None, bool]  # returns whether it worked


class Executor(RowBody[ObjectMemory]):
    """Carries out sub-goals of one instruction.

    `points`: cells to stand on, for looking anywhere; `rng` draws among them.
    """

    def __init__(
        self,
        world: World,
        memory: ObjectMemory,
        settings: BaselineSettings,
        points: Sequence[Vec3],
        rng: np.random.Generator,
    ) -> None:
        super().__init__(world, memory, settings)
        self.last_error = ""
        self._points, self._rng = points, rng
        self._landmark = ""  # what was opened last and not closed since
        self._put = ""  # what was put down last

    def subgoal(
        self, call: SkillCall, rest: Sequence[SkillCall]
    ) -> Generator[SkillResult, None, Ending]:
        """Carry out one sub-goal, yielding everything done for it; returns what came of it."""
        if any(name in self.memory.could_not_find for name in call.objects):
            return "skipped"
        first = whole_first(call, self.memory)
        for step in [*([first] if first else []), call]:
            if not (yield from self._repaired(step)):
                return "failed"
        if call.skill == "PutObject" and len(call.objects) == 2 and ends_there(call, rest):
            self.memory.finish(self._put)
        return "done"

    # ------------------------------------------------------------- the inspector at work

    def _repaired(self, call: SkillCall) -> Deed:
        """Do what must come first, then the call itself."""
        for step in [*without_object(call, self.skills.experience.held, self.memory), call]:
            if not (yield from self._located(step)):
                return False
            ready = self._ground(step)
            if idle(ready, self.memory) or step.skill == "Explore":
                continue
            for deed in [*with_object(ready, self.memory), ready]:
                if not (yield from self._do(deed)):
                    return False
        return True

    def _ground(self, call: SkillCall) -> SkillCall:
        """Put the ids of the best known objects in place of types."""
        best = {name: self.memory.best(name) for name in call.objects if name not in FOUND_BY_SKILL}
        names = {name: one.object_id for name, one in best.items() if one is not None}
        return replace(call, objects=tuple(names.get(name, name) for name in call.objects))

    def _do(self, call: SkillCall) -> Deed:
        """Run one skill and write down what came of it."""
        held = self.skills.experience.held
        result = self.run(call)
        yield result
        if not result.ok:
            self.memory.failed(call.objects[-1])
            self._fail(call, result.reason)
        elif call.skill == "PutObject" and held is not None:
            self._put = held.object_id
            self.memory.placed(held.object_id)
        elif call.skill in ("OpenObject", "CloseObject"):
            self._landmark = call.objects[0] if call.skill == "OpenObject" else ""
        return result.ok

    def _fail(self, call: SkillCall, reason: str) -> None:
        self.failures += 1
        self.last_error = f"Failed sub-goal: {call}. Error: {reason}"

    # ------------------------------------------------------------- the locator

    def _located(self, call: SkillCall) -> Deed:
        """Look for what is not in memory: near the landmark, where it is likely, anywhere."""
        near = [place for place in call.positions if isinstance(place, str)]
        for name in call.objects:
            if self.is_known_tap(name) or self.memory.best(name) is not None:
                continue
            for place in self._places(name, near):
                yield self._look_at(name, place)
                if self.memory.best(name) is not None or self.is_spent:
                    break
            if self.memory.best(name) is None:
                self.memory.could_not_find.add(name)
                self._fail(call, f"could not find {name}")
                return False
        return True

    def _places(self, name: str, near: Sequence[str]) -> Iterator[SeenObject | Area]:
        """Yield places to look at: landmarks, likely furniture, then cells drawn at random."""
        marks = [*near, *([self._landmark] if self._landmark else [])]
        tried: set[str] = set()
        for kind in [*marks, *list(likely_places(name))[:LIKELY]]:
            for one in self.memory.of(kind)[:INSTANCES]:
                if one.object_id not in tried:
                    tried.add(one.object_id)
                    yield one
        order = self._rng.permutation(len(self._points))[:POINTS]
        for number in order:
            yield Area(name=f"point_{number}", position_m=self._points[number])

    def _look_at(self, name: str, place: SeenObject | Area) -> SkillResult:
        if isinstance(place, Area):
            return self.search(name, place, POINT_STEPS)
        if "closed" not in place.states:
            place = Area(name=place.object_id, position_m=place.box_center_m)
        return self.search(name, place, NEAR_STEPS)


TRIES = 2  # of one sub-goal: the second on the next instance
TABLE = Path(__file__).parent / "helper_examples.toml"


@dataclass(frozen=True, slots=True, kw_only=True)
class HelperSettings(BaselineSettings):
    """The numbers of the source."""

    examples: int = 3  # retrieved for a program
    explore_steps: int = 150  # world actions of the first look round a home, of `steps`
    failures: int = 30
    corrections: float = 2 / 3  # share of the failures after which the planner is not asked again


class HelperMethod(PlannerRow):
    """The `helper` row; HELPER has an inspector of its own."""

    name = "HELPER"
    settings_kind: ClassVar[type] = HelperSettings

    def __init__(self, planner: Planner, embedder: Embedder, settings: HelperSettings) -> None:
        super().__init__(planner, settings)
        self.examples, self.errors = (ExampleMemory(embedder, rows) for rows in seed_examples())

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row from its options (the fields of `HelperSettings`).

        KarmaError if an option is unknown or of the wrong type, or there is no text embedder.
        """
        settings = settings_of(HelperSettings, options)
        if resources.embedder is None:
            raise KarmaError("helper needs a text embedder; name one: models.embedder")
        return cls(Planner.of(resources), resources.embedder, settings)

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "HelperEpisode":
        """Start an episode: no objects known, no examples but the seeds."""
        return HelperEpisode(self, world, scene, seed)


class HelperEpisode(MappedEpisode[ObjectMemory]):
    """One sequence of instructions; objects are remembered by room, examples for all rooms."""

    def __init__(self, method: HelperMethod, world: World, scene: SceneRef, seed: int) -> None:
        super().__init__(ObjectMemory, method, world, scene, seed)
        self.examples, self._errors = method.examples.copy(), method.errors

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Explore if the room is new; then plan, act, correct once, and learn the example."""
        self.memory.begin_instruction()
        height = position_of(self._world)[1]
        points = [(x, height, z) for x, z in sorted(self._room.cells)]
        body = Executor(self._world, self.memory, self.settings, points, self._draws("helper"))
        if not self.memory.explored:
            self.memory.explored = True
            yield from self._explore(body)
        self._number += 1
        examples = self.examples.nearest(subtask.instruction, self.settings.examples)
        plan = yield from self._ask(body, subtask.instruction, examples=examples)
        done: list[SkillCall] = []
        finished = plan is not None and (yield from self._carry_out(body, subtask, plan, done))
        if done:
            program = "\n".join(map(str, done))
            self.examples.add(WorkedExample(instruction=subtask.instruction, program=program))
        handled = body.skills.experience.handled_ids
        yield Outcome(finished=finished, resident=(), handled_ids=handled)

    def _explore(self, body: Executor) -> Iterator[SkillResult]:
        """Walk from area to area, the nearest next, and look around, until the budget is spent."""
        rest = list(self._room.floor.areas())
        while (left := self.settings.explore_steps - body.skills.actions) > 0 and rest:
            x, _, z = self.memory.here()
            rest.sort(
                key=lambda a: ((a.position_m[0] - x) ** 2 + (a.position_m[2] - z) ** 2, a.name)
            )
            yield body.skills.look_for("", rest.pop(0), max_actions=left)
            self.memory.observe(body.skills.experience)

    def _carry_out(
        self, body: Executor, subtask: SubTask, plan: Plan, done: list[SkillCall]
    ) -> Generator[Plan | SkillResult, None, bool]:
        """Run sub-goals: after a failure ask once for a better program, then try the next instance.

        Returns whether every sub-goal of the last program was done.
        """
        queue, corrected, finished = list(plan.calls), False, True
        tries = 0
        while queue and not body.is_spent:
            ending = yield from body.subgoal(queue[0], queue[1:])
            fails = body.failures
            may_ask = fails < self.settings.corrections * self.settings.failures
            if ending == "failed" and not corrected and may_ask:
                corrected = True
                errors = self._errors.nearest(body.last_error, self.settings.examples)
                better = yield from self._ask(
                    body, subtask.instruction, error=body.last_error, examples=errors
                )
                if better is not None:
                    queue, finished, tries = list(better.calls), True, 0
                    continue
            tries += ending == "failed"
            if ending == "failed" and tries < TRIES:
                continue
            finished = finished and ending == "done"
            if ending == "done":
                done.append(queue[0])
            queue.pop(0)
            tries = 0
        return finished and not queue


def seed_examples() -> tuple[tuple[WorkedExample, ...], tuple[WorkedExample, ...]]:
    """Return the examples to begin with, and the error examples.

    FileError if the table is damaged, or a program in it does not parse.
    """
    table = read_toml(TABLE, dict[str, tuple[WorkedExample, ...]])
    return _examples(table["examples"]), _examples(table["errors"])


def _examples(rows: Sequence[WorkedExample]) -> tuple[WorkedExample, ...]:
    for row in rows:
        try:
            parse_program(row.program)
        except ProgramError as error:
            raise FileError(TABLE, f"example {row.instruction!r}: {error}") from error
    return tuple(replace(row, program=row.program.strip()) for row in rows)
