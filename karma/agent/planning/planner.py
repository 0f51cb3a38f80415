"""From what the agent knows to a program: prompt, model, parser, with bounded retries."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Self

from karma.agent.planning.first_program import substitution
from karma.agent.planning.inspector import mend, narrowed, objection
from karma.agent.planning.program import SKILLS
from karma.agent.planning.prompt import render, skills_of
from karma.agent.planning.recovery import Recovered, program_of
from karma.agent.planning.refused import KNOWN, cannot_be, with_words
from karma.agent.planning.turns import with_turns
from karma.errors import ProgramError
from karma.household.ids import short_type, type_of
from karma.household.places import OVERLOOKED, STAND_CLOSED, landmark_types
from karma.household.types import object_types
from karma.types.completion import Completion, Decoding, Listener
from karma.types.events import Plan, Review
from karma.types.planning import (
    REFUSAL_KINDS,
    FailedProgram,
    PlanRequest,
    ProgramSpec,
    RefusalKind,
    RefusedRequest,
    Skill,
    SkillCall,
)
from karma.types.roles import Examples, LanguageModel, PhraseReader, Resources

MIN_REFUSAL_CHANCE = 0.6  # by the model; below it a program is asked for instead


@dataclass(frozen=True, slots=True, eq=False)
class Planner:
    """A model with its prompt profile, see `karma.agent.planning.prompt.PROFILES`."""

    model: LanguageModel
    profile: str
    decoding: Decoding = field(default_factory=Decoding)
    reader: PhraseReader | None = None  # None: the planner reads no hints
    listen: Listener | None = None  # hears answers as they come
    examples: Examples | None = None  # for an instruction; None: the prompt has none but its own

    @classmethod
    def of(cls, given: Resources) -> Self:
        """Return the planner that a run has loaded."""
        return cls(
            given.model, given.profile, given.decoding, given.reader, given.listen, given.examples
        )

    def plan(self, request: PlanRequest) -> Iterator[Plan]:
        """Ask until an answer parses and could work, at most `attempts` times; yields every answer.

        The last answer only has to parse: the world may know better than the type table. If every
        answer ended in the same impossible action, a planner that may refuse the request does so.
        """
        request = self._prepared(request)
        refusing = self.decoding.refusing
        reasons: set[str] = set()  # why answers could never work; "" for a passing reason
        for attempt in range(self.decoding.attempts):
            is_last = attempt == self.decoding.attempts - 1
            answer = self._ask(request, attempt, refusing=refusing)
            if not answer.calls and answer.error.endswith(KNOWN):
                refusing = False
            if _is_unsure(answer) and not request.failures:
                yield answer
                answer = self._ask(request, attempt, refusing=False)
            lasting = ""
            if self.decoding.inspected and answer.calls:
                answer, lasting = inspected(answer, request)
            review = Review(answer=answer)
            if (checker := request.advice.checker) is not None:
                review = checker.review(answer, request, attempt=attempt, is_last=is_last)
            answer, refusing = review.answer, refusing and review.may_refuse
            if answer.calls or answer.error:
                reasons.add(lasting)
            if review.own is not None:
                yield answer
                yield review.own
                return
            if is_last:
                answer = self._settled(answer, review.wrong, reasons if attempt else set())
            yield answer
            if answer.failure is None:
                return
            request = replace(
                request,
                error=answer.error,
                failures=(*request.failures, answer.failure),
                instruction=request.advice.plain or request.instruction,
            )

    def objects(self, instruction: str) -> Mapping[str, Collection[str]]:
        """Return the objects that an instruction mentions, and the types called so."""
        return self.reader.objects(instruction) if self.reader is not None else {}

    def _prepared(self, request: PlanRequest) -> PlanRequest:
        """Return a request with hints and worked examples for its instruction."""
        if self.reader is not None:
            hints = self.reader.hints(request.instruction)
            request = replace(request, hints=hints, objects=self.objects(request.instruction))
        if self.examples is not None and not request.examples:
            request = replace(request, examples=self.examples(request.instruction))
        return request

    def _settled(self, answer: Plan, wrong: str, reasons: set[str]) -> Plan:
        """Return the last answer as it stands: a program, a failure or a refusal."""
        if wrong:
            return _refused(answer, "astray", "guard", wrong)
        if not answer.calls:
            return answer
        if self.decoding.refusing and len(reasons) == 1 and reasons != {""}:
            return _refused(answer, "impossible", "inspector", *reasons)
        return replace(answer, error="", failure=None)

    def _ask(self, request: PlanRequest, attempt: int, *, refusing: bool) -> Plan:
        """Ask the model once and parse its answer."""
        decoding = self.decoding
        rendered = render(self.profile, request, refusing=refusing)
        skills = skills_of(self.profile)
        spec = program_spec(request, rendered.names, skills, refusing=refusing)
        if decoding.constraint not in ("free", "syntax"):
            spec = replace(spec, narrowed=narrowed(skills, spec.objects))
        hotter = decoding.retry_temperature if request.error else 0.0
        completion = self.model.complete(
            rendered.prompt,
            spec=None if decoding.constraint == "free" else spec,
            max_tokens=decoding.max_tokens,
            max_seconds=decoding.answer_seconds,
            temperature=max(decoding.temperature, hotter),
            seed=decoding.seed + attempt,
            listen=self.listen,
        )
        answer = _read(completion, skills, refusing=refusing)
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


# ----------------------------------------------------------------- checks of an answer


def inspected(answer: Plan, request: PlanRequest) -> tuple[Plan, str]:
    """Return an answer repaired, or objected to; and why it could never work, or ""."""
    held = held_name(answer, request)
    name_of = {object_id: name for name, object_id in answer.names.items()}
    shut = {name_of[u.object_id] for u in request.units if type_of(u.place_id) in STAND_CLOSED}
    seen = {kind for area in request.areas for kind in area.contains}
    cut = {name_of[u.object_id] for u in request.units if "sliced" in u.states}
    known = seen | set(answer.names)
    running = {short_type(sight.object_type) for sight in request.seen if "on" in sight.states}
    calls = mend(
        answer.calls,
        known=known, shut=shut, cut=cut, running=running, held=held, areas=request.areas,
    )  # fmt: skip
    answer = replace(answer, calls=calls)
    swapped = substitution(calls, request)
    if swapped is not None:
        line, reason = swapped
        return replace(objected(answer, line, reason, f"{calls[line]}: {reason}"), calls=()), ""
    found = objection(calls, held=held, known=known)
    if found is None:
        return answer, ""
    reason = "; ".join(filter(None, [found.reason, found.help]))
    lasting = found.reason if found.lasting else ""
    return objected(answer, found.line, reason, str(found)), lasting


def held_name(answer: Plan, request: PlanRequest) -> str | None:
    """Return the prompt's name of the held object."""
    return next((name for name, id_ in answer.names.items() if id_ == request.held_id), None)


def _is_unsure(answer: Plan) -> bool:
    """Return whether the model gave its refusal little more chance than a program."""
    certainty = answer.completion.certainty
    chance = certainty.refusing if certainty is not None else None
    return answer.refused is not None and chance is not None and chance < MIN_REFUSAL_CHANCE


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
    """Return the failure of an answer without an executable program."""
    failure = FailedProgram(lines=lines, failed=failed, reason=reason)
    return Recovered(error=reason, failure=failure)


def _refused(answer: Plan, kind: RefusalKind, by: Literal["guard", "inspector"], why: str) -> Plan:
    """Return an answer that refuses the request."""
    refused = RefusedRequest(kind=kind, by=by, words=(why,))
    return replace(answer, calls=(), error="", failure=None, refused=refused)


def objected(answer: Plan, line: int, reason: str, error: str = "") -> Plan:
    """Return a plan with the objection to a line of its program."""
    failure = FailedProgram(lines=tuple(map(str, answer.calls)), failed=line, reason=reason)
    return replace(answer, error=error or reason, failure=failure)


def program_spec(
    request: PlanRequest,
    names: Mapping[str, str],
    skills: tuple[Skill, ...] = SKILLS,
    *,
    refusing: bool = False,
) -> ProgramSpec:
    """Return the language of programs: names in memory, and types that a search can find.

    Furniture that the map does not show is not there: a robot that has seen the room once has seen
    its sofa, though perhaps not its light switch. Objects of a failed search are excluded, too.
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
    The second of two objects that the program calls by the same name stays a type, too.
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
