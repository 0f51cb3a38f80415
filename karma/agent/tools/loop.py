"""The loop of tool mode: the model calls tools, sees their results, and ends the request.

The model decides; code checks facts. A name that nothing has is quoted back, `done` is questioned
once when the agent observed the contrary, and the report is what was done and observed.
"""

from collections import Counter
from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from karma.agent.loop import AgentSession, SessionExecutor
from karma.agent.memory import AgentMemory
from karma.agent.planning.full_profile import in_names, name_for
from karma.agent.planning.planner import Planner
from karma.agent.seeing.perceive import place_of
from karma.agent.session import LOOK_OVER, NO_ADVICE
from karma.agent.tools.prompt import first_message, system_text
from karma.agent.tools.sights import Shown, map_text, with_names
from karma.agent.tools.table import (
    BadCall,
    ToolAnswer,
    ToolCall,
    in_tools,
    parse_answer,
    tools_grammar,
)
from karma.errors import RequestRefused
from karma.household.ids import short_type, type_of
from karma.household.types import object_types
from karma.types.events import AgentEvent, Check, Plan, SkillResult
from karma.types.memory import Area, Exchange, MemoryUnit
from karma.types.observation import SeenObject
from karma.types.planning import End, PlanRequest, Prompt, SkillCall
from karma.types.tasks import SubTask

MAX_TURNS = 25  # answers to one request
MAX_CALLS = 100
MAX_BAD_ANSWERS = 3  # in a row, none of whose calls could be run
MAX_REPEATS = 2  # of an answer with the same results

_SWITCHES = frozenset({"OpenObject", "CloseObject", "ToggleOn", "ToggleOff"})


@dataclass(frozen=True, slots=True)
class ToolLoop:
    """Carries out instructions by tool calls."""

    planner: Planner
    memory: AgentMemory

    def executor(self, subtask: SubTask) -> SessionExecutor:
        """Return the executor of an instruction; it keeps the report for later prompts."""

        def execute(session: AgentSession) -> Generator[AgentEvent, None, bool | End]:
            conversation = _Conversation(self.planner, self.memory, session, subtask)
            yield from conversation.run()
            self.memory.keep_exchange(conversation.exchange())
            return conversation.end or False

        return execute


class _Conversation:
    """State of one request: messages, calls and handled objects."""

    def __init__(
        self, planner: Planner, memory: AgentMemory, session: AgentSession, subtask: SubTask
    ) -> None:
        self._planner, self._memory = planner, memory
        self._session, self._subtask = session, subtask
        self._turns: list[tuple[str, str]] = []
        self._shown = Shown({})
        self._chosen: set[str] = set()  # ids that the model itself opened, closed or switched
        self._unplaced: set[str] = set()  # ids that could not be put where they were to go
        self._searched: set[str] = set()  # types that `find` was called for
        self._handled: dict[str, None] = {}  # ids, the last one last
        self._calls = 0
        self.end: End | None = None
        self._stopped = ""  # why it ended without an end of the model's

    # ------------------------------------------------------------- the loop

    def run(self) -> Generator[AgentEvent, None, None]:
        """Ask and act until the model ends the request or a limit is reached."""
        self._session.look()
        request = self._memory.request(self._subtask, NO_ADVICE, tells_all=True)
        message = self._first_message(request)
        system = system_text(map_text(self._areas(), self._names))
        bad, is_questioned = 0, False
        seen_before: Counter[tuple[str, str]] = Counter()
        for number in range(MAX_TURNS):
            prompt = Prompt(stable=system, turns=tuple(self._turns), changing=message)
            try:
                plan, answer = self._ask(prompt, request, number)
            except RequestRefused as refused:  # e.g. the context is full
                self._stopped = str(refused)
                break
            yield plan
            results: list[str] = []
            is_ok = not plan.error
            if is_ok:
                results, is_ok = yield from self._run_calls(answer)
            reply = "\n".join([*results, *([plan.error] if plan.error else [])])
            doubt = "" if is_questioned or not is_ok else self._doubt(answer.end)
            if answer.end is not None and is_ok and not doubt:
                self.end = answer.end
                break
            is_questioned = is_questioned or bool(doubt)
            self._turns.append((message, plan.completion.text.strip()))
            message = "\n".join(filter(None, [reply, doubt])) or "Call a tool, or end the request."
            bad = 0 if any(" -> ok" in line for line in results) else bad + 1
            seen_before[plan.completion.text.strip(), message] += 1
            if bad >= MAX_BAD_ANSWERS:
                self._stopped = f"{bad} answers in a row without a call that works"
            elif max(seen_before.values()) > MAX_REPEATS:
                self._stopped = "the same calls again and again, without effect"
            elif self._calls >= MAX_CALLS:
                self._stopped = f"{self._calls} calls without an end"
            if self._stopped:
                break
        else:
            self._stopped = f"{MAX_TURNS} answers without an end"
        if self._stopped:
            self._session.say(self._stopped, "unseen")
        yield from self._session.restore(self._chosen)

    def exchange(self) -> Exchange:
        """Return the request and its report for later prompts."""
        name_of = {object_id: name for name, object_id in self._names.items()}
        handled = [name_of[entry] for entry in self._handled if entry in name_of]
        about = f" (handled: {', '.join(handled[-4:])})" if handled else ""
        end = f"{self.end.kind}: {self.end.text}" if self.end else f"not done: {self._stopped}"
        return Exchange(request=self._subtask.instruction, report=f"{end}{about}")

    def _ask(self, prompt: Prompt, request: PlanRequest, number: int) -> tuple[Plan, ToolAnswer]:
        planner, decoding = self._planner, self._planner.decoding
        completion = planner.model.complete(
            prompt,
            spec=None if decoding.constraint == "free" else tools_grammar(self._names),
            max_tokens=decoding.max_tokens,
            max_seconds=decoding.answer_seconds,
            temperature=decoding.temperature,
            seed=decoding.seed + number,
            listen=planner.listen,
        )
        answer = ToolAnswer() if completion.fault else parse_answer(completion.text)
        error = completion.fault
        if not error and not answer.calls and answer.end is None:
            error = "there is no tool call in this answer; write calls only, such as look(Fridge)"
        plan = Plan(
            prompt=prompt,
            completion=completion,
            calls=(),  # resolved while they run: a call may name the objects of the next
            names=dict(self._names),
            recalled=tuple(request.recalled),
            units=tuple(request.units),
            error=error,
            dropped=answer.dropped,
        )
        return plan, answer

    def _run_calls(self, answer: ToolAnswer) -> Generator[AgentEvent, None, tuple[list[str], bool]]:
        """Run calls up to the first failure; return result lines and whether all succeeded."""
        lines: list[str] = []
        for call in answer.calls:
            self._calls += 1
            remark, reason = "", self._objection(call)
            if not reason:
                remark = self._known_already(call)
            if isinstance(call, ToolCall) and not reason and not remark:
                result = self._run_call(call)
                yield result
                reason = "" if result.ok else self._reason(call, result)
                remark = self._state_of(call)
            name_of = {object_id: name for name, object_id in self._update_names().items()}
            news = self._news()
            told = f"FAILED: {in_tools(in_names(reason, name_of))}" if reason else f"ok{remark}"
            lines.append(f"{call} -> {told}" + (f". Seen: {news}" if news else ""))
            if reason:
                return lines, False
        return lines, True

    def _reason(self, call: ToolCall, result: SkillResult) -> str:
        """Return the reason of a failed call, in terms of known objects for a search."""
        if call.tool.name in ("put", "near"):
            self._unplaced.update(result.call.objects[:-1])
        if call.tool.skill == "Explore" and self._known_ids(result.call.objects[-1]):
            return f"there is no further {result.call.objects[-1]}; everything was searched"
        return result.detail or result.reason

    def _state_of(self, call: ToolCall) -> str:
        """Return all observed states of the target of `go` or `look`."""
        if call.tool.name not in ("go", "look"):
            return ""
        sight = self._session.seen().get(self._names.get(call.names[0], ""))
        words = [word for word in sight.states if word != "none"] if sight is not None else []
        return f", it is {' and '.join(words)}" if words else ""

    def _known_ids(self, object_type: str) -> set[str]:
        return {entry for entry in self._names.values() if type_of(entry) == object_type}

    def _run_call(self, call: ToolCall) -> SkillResult:
        session, skill = self._session, call.tool.skill
        ids = [self._names.get(name, name) for name in call.names]
        self._handled.update(dict.fromkeys(entry for entry in ids if entry in self._names.values()))
        if skill == LOOK_OVER:
            result = session.call(SkillCall.of("GoToObject", *ids))
            if result.ok or ids[0] in session.seen():
                result = session.call(SkillCall.of(LOOK_OVER, *(result.object_ids[:1] or ids)))
            return result
        if skill == "Explore":
            wanted = short_type(type_of(ids[0]))
            return session.call(SkillCall.of("Explore", wanted), aside=self._known_ids(wanted))
        exact = bool(call.names) and call.names[-1] in self._names
        result = session.call(
            SkillCall(skill=skill, objects=tuple(ids), exact=exact), reported=True
        )
        if skill in _SWITCHES:
            self._chosen.update((*ids, *result.object_ids))  # a bare type was any of it
        return result

    # ------------------------------------------------------------- facts

    def _objection(self, call: ToolCall | BadCall) -> str:
        """Return why a call cannot be run, with the closest names, or "" if it can."""
        if isinstance(call, BadCall):
            return call.reason
        types = object_types()
        for name in call.names:
            if name in self._names or name in types:
                continue
            known = [*self._names, *(types if call.tool.skill == "Explore" else ())]
            base = name.rpartition("_")[0] or name
            alike = [entry for entry in known if short_type(entry).lower() == base.lower()]
            near = alike or get_close_matches(name, known, n=3)
            hint = f"; there is {', '.join(near[:6])}" if near else ""
            return f"nothing here is named {name}{hint}"
        return ""

    def _known_already(self, call: ToolCall | BadCall) -> str:
        """Return where objects of a type are known to be, the first time that it is searched."""
        if isinstance(call, BadCall) or call.tool.skill != "Explore":
            return ""
        object_type = type_of(self._names.get(call.names[0], call.names[0]))
        if object_type in self._searched:
            return ""
        self._searched.add(object_type)
        name_of = {object_id: name for name, object_id in self._names.items()}
        known = [
            name_of[entry.object_id] + (f" at {name_for(place, name_of)}" if place else "")
            for entry in self._seen().values()
            if entry.object_type == object_type and entry.object_id in name_of
            for place in [place_of(entry)]
        ]
        return f", known: {', '.join(known)}" if known else ""

    def _doubt(self, end: End | None) -> str:
        """Return facts that contradict `done`, as a question to the model."""
        if end is None or end.kind != "done":
            return ""
        held = self._session.remembered().held
        facts = [str(check) for check in self._contradictions()]
        if held is not None and held.object_id in self._unplaced:
            name_of = {object_id: name for name, object_id in self._names.items()}
            facts.append(f"you still hold {name_of.get(held.object_id, held.object_type)}")
        if not facts:
            return ""
        return f"But {'; '.join(facts)}. Go on, or repeat done if that is what was asked for."

    def _contradictions(self) -> list[Check]:
        return [check for check in self._session.checks() if check.found == "otherwise"]

    # ------------------------------------------------------------- what the model reads

    @property
    def _names(self) -> Mapping[str, str]:
        return self._memory.room.names

    def _areas(self) -> tuple[Area, ...]:
        graph = self._memory.graph
        return graph.areas() if graph is not None else ()

    def _update_names(self, units: Iterable[MemoryUnit] = ()) -> Mapping[str, str]:
        known = with_names(self._names, self._areas(), self._seen().values(), units)
        self._memory.keep_all_names(known)
        return self._names

    def _seen(self) -> dict[str, SeenObject]:
        """Return the sights that the model may read of."""
        seen = self._session.seen().items()
        return {object_id: sight for object_id, sight in seen if self._memory.may_tell(sight)}

    def _news(self) -> str:
        text, self._shown = self._shown.news(self._seen(), self._names)
        return text

    def _first_message(self, request: PlanRequest) -> str:
        self._update_names(request.units)
        return first_message(
            request,
            news=self._news(),
            names=self._names,
            held=self._session.remembered().held,
            exchanges=self._memory.exchanges,
        )
