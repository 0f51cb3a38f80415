"""Rows that the others stand between: `expert`, the ceiling; `idle` and `copying`, floors.

The expert knows all objects and goals, and shows that tasks can be solved. It is the one method
that may read a sub-task's goals and the world's hidden state. It acts by the skills that all
methods have. When one is refused it notes why, and writes another program: with another receptacle
or thing of the type, another knife, or with what is in the way put elsewhere first.

`idle` does nothing, and `copying` does what the nearest example did; neither reads a request.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from karma.agent.body.reach import SkillLimits
from karma.agent.body.skills import Skills
from karma.agent.karma import KarmaMethod
from karma.agent.options import settings_of
from karma.agent.planning.expert import solve
from karma.agent.planning.prompt import program_profile
from karma.agent.seeing.perceive import truth_of
from karma.agent.settings import KarmaSettings
from karma.bench.methods.expert_choices import Chooser, Lessons, Surroundings, left
from karma.errors import KarmaError
from karma.goals.goals import GoalTracker, WatchedWorld
from karma.household.ids import is_id, type_of
from karma.models.scripted import ScriptedModel
from karma.types.events import Outcome, Plan, SkillResult
from karma.types.memory import Area, Known
from karma.types.planning import SkillCall, WorkedExample
from karma.types.roles import Examples, Resources, World
from karma.types.space import SceneRef
from karma.types.tasks import Goal, SubTask

PROGRAMS = 24  # written for one instruction, at most
_SAME = 6  # times that the same line may be refused in the same words
_HARDER = SkillLimits(views=30, views_of_movable=30, retries=6)  # once something was refused
_OUT_OF_REACH = ("into view and reach", "remembered place", "is known", "in the closed", "gave up")


@dataclass(frozen=True, slots=True)
class NoOptions:
    """The settings of a method without options."""


class WithoutOptions:
    """A method that has no options."""

    settings_kind: ClassVar[type] = NoOptions

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the method; KarmaError for any option."""
        settings_of(NoOptions, options)
        return cls()


class ExpertMethod(WithoutOptions):
    """Writes programs from the goals and the true state, and acts by the same skills as others."""

    name = "expert"

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "ExpertEpisode":
        """Start an episode; nothing is kept from an earlier one."""
        return ExpertEpisode(world, scene)


class ExpertEpisode:
    """One sequence of instructions; what was used in each room is known."""

    def __init__(self, world: World, scene: SceneRef) -> None:
        self._tracker = GoalTracker()
        self._world = WatchedWorld(world, self._tracker)
        self._used: list[str] = []  # ids of this room, the last used last
        self._used_in = {scene: self._used}
        self._tracker.start(world.last_event)

    def enter(self, scene: SceneRef) -> None:
        """Go on in a room, with the ids of what was used there before."""
        self._used = self._used_in.setdefault(scene, [])
        self._tracker.start(self._world.last_event)

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """Act until all goals hold, nothing is left to try, or `PROGRAMS` were written."""
        if subtask.is_whole:
            self._tracker.start(self._world.last_event)
        self._tracker.begin_subtask(subtask, self._world.last_event)
        handled: list[str] = []
        lessons, limits, refusals = Lessons(), SkillLimits(), Counter[tuple[SkillCall, str]]()
        for _ in range(PROGRAMS):
            if not self._unmet(subtask):
                break
            program = self._program(subtask.goals, lessons)
            skills = Skills(self._world, _AllKnowing(self._world), limits=limits)
            used: list[str] = []
            for call in program:
                result = skills.run(call)
                used += result.object_ids
                yield result
                if not result.ok:
                    break
            handled += used
            self._used += used
            if not program or result.ok:
                refusals[SkillCall(skill="", objects=()), ""] += 2
            else:
                refusals[result.call, result.reason] += 1
                _learn(lessons, result)
                limits = _HARDER
            if max(refusals.values()) > _SAME:
                break
        yield Outcome(finished=not self._unmet(subtask), resident=(), handled_ids=tuple(handled))

    def _unmet(self, subtask: SubTask) -> tuple[Goal, ...]:
        return self._tracker.unmet(subtask.goals, self._world.last_event)

    def _program(self, goals: tuple[Goal, ...], lessons: Lessons) -> tuple[SkillCall, ...]:
        """Write the program for what is left to do, with the names bound to objects."""
        event = self._world.last_event
        around = Surroundings(truth_of(event), self._used)
        chooser = Chooser(self._tracker.meanings(event), around.rank, around.shut_in, lessons)
        bound = chooser.bound(goals)
        calls = solve(left(bound), around.view(lessons, [goal for goal, _ in bound]))
        return tuple(replace(call, exact=is_id(call.objects[-1])) for call in calls)


def _learn(lessons: Lessons, result: SkillResult) -> None:
    """Note what a refusal means for the next program."""
    call = result.call
    name, kind = call.objects[-1], type_of(call.objects[-1])
    names = {name, *(one for one in result.object_ids if type_of(one) == kind)}
    away = any(words in result.reason for words in _OUT_OF_REACH)
    if call.skill == "PutObject" and not away:
        lessons.refused.update((call.objects[0], one) for one in names)
    elif call.skill == "SliceObject" and name not in lessons.awkward:
        lessons.awkward.add(name)
    else:
        lessons.missed.update(names)


class _AllKnowing:
    """Answers the skills' questions from the true state."""

    def __init__(self, world: World) -> None:
        self._world = world

    def where(self, name: str) -> Known | None:
        """Return the object of that id, or the nearest of that type."""
        things = truth_of(self._world.last_event).objects
        fitting = [thing for thing in things if name in (thing.object_id, thing.object_type)]
        if not fitting:
            return None
        thing = min(fitting, key=lambda thing: (thing.distance_m, thing.object_id))
        return Known(
            object_id=thing.object_id,
            object_type=thing.object_type,
            position_m=thing.position_m,
            place_id=next(iter(thing.parent_ids), None),
        )

    def areas(self) -> tuple[Area, ...]:
        """Return no areas: with everything known nothing is searched for."""
        return ()


# ----------------------------------------------------------------- the floor


class IdleMethod(WithoutOptions):
    """Ends each instruction at once: the floor that other rows stand on."""

    name = "idle"

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> "IdleEpisode":
        """Start an episode."""
        return IdleEpisode()


class IdleEpisode:
    """One sequence of instructions, none of them carried out."""

    def enter(self, scene: SceneRef) -> None:
        """Note nothing."""

    def do(self, subtask: SubTask) -> Iterator[Plan | SkillResult | Outcome]:
        """End."""
        yield Outcome(finished=True, resident=(), handled_ids=())


_NONE = "row method 'copying' needs examples: profile = \"full\", examples = 1 or more in [models]"


class CopyingMethod(KarmaMethod):
    """What a model that is told examples has to beat: who copies has read no request."""

    settings_kind: ClassVar[type] = KarmaSettings

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make the row from KARMA's options.

        KarmaError if the run tells its planner no examples.
        """
        settings_of(KarmaSettings, options)
        if resources.examples is None:
            raise KarmaError(_NONE)
        nearest = _Nearest(resources.examples)
        model = ScriptedModel(nearest.programs())
        profile = program_profile(resources.profile)
        copying = replace(resources, model=model, profile=profile, examples=nearest, reader=None)
        return super().build(copying, options)


class _Nearest:
    """Finds the examples of an instruction, and says the nearest one's program until the next."""

    def __init__(self, examples: Examples) -> None:
        self._examples, self._program = examples, ""

    def __call__(self, instruction: str) -> tuple[WorkedExample, ...]:
        found = tuple(self._examples(instruction))
        self._program = found[-1].program
        return found

    def programs(self) -> Iterator[str]:
        while True:
            yield self._program
