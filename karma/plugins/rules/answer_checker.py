"""Check a planner's answers against a parsed request: the hook of the core's planner."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from karma.agent.planning.inspector import objection
from karma.agent.planning.planner import grounded, held_name, inspected, objected
from karma.plugins.rules.language.clauses import plainly, said
from karma.plugins.rules.request_checker import Guard
from karma.plugins.rules.request_goals import asked_goals, program_for
from karma.plugins.rules.trimming import trimmed
from karma.plugins.rules.types import Request
from karma.types.completion import Completion
from karma.types.events import Plan, Review
from karma.types.planning import Advice, FailedProgram, PlanRequest, RefusedRequest, SkillCall

_LOOSE_AFTER = 2  # failed answers after which a mug will do for a cup


def advice_for(asked: Request | None, only: Mapping[str, str] | None = None) -> Advice:
    """Return the advice for a parsed request; `only`: type -> id of the single admitted object."""
    if asked is None:
        return Advice(only=only or {})
    return Advice(
        plain=plainly(asked),
        actions=fields_of(asked),
        checker=RequestAnswerChecker(asked),
        only=only or {},
    )


@dataclass(frozen=True, slots=True)
class RequestAnswerChecker:
    """Checks a planner's answers against a parsed request."""

    asked: Request

    def review(self, answer: Plan, request: PlanRequest, *, attempt: int, is_last: bool) -> Review:
        """Return an answer as it may be carried out, or the objection to it."""
        if answer.refused is not None:
            return Review(answer=answer) if is_last else self._second_try(answer, request)
        answer, wrong = self._checked(answer, request)
        own = self._own_program(answer, request) if wrong and (attempt or is_last) else None
        return Review(answer=answer, wrong=wrong, own=own)

    def _second_try(self, answer: Plan, request: PlanRequest) -> Review:
        """Return a refusal as it stands, or objected to.

        The next prompt has the instruction in plain words. If the words contradict the refusal, the
        next answer may not refuse.
        """
        wrongly = answer.refused is not None and self._contradicts(answer.refused)
        if not wrongly and request.advice.plain in ("", request.instruction):
            return Review(answer=answer)  # there are no plainer words
        reason = "the request was read: it is said again in plain words"
        failure = FailedProgram(lines=(answer.completion.text.strip(),), failed=0, reason=reason)
        answer = replace(answer, refused=None, error=reason, failure=failure)
        return Review(answer=answer, may_refuse=not wrongly)

    def _checked(self, answer: Plan, request: PlanRequest) -> tuple[Plan, str]:
        """Return an answer without its program if there is an objection, and the objection."""
        if not answer.calls:
            return answer, ""
        calls, wrong = self._check(answer.calls, request, answer)
        answer = replace(answer, calls=calls)
        if wrong:
            answer = replace(objected(answer, max(len(calls) - 1, 0), wrong), calls=())
        return answer, wrong

    def _own_program(self, answer: Plan, request: PlanRequest) -> Plan | None:
        """Return the rule-based planner's program, where no answer of the model would do.

        It passes what an answer has to pass, and stands as an answer of no tokens.
        """
        goals = asked_goals(self.asked, known_here(request))
        calls = program_for(goals, request.units, answer.names) if goals else ()
        said = by_no_model("".join(f"{call}\n" for call in calls))
        own = replace(answer, completion=said, calls=calls, error="", failure=None)
        own, _ = inspected(own, request) if calls else (own, "")
        own, _ = self._checked(own, request) if own.failure is None else (own, "")
        return own if own.calls and own.failure is None else None

    def _contradicts(self, refused: RefusedRequest) -> bool:
        """Return whether the words contradict a refusal."""
        asked = self.asked
        match refused.kind:
            case "negated":
                return not (asked.forbidden or asked.exclusions)
            case "thing" | "place":
                return all(one.types or one.told or one.anything for one in asked.mentions)
            case "deed":
                return all(deed.deed for deed in asked.deeds)
            case kind:
                return kind == "language"

    def _check(
        self, calls: Sequence[SkillCall], request: PlanRequest, answer: Plan
    ) -> tuple[tuple[SkillCall, ...], str]:
        """Return a program or its requested part, and the objection if no part is requested."""
        guard, exact = Guard(self.asked, known_here(request)), len(request.failures) < _LOOSE_AFTER

        def reason(some: Sequence[SkillCall]) -> str:
            meant, begun = grounded(some, answer.names), bool(request.done)
            return guard.stopped(meant, request.held_id, exact=exact, begun=begun)

        calls = guard.kept_open(guard.put_near(calls))
        wrong = reason(calls)
        if not wrong:
            return calls, ""
        held = held_name(answer, request)
        # of what is only the rest of a request, any part would do
        part = () if request.done else trimmed(
            calls, lambda some: reason(some) or str(objection(some, held=held) or "")
        )  # fmt: skip
        return (part, "") if part else (calls, wrong)


def by_no_model(text: str = "") -> Completion:
    """Return the completion of an answer that no model gave."""
    return Completion(
        text=text, finish="stop", prompt_tokens=0, reused_tokens=0, completion_tokens=0,
        first_token_s=None, total_s=0.0,
    )  # fmt: skip


def known_here(request: PlanRequest) -> frozenset[str]:
    """Return the object types that the agent knows of in this room."""
    kinds = {kind for area in request.areas for kind in area.contains}
    kinds |= {unit.object_type for unit in request.units}
    return frozenset(kinds | {sight.object_type for sight in request.seen})


def fields_of(asked: Request) -> list[str]:
    """Return the parsed actions of a request, then its exclusions, a line each."""
    flat = [replace(deed, things=(one,)) for deed in asked.deeds for one in deed.things]
    known = [deed for deed in flat if deed.deed and deed.things[0].types]
    lines = [said(deed, plain=True) for deed in known]
    ruled_out = (deed for deed in asked.forbidden if deed.things)
    lines += [f"do not {deed.verb} the {deed.things[0].text}" for deed in ruled_out]
    return [*lines, *(f"leave the {one.text} alone" for one in asked.exclusions)]
