"""From what the agent knows to a program: prompt, model, parser, with bounded retries."""

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Self

from karma.agent.planning.goal_lines import program_for
from karma.agent.planning.inspector import mend, narrowed, objection
from karma.agent.planning.program import SKILLS
from karma.agent.planning.prompt import GOALS, render, skills_of
from karma.agent.planning.recovery import Recovered, program_of
from karma.agent.planning.turns import with_turns
from karma.contracts import (
    REFUSAL_KINDS,
    Completion,
    Decoding,
    Doubt,
    Examples,
    FailedProgram,
    Hints,
    LanguageModel,
    Listener,
    Plan,
    PlanRequest,
    ProgramSpec,
    RefusalKind,
    RefusedRequest,
    Request,
    Resources,
    Skill,
    SkillCall,
)
from karma.errors import ProgramError
from karma.household.ids import short_type, type_of
from karma.household.places import OVERLOOKED, STAND_CLOSED, landmark_types
from karma.household.types import object_types
from karma.plugins.rules.request_checker import Guard
from karma.plugins.rules.request_goals import asked_lines
from karma.plugins.rules.request_refusals import KNOWN, cannot_be, doubted, with_words
from karma.plugins.rules.trimming import trimmed

_LOOSE_AFTER = 2  # answers after which a mug will do for a cup


@dataclass(frozen=True, slots=True, eq=False)
class Planner:
    """One model with its prompt profile, see `karma.agent.planning.prompt.PROFILES`."""

    model: LanguageModel
    profile: str
    decoding: Decoding = field(default_factory=Decoding)
    hints: Hints | None = None  # of an instruction; None: the planner reads none
    doubt: Doubt | None = None  # by the first answer; None: the answer alone may refuse a request
    listen: Listener | None = None  # hears answers as they come
    examples: Examples | None = None  # for an instruction; None: the prompt has none but its own

    @classmethod
    def of(cls, given: Resources) -> Self:
        """Return the planner that a run has loaded."""
        return cls(
            given.model, given.profile, given.decoding, given.hints, given.doubt, given.listen,
            given.examples,
        )  # fmt: skip

    def drawn_by(self, decoding: Decoding) -> "Planner":
        """Return the same planner with its answers drawn otherwise."""
        return replace(self, decoding=decoding)

    def plan(self, request: PlanRequest) -> Iterator[Plan]:
        """Ask until an answer parses and could work, at most `attempts` times; yields every answer.

        The last answer only has to parse: the world may know better than the type table. But where
        every answer ended in the same impossible deed, a planner that may refuse does.
        """
        if self.hints is not None:
            request = replace(request, hints=self.hints(request.instruction))
        if self.examples is not None and not request.examples:
            request = replace(request, examples=self.examples(request.instruction))
        yield from _Asking(self, request).answers()


@dataclass(slots=True)
class _Asking:
    """One request that a planner is asked about, with what its answers so far have failed in."""

    planner: Planner
    request: PlanRequest

    def answers(self) -> Iterator[Plan]:
        """Yield answers as `Planner.plan` does."""
        decoding = self.planner.decoding
        refusing: bool | None = None  # not again where it was refused for what is known
        reasons: set[str] = set()  # why the answers could not work; "" for one that is not lasting
        for attempt in range(decoding.attempts):
            is_last = attempt == decoding.attempts - 1
            answer = self._ask(attempt, refusing=refusing)
            if answer.error and not answer.calls and answer.error.endswith(KNOWN):
                refusing = False
            if not self.request.failures:
                answer = yield from self._weighed(answer)
            if not is_last and (again := self._asked_again(answer)) is not None:
                refusing, answer = again
            lasting = ""
            if decoding.inspected and answer.calls:
                answer, lasting = self._inspected(answer)
            if answer.calls or answer.error:
                reasons.add(lasting)
            answer, held_back = self._held_back(answer)
            answer = yield from self._settled(answer, held_back, attempt, reasons)
            yield answer
            if answer.failure is None:
                return
            self.request = replace(
                self.request,
                error=answer.error,
                failures=(*self.request.failures, answer.failure),
                instruction=self.request.plain or self.request.instruction,
            )

    def _settled(
        self, answer: Plan, held_back: str, attempt: int, reasons: set[str]
    ) -> Generator[Plan, None, Plan]:
        """Return an answer as it stands; one that is held back again gives way to words alone."""
        is_last = attempt == self.planner.decoding.attempts - 1
        own = self._by_the_words(answer) if held_back and (attempt or is_last) else None
        if own is not None:
            yield answer
            return own
        if not is_last:
            return answer
        if held_back:
            return _refused(answer, "astray", "guard", held_back)
        if not answer.calls:
            return answer
        if self.planner.decoding.refusing and attempt and len(reasons) == 1 and reasons != {""}:
            return _refused(answer, "impossible", "inspector", *reasons)
        return replace(answer, error="", failure=None)

    def _weighed(self, answer: Plan) -> Generator[Plan, None, Plan]:
        """Return the first answer as doubt has it: refused, or asked again what was refused."""
        if self.planner.doubt is None or not self.planner.decoding.refusing:
            return answer
        doubt = self.planner.doubt.of(answer.completion, self.request)
        if doubt is None:
            return answer
        answer = replace(answer, doubt=doubt)
        if doubt >= self.planner.doubt.threshold:
            refused = answer.refused or with_words(doubted(self.request), self.request)
            return replace(answer, calls=(), error="", failure=None, refused=refused)
        if answer.refused is None:
            return answer
        yield answer
        return replace(self._ask(0, refusing=False), doubt=doubt)

    def _ask(self, attempt: int, *, refusing: bool | None = None) -> Plan:
        planner, request, decoding = self.planner, self.request, self.planner.decoding
        refusing = decoding.refusing if refusing is None else refusing
        rendered = render(planner.profile, request, refusing=refusing)
        skills = skills_of(planner.profile)
        spec = program_spec(request, rendered.names, skills, refusing=refusing)
        constraint = decoding.constraint
        if constraint not in ("free", "syntax"):
            spec = replace(spec, narrowed=narrowed(skills, spec.objects))
        hotter = decoding.retry_temperature if request.error else 0.0
        completion = planner.model.complete(
            rendered.prompt,
            spec=None if constraint == "free" else spec,
            max_tokens=decoding.max_tokens,
            max_seconds=decoding.answer_seconds,
            temperature=max(decoding.temperature, hotter),
            seed=decoding.seed + attempt,
            listen=planner.listen,
        )
        answer = _read(completion, skills, refusing=refusing)
        if planner.profile == GOALS and answer.calls:
            answer = _done_for(answer, request, rendered.names)
        if answer.refused and (reason := cannot_be(answer.refused, request)):
            answer = _no_program((completion.text.strip(),), 0, reason)
        return Plan(
            recalled=tuple(request.recalled),
            units=tuple(request.units),
            prompt=rendered.prompt,
            completion=completion,
            calls=answer.calls,
            names=rendered.names,
            refused=answer.refused and with_words(answer.refused, request),
            error=answer.error,
            failure=answer.failure,
            dropped=answer.dropped,
            examples=tuple(example.instruction for example in request.examples),
        )

    def _inspected(self, answer: Plan) -> tuple[Plan, str]:
        """Return an answer mended, or objected to; and why it could never work, "" otherwise."""
        request, held = self.request, self._held_name(answer)
        name_of = {object_id: name for name, object_id in answer.names.items()}
        shut = {name_of[u.object_id] for u in request.units if type_of(u.place_id) in STAND_CLOSED}
        seen = {kind for area in request.areas for kind in area.contains}
        cut = {name_of[u.object_id] for u in request.units if "sliced" in u.states}
        known = seen | set(answer.names)
        running = {short_type(one.object_type) for one in request.seen if "on" in one.states}
        calls = mend(
            answer.calls,
            known=known, shut=shut, cut=cut, running=running, held=held, areas=request.areas,
        )  # fmt: skip
        answer = replace(answer, calls=calls)
        found = objection(calls, held=held, known=known)
        if found is None:
            return answer, ""
        reason = "; ".join(filter(None, [found.reason, found.help]))
        lasting = found.reason if found.lasting else ""
        return _objected(answer, found.line, reason, str(found)), lasting

    def _held_name(self, answer: Plan) -> str | None:
        """Return the prompt's name of what is in the hand."""
        held = (name for name, one in answer.names.items() if one == self.request.held_id)
        return next(held, None)

    def _held_back(self, answer: Plan) -> tuple[Plan, str]:
        """Return an answer without its program where that is not what was asked, and why."""
        request, asked = self.request, self.request.asked
        if asked is None or not answer.calls:
            return answer, ""
        guard, exact = Guard(asked, known_here(request)), len(request.failures) < _LOOSE_AFTER

        def reason(some: Sequence[SkillCall]) -> str:
            meant, begun = grounded(some, answer.names), bool(request.done)
            return guard.stopped(meant, request.held_id, exact=exact, begun=begun)

        calls = guard.kept_open(guard.put_near(answer.calls))
        answer = replace(answer, calls=calls)
        why = reason(answer.calls)
        if not why:
            return answer, ""
        held = self._held_name(answer)
        # of what is only the rest of an errand, any part would do
        part = () if request.done else trimmed(
            answer.calls, lambda some: reason(some) or str(objection(some, held=held) or "")
        )  # fmt: skip
        if part:
            return replace(answer, calls=part), ""
        return replace(_objected(answer, max(len(answer.calls) - 1, 0), why), calls=()), why

    def _by_the_words(self, answer: Plan) -> Plan | None:
        """Return a program for what the words were read as, where no answer of the model would do.

        It passes what an answer has to pass, and stands as an answer of no tokens.
        """
        request = self.request
        if request.asked is None:
            return None
        lines = asked_lines(request.asked, known_here(request))
        calls = program_for(lines, request.units, answer.names) if lines else ()
        said = by_no_model("".join(f"{call}\n" for call in calls))
        own = replace(answer, completion=said, calls=calls, error="", failure=None)
        own, _ = self._inspected(own) if calls else (own, "")
        own, _ = self._held_back(own) if own.failure is None else (own, "")
        return own if own.calls and own.failure is None else None

    def _asked_again(self, answer: Plan) -> tuple[bool | None, Plan] | None:
        """Return an answer whose refusal does not stand yet, and whether the next may refuse.

        What was read is said again in plain words; where the words say otherwise than the refusal,
        the next answer may not refuse. None where there is no refusal, or it stands.
        """
        request = self.request
        if request.asked is None or answer.refused is None:
            return None
        wrongly = _contradicted(answer.refused, request.asked)
        if not wrongly and request.plain in ("", request.instruction):
            return None  # it cannot be said more plainly than it was
        reason = "the request was read: it is said again in plain words"
        failure = FailedProgram(lines=(answer.completion.text.strip(),), failed=0, reason=reason)
        again = replace(answer, refused=None, error=reason, failure=failure)
        return (False if wrongly else None), again


def by_no_model(text: str = "") -> Completion:
    """Return what stands for an answer where no model is asked."""
    return Completion(
        text=text, finish="stop", prompt_tokens=0, reused_tokens=0, completion_tokens=0,
        first_token_s=None, total_s=0.0,
    )  # fmt: skip


def _read(completion: Completion, skills: Sequence[Skill], *, refusing: bool) -> Recovered:
    """Return the calls of an answer, that it refuses the request, or why it is refused itself."""
    lines = tuple(completion.text.rstrip().split("\n"))
    try:
        found = program_of(completion, skills, refusing=refusing)
    except ProgramError as refused:
        failure = FailedProgram(lines=lines, failed=refused.line - 1, reason=refused.reason)
        return Recovered(error=str(refused), failure=failure)
    if found.calls or found.refused:
        return found
    return _no_program(lines, None, "the answer holds no skill call")


def _no_program(lines: tuple[str, ...], failed: int | None, reason: str) -> Recovered:
    """Return that an answer is no program that can be carried out."""
    failure = FailedProgram(lines=lines, failed=failed, reason=reason)
    return Recovered(error=reason, failure=failure)


def _done_for(answer: Recovered, request: PlanRequest, names: Mapping[str, str]) -> Recovered:
    """Return the program for an answer that says goals."""
    calls = program_for(answer.calls, request.units, names)
    if calls:
        return replace(answer, calls=calls)
    return _no_program(tuple(map(str, answer.calls)), None, "these lines leave nothing to do")


def _refused(answer: Plan, kind: RefusalKind, by: Literal["guard", "inspector"], why: str) -> Plan:
    """Return the refusal of a request that no program of an answer would carry out."""
    refused = RefusedRequest(kind=kind, by=by, words=(why,))
    return replace(answer, calls=(), error="", failure=None, refused=refused)


def _objected(answer: Plan, line: int, reason: str, error: str = "") -> Plan:
    """Return a plan with what is wrong with a line of its program."""
    failure = FailedProgram(lines=tuple(map(str, answer.calls)), failed=line, reason=reason)
    return replace(answer, error=error or reason, failure=failure)


def _contradicted(refused: RefusedRequest, asked: Request) -> bool:
    """Return whether the words say otherwise than a refusal: its reason is not so."""
    match refused.kind:
        case "negated":
            return not (asked.forbidden or asked.exclusions)
        case "thing" | "place":
            return all(one.types or one.told or one.anything for one in asked.mentions)
        case "deed":
            return all(deed.deed for deed in asked.deeds)
        case kind:
            return kind == "language"


def known_here(request: PlanRequest) -> frozenset[str]:
    """Return the types that the agent knows of in this room."""
    kinds = {kind for area in request.areas for kind in area.contains}
    kinds |= {unit.object_type for unit in request.units}
    return frozenset(kinds | {one.object_type for one in request.seen})


def program_spec(
    request: PlanRequest,
    names: Mapping[str, str],
    skills: tuple[Skill, ...] = SKILLS,
    *,
    refusing: bool = False,
) -> ProgramSpec:
    """Return the language of programs: what memory names, and types that can be searched for.

    Furniture that the map does not show is not there: a robot that has seen the room once has seen
    its sofa, though perhaps not its light switch. Nor is what was just searched for in vain.
    """
    known = {kind for area in request.areas for kind in area.contains}
    searchable = {name for name, kind in object_types().items() if not kind.made_by_slicing}
    if known:
        searchable -= landmark_types() - known - OVERLOOKED
    searchable -= set(request.missing)
    return ProgramSpec(
        skills=skills,
        objects=tuple(sorted(known | searchable | set(names))),
        positions=tuple(area.name for area in request.areas),
        refusals=REFUSAL_KINDS if refusing else (),
    )


def grounded(calls: Sequence[SkillCall], names: Mapping[str, str]) -> tuple[SkillCall, ...]:
    """Put object ids in place of the prompt's short names; types stay as they are.

    A receptacle with a number in its name is meant exactly: who writes `Cabinet_2` wants no other.
    The second of two things that the program calls by one name stays a type, too.
    """
    return tuple(_grounded(call, names) for call in with_turns(calls))


def _grounded(call: SkillCall, names: Mapping[str, str]) -> SkillCall:
    last = call.objects[-1]
    kept = call.objects[:1] if call.turn else ()
    return replace(
        call,
        objects=(*kept, *(names.get(name, name) for name in call.objects[len(kept) :])),
        positions=tuple(names.get(p, p) if isinstance(p, str) else p for p in call.positions),
        exact=last in names and last != short_type(last),
    )
