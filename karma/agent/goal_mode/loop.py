"""Loop of goal mode: ask the model for goals once, find their objects, and achieve them.

The model's answer is carried out as said. Code looks for the objects, counts them, leaves out those
that are to be avoided, checks conditions first, and knows which skills bring a goal about.
"""

from collections.abc import Generator
from dataclasses import dataclass, replace

from karma.agent.goal_mode.language import GRAMMAR, GoalAnswer, parse_goals
from karma.agent.goal_mode.names import Similar
from karma.agent.goal_mode.objects import ObjectFinder
from karma.agent.goal_mode.prompt import SYSTEM, example_turns, user_message
from karma.agent.goal_mode.work import GoalWork
from karma.agent.loop import AgentSession, SessionExecutor
from karma.agent.memory import AgentMemory
from karma.agent.planning.planner import Planner
from karma.agent.session import NO_ADVICE
from karma.agent.tools.sights import with_names
from karma.errors import ProgramError
from karma.types.events import AgentEvent, Plan
from karma.types.memory import Exchange
from karma.types.planning import End, PlanRequest, Prompt
from karma.types.tasks import SubTask

MAX_ANSWERS = 3  # per request; later ones quote what could not be read
MAX_TOKENS = 160


@dataclass(frozen=True, slots=True)
class GoalLoop:
    """Carries out instructions by the goals that a small model reads in them."""

    planner: Planner
    memory: AgentMemory
    similar: Similar | None = None  # of names that nobody has listed

    def executor(self, subtask: SubTask) -> SessionExecutor:
        """Return the executor of an instruction; it keeps the report for later prompts."""

        def execute(session: AgentSession) -> Generator[AgentEvent, None, bool | End]:
            session.look()
            request = self.memory.request(subtask, NO_ADVICE, tells_all=True)
            finder = ObjectFinder(self.memory, session, self.similar)
            answer = yield from self._ask(session, request, finder)
            end: bool | End = False
            if answer is not None:
                end = answer.end or (yield from GoalWork(session, finder).carry_out(answer))
                yield from session.restore(finder.left_open(answer))
            report = f"{end.kind}: {end.text}" if isinstance(end, End) else "not done"
            self.memory.keep_exchange(Exchange(request=subtask.instruction, report=report))
            return end

        return execute

    def _ask(
        self, session: AgentSession, request: PlanRequest, finder: ObjectFinder
    ) -> Generator[AgentEvent, None, GoalAnswer | None]:
        """Ask the model until its answer can be read; None if it never can."""
        prompt = self._prompt(session, request)
        decoding, answer = self.planner.decoding, None
        for number in range(MAX_ANSWERS):
            completion = self.planner.model.complete(
                prompt,
                spec=None if decoding.constraint == "free" else GRAMMAR,
                max_tokens=min(MAX_TOKENS, decoding.max_tokens),
                max_seconds=decoding.answer_seconds,
                temperature=decoding.temperature if number == 0 else decoding.retry_temperature,
                seed=decoding.seed + number,
                listen=self.planner.listen,
            )
            error = completion.fault
            if not error:
                try:
                    answer = parse_goals(completion.text)
                except ProgramError as refused:
                    error = str(refused)
            facts = _facts_against(answer, finder)
            if facts and number < MAX_ANSWERS - 1:
                error = facts
            yield Plan(
                prompt=prompt,
                completion=completion,
                calls=(),
                names=dict(self.memory.room.names),
                recalled=tuple(request.recalled),
                units=tuple(request.units),
                error=error,
            )
            if not error:
                break
            turn = (prompt.changing, completion.text.strip())
            prompt = replace(
                prompt, turns=(*prompt.turns, turn), changing=f"That cannot be: {error}. Again."
            )
        if answer is not None and (unknown := finder.unknown_names(answer)):
            question = f"I know of no {' and no '.join(unknown)} here. What do you mean?"
            return GoalAnswer(end=End(kind="ask", text=question))
        if answer is not None and (facts := _facts_against(answer, finder)):
            return GoalAnswer(end=End(kind="refuse", text=f"{facts[:1].upper()}{facts[1:]}."))
        return answer

    def _prompt(self, session: AgentSession, request: PlanRequest) -> Prompt:
        memory = self.memory
        areas = memory.graph.areas() if memory.graph is not None else ()
        seen = [sight for sight in session.seen().values() if memory.may_tell(sight)]
        memory.keep_all_names(with_names(memory.room.names, areas, seen, request.units))
        message = user_message(
            request.instruction,
            whole=request.whole,
            units=request.units,
            held=session.remembered().held,
            names=memory.room.names,
            exchanges=memory.exchanges,
        )
        return Prompt(stable=SYSTEM, turns=example_turns(), changing=message)


def _facts_against(answer: GoalAnswer | None, finder: ObjectFinder) -> str:
    """Return unknown names and impossible actions of an answer as text, or "" if there are none."""
    if answer is None:
        return ""
    unknown = finder.unknown_names(answer)
    names = f"there is no {' and no '.join(unknown)} here" if unknown else ""
    return "; ".join(filter(None, [names, *finder.impossible(answer)]))
