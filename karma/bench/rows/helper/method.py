"""HELPER (Sarch et al. 2023), rebuilt: examples for the planner, an object memory for the body.

Where it deviates from its source is in docs/methods.md.
"""

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from karma.agent.body.skills import Skills
from karma.agent.loading.examples import ExampleMemory
from karma.agent.options import settings_of
from karma.agent.planning.planner import Planner
from karma.agent.planning.program import parse_program
from karma.agent.planning.prompt import GOALS
from karma.agent.tour import floor_of, position_of
from karma.bench.rows.baseline import Budget, request_for
from karma.bench.rows.helper.memory import ObjectMemory
from karma.bench.rows.helper.run import Executor
from karma.contracts import (
    Embedder,
    Outcome,
    Plan,
    Resources,
    SceneRef,
    SkillCall,
    SkillResult,
    SubTask,
    Vec3,
    WorkedExample,
    World,
)
from karma.errors import FileError, KarmaError, ProgramError
from karma.files import read_toml
from karma.memory.scene_graph import SceneGraph
from karma.seeds import stream

TRIES = 2  # of one sub-goal: the second on the next instance
TABLE = Path(__file__).parent / "examples.toml"


@dataclass(frozen=True, slots=True, kw_only=True)
class HelperSettings:
    """The numbers of the source."""

    examples: int = 3  # retrieved for a program
    explore_steps: int = 150  # world actions of the first look round a home
    steps: int = 1000  # world actions of one instruction, exploring included
    failures: int = 30  # of one instruction
    corrections: float = 2 / 3  # share of the failures after which the planner is not asked again
    furniture: bool = False  # whether the planner is told what furniture was seen; the source's not


@dataclass(slots=True, kw_only=True)
class _HelperRoom:
    """What is known of one room."""

    memory: ObjectMemory
    cells: list[Vec3]
    floor: SceneGraph
    explored: bool = False  # looked round once

    @classmethod
    def of(cls, world: World) -> Self:
        """Return the knowledge of a room at the first visit: its floor and no objects."""
        cells, height = sorted(floor_of(world)), position_of(world)[1]
        return cls(
            memory=ObjectMemory(here=lambda: position_of(world)),
            cells=[(x, height, z) for x, z in cells],
            floor=SceneGraph.over(cells, height_m=height),
        )


class HelperMethod:
    """The `helper` row.

    Args:
        planner: model and prompt profile; its own inspector stays off, HELPER has one.
        embedder: of instructions, for the example memory.
        settings: its numbers.
    """

    name = "HELPER"
    settings_kind: ClassVar[type] = HelperSettings

    def __init__(
        self, planner: Planner, embedder: Embedder, settings: HelperSettings | None = None
    ) -> None:
        self.settings = settings or HelperSettings()
        decoding = replace(planner.decoding, inspected=False)
        self.planner = planner.drawn_by(decoding)
        examples, errors = seed_examples()
        self.examples = ExampleMemory(embedder, examples)
        self.errors = ExampleMemory(embedder, errors)

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row from its options (the fields of `HelperSettings`).

        Raises:
            KarmaError: an option is unknown or of the wrong type, there is no text embedder, or
                the planner is asked for goals.
        """
        settings = settings_of(HelperSettings, options)
        if resources.profile == GOALS:
            raise KarmaError('helper\'s examples are programs; name models.profile = "full"')
        if resources.embedder is None:
            raise KarmaError("helper needs a text embedder; name one: models.embedder")
        return cls(Planner.of(resources), resources.embedder, settings)

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "HelperEpisode":
        """Start an episode: no objects known, no examples but the seeds."""
        return HelperEpisode(self, world, scene, seed)


class HelperEpisode:
    """One sequence of instructions, in a world reset to its first room.

    Objects are remembered by room, examples for all rooms.
    """

    def __init__(self, method: HelperMethod, world: World, scene: SceneRef, seed: int) -> None:
        self.settings, self.examples = method.settings, method.examples.copy()
        self._planner, self._errors = method.planner, method.errors
        self._world, self._seed = world, seed
        self._number = 0  # of the instruction
        self._scene, self._room = scene, _HelperRoom.of(world)
        self._rooms = {scene: self._room}

    @property
    def memory(self) -> ObjectMemory:
        """What is known of the objects of the room that the agent is in."""
        return self._room.memory

    def enter(self, scene: SceneRef) -> None:
        """Go on in a room, with the objects of earlier visits."""
        if scene not in self._rooms:
            self._rooms[scene] = _HelperRoom.of(self._world)
        self._scene, self._room = scene, self._rooms[scene]

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Explore if the room is new; then plan, act, correct once, and learn the example."""
        self.memory.begin_instruction()
        body = self._executor()
        if not self._room.explored:
            self._room.explored = True
            yield from self._explore(body)
        self._number += 1
        examples = self.examples.nearest(subtask.instruction, self.settings.examples)
        plan = yield from self._ask(body, subtask, examples, "")
        done: list[SkillCall] = []
        finished = plan is not None and (yield from self._carry_out(body, subtask, plan, done))
        if done:
            program = "\n".join(map(str, done))
            self.examples.add(WorkedExample(instruction=subtask.instruction, program=program))
        handled = body.skills.experience.handled_ids
        yield Outcome(finished=finished, resident=(), handled_ids=handled)

    def _executor(self) -> Executor:
        skills = Skills(self._world, self.memory)
        budget = Budget(skills, self.settings.steps, self.settings.failures)
        rng = stream(self._seed, "helper", self._scene.name, str(self._number))
        return Executor(budget, self.memory, self._room.cells, rng)

    def _explore(self, body: Executor) -> Iterator[SkillResult]:
        """Walk from area to area, the nearest next, and look around, until the budget is spent."""
        rest = list(self._room.floor.areas())
        while rest and body.skills.actions < self.settings.explore_steps:
            x, _, z = self.memory.here()
            rest.sort(
                key=lambda a: ((a.position_m[0] - x) ** 2 + (a.position_m[2] - z) ** 2, a.name)
            )
            left = self.settings.explore_steps - body.skills.actions
            yield body.skills.look_from("", rest.pop(0), max_actions=left)
            body.look()

    # ------------------------------------------------------------- planning

    def _ask(
        self, body: Executor, subtask: SubTask, examples: tuple[WorkedExample, ...], error: str
    ) -> Generator[Plan, None, Plan | None]:
        """Ask for a program; the prompt holds no map and no memory, as in the source."""
        body.skills.look()
        self._room.floor.observe(one.sight for one in self.memory.objects.values())
        told = self._room.floor if self.settings.furniture else None
        request = request_for(
            subtask.instruction, body.skills.experience.held, told, error=error, examples=examples
        )
        answer = None
        for answer in self._planner.plan(request):
            yield answer
        return answer if answer is not None and answer.calls else None

    def _carry_out(
        self, body: Executor, subtask: SubTask, plan: Plan, done: list[SkillCall]
    ) -> Generator[Plan | SkillResult, None, bool]:
        """Run sub-goals: after a failure ask once for a better program, then try the next instance.

        Returns whether every sub-goal of the last program was done.
        """
        queue, corrected, finished = list(plan.calls), False, True
        tries = 0
        while queue and not body.budget.is_spent:
            ending = yield from body.subgoal(queue[0], queue[1:])
            fails = body.budget.failures
            may_ask = fails < self.settings.corrections * self.settings.failures
            if ending == "failed" and not corrected and may_ask:
                corrected = True
                errors = self._errors.nearest(body.last_error, self.settings.examples)
                better = yield from self._ask(body, subtask, errors, body.last_error)
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

    Raises:
        FileError: the table is damaged, or a program in it does not parse.
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
