"""The agent's loop: plan, act, remember.

An answer of the planner is a whole program (KARMA §3.5). Its calls run until one fails; then the
planner answers again, with the failure in its prompt. Memory takes in the experience at the end.
"""

from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from dataclasses import dataclass, replace

from karma.agent.attempts import Attempts, bound
from karma.agent.body.skills import Skills
from karma.agent.memory import AgentMemory
from karma.agent.planning.planner import Planner, grounded
from karma.agent.seeing.eyes import Perception
from karma.agent.session import (
    LOOK_OVER,
    NO_ADVICE,
    SURVEY,
    Executor,
    InstructionSession,
    Remembered,
)
from karma.agent.tour import position_of, tour
from karma.errors import KarmaError
from karma.types.events import AgentEvent, Check, Found, Outcome, SkillResult
from karma.types.observation import SeenObject
from karma.types.planning import Advice, End, SkillCall
from karma.types.roles import World
from karma.types.space import SceneRef
from karma.types.tasks import SubTask


@dataclass(eq=False)
class KarmaAgent:
    """An agent in a home: a planner, skills in a world, and both memories."""

    world: World
    planner: Planner
    memory: AgentMemory
    perception: Perception
    attempts: int
    mode: "ModeExecutor | None" = (
        None  # carries out instructions in place of the planner's programs
    )

    def enter(self, scene: SceneRef) -> None:
        """Be in a room; its first visit explores it."""
        self.memory.enter(scene, self.world)

    def do(self, subtask: SubTask) -> Iterator[AgentEvent]:
        """Let the planner carry out an instruction; yield answers, results and the report."""
        return self.execute(subtask, self.executor(subtask))

    def executor(self, subtask: SubTask) -> "SessionExecutor":
        """Return what carries out an instruction: its mode, or the planner's programs."""
        return self.mode(subtask) if self.mode is not None else planned(subtask)

    def execute(
        self,
        subtask: SubTask,
        executor: "SessionExecutor",
        *,
        keep_shut: Collection[str] = (),
        clock_s: float = 0.0,
    ) -> Iterator[AgentEvent]:
        """Carry out an instruction by an executor and remember it, as `do`.

        `keep_shut`: types that nothing opens; `clock_s`: time of the home at the start.
        """
        resident = self.memory.short_term.units()
        session = AgentSession(self, subtask.instruction, keep_shut)
        ended = yield from executor(session)
        end = ended if isinstance(ended, End) else None
        experience, change = session.skills.experience, None
        if session.has_acted:  # a refusal before the first step changes nothing
            clock_s += session.skills.actions
            change = self.memory.remember(experience, subtask.instruction, clock_s)
        graph, checks = self.memory.graph, session.checks()
        finished = ended is True
        if end is not None and end.kind in ("done", "tell"):
            finished = all(check.found != "otherwise" for check in checks)
        yield Outcome(
            finished=finished,
            end=end,
            resident=resident,
            handled_ids=experience.handled_ids,
            kept=self.memory.short_term.units(),
            tour=graph.tour if graph else None,
            checks=checks,
            change=change,
        )


SessionExecutor = Callable[["AgentSession"], Generator[AgentEvent, None, bool | End]]
ModeExecutor = Callable[[SubTask], SessionExecutor]


def planned(subtask: SubTask) -> Executor:
    """Return the executor that leaves an instruction to the planner."""

    def execute(session: InstructionSession) -> Generator[AgentEvent, None, bool]:
        return (yield from session.do(subtask)).finished

    return execute


class AgentSession:
    """The agent while it carries out an instruction: an `InstructionSession`."""

    def __init__(self, agent: KarmaAgent, instruction: str, keep_shut: Collection[str]) -> None:
        memory = agent.memory
        self._agent, self._memory, self._instruction = agent, memory, instruction
        self._knowledge = memory.knowledge(agent.world)
        eyes = agent.perception.eyes(memory.scene, instruction)
        self.skills = Skills(agent.world, self._knowledge, eyes=eyes, before=memory.room.seen)
        self.skills.reach.kept_shut = frozenset(keep_shut)
        self._attempts: list[Attempts] = []  # with at least one result
        self._said: list[Check] = []
        self.has_acted = False

    def do(
        self, subtask: SubTask, advice: Advice = NO_ADVICE
    ) -> Generator[AgentEvent, None, Attempts]:
        """Plan and act until a program succeeds or the attempts are used up."""
        planner, text = self._agent.planner, subtask.instruction
        if self._agent.mode is not None:
            raise KarmaError(
                f"{planner.model.name} does not write programs in the mode {planner.profile!r}\n"
                '  To fix: --mode full, or profile = "full" under [models]'
            )
        attempts = Attempts(instruction=text, objects=planner.objects(text))
        tells_all = planner.profile != "compact"
        request = self._memory.request(subtask, advice, tells_all=tells_all)
        self._knowledge.units = self._memory.knowledge(self._agent.world, request.units).units
        for _ in range(self._agent.attempts):
            answer = None
            self.skills.look()
            experience, again = self.skills.experience, bool(attempts.results)
            for answer in planner.plan(self._memory.updated(request, experience, again=again)):
                yield answer
                self._memory.keep_names(answer.names)
                if answer.failure is not None:
                    request = replace(request, failures=(*request.failures, answer.failure))
            if answer is None or not answer.calls:
                break
            results: list[SkillResult] = []
            self.skills.begin_program()
            for call in bound(answer, advice.only):
                results.append(self.skills.run(call))
                yield results[-1]
                if not results[-1].ok:
                    break
            attempts = attempts.with_program(grounded(answer.calls, answer.names), results)
            if attempts.ran:
                break
            request = attempts.failure_told(request)
        if attempts.results:
            self.has_acted = True
            self._attempts.append(attempts)
        return attempts

    def look(self) -> None:
        """Take note of what is in view now."""
        self.skills.look()

    def restore(self, kept: Collection[str]) -> Iterator[SkillResult]:
        """Close and switch off what this instruction opened or switched on, but for some ids."""
        for object_id, undo in self.skills.experience.left.items():
            if object_id not in kept:
                yield self.call(SkillCall.of(undo, object_id))

    def call(
        self, call: SkillCall, aside: Collection[str] = (), *, reported: bool = False
    ) -> SkillResult:
        """Run a skill, `LOOK_OVER` or `SURVEY`; a search ignores the ids in `aside`.

        The effects of a `reported` call are lines of the report.
        """
        if reported and not self._attempts:
            self._attempts.append(Attempts(instruction=self._instruction))
        self.has_acted = True
        if call.skill == SURVEY:
            call = SkillCall.of("GoToObject", self._memory.scene)
            areas = tour(self._knowledge.areas(), position_of(self._agent.world))
            looks = [self.skills.look_for("", area) for area in areas]
            actions = sum(look.actions for look in looks)
            searched = sum(look.explorations for look in looks)
            return SkillResult(call=call, ok=True, actions=actions, explorations=searched)
        if call.skill == LOOK_OVER:
            return self.skills.look_over(self.seen()[call.objects[0]])
        if call.skill == "Explore" and aside:
            return self.skills.run(SkillCall.of("Explore", call.objects[0]), aside=aside)
        result = self.skills.run(call)
        if result.ok and self._attempts:
            self._attempts[-1] = self._attempts[-1].with_result(result)
        return result

    def seen(self) -> Mapping[str, SeenObject]:
        """Return the latest sight of each object of the room that is not known to be gone."""
        return self._memory.sights(self.skills.experience)

    def remembered(self) -> Remembered:
        """Return the memory of the room, and the doors and switches left open or on."""
        memory, experience = self._memory, self.skills.experience
        graph = memory.graph
        areas = graph.areas() if graph else ()
        units = memory.short_term.units(memory.scene)
        types = {object_type for area in areas for object_type in area.contains}
        types |= {unit.object_type for unit in units}
        return Remembered(
            units=units,
            fixtures={node.id: node.type for node in graph.objects()} if graph else {},
            types=frozenset(types | {sight.object_type for sight in self.seen().values()}),
            held=experience.held,
            left=experience.left,
            taken=experience.taken,
        )

    def say(self, text: str, found: Found) -> None:
        """Add a line to the report: a state, and the evidence for it."""
        self._said.append(Check(text=text, found=found))

    def checks(self) -> tuple[Check, ...]:
        """Return the lines of the report: the effects of all programs, then the added lines."""
        experience = self.skills.experience
        done = (check for attempts in self._attempts for check in attempts.checks(experience))
        return (*dict.fromkeys(done), *self._said)
