"""Check a planner's answers against a parsed request: the hook of the core's planner."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from karma.agent.planning.goal_lines import program_for
from karma.agent.planning.inspector import objection
from karma.agent.planning.planner import grounded, known_here
from karma.plugins.rules.language.clauses import plainly, said
from karma.plugins.rules.request_checker import Guard
from karma.plugins.rules.request_goals import asked_lines
from karma.plugins.rules.trimming import trimmed
from karma.plugins.rules.types import Request
from karma.types.planning import Advice, PlanRequest, RefusedRequest, SkillCall

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

    def contradicts(self, refused: RefusedRequest) -> bool:
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

    def check(
        self, calls: Sequence[SkillCall], request: PlanRequest, names: Mapping[str, str]
    ) -> tuple[tuple[SkillCall, ...], str]:
        """Return a program or its requested part, and the objection if no part is requested."""
        guard, exact = Guard(self.asked, known_here(request)), len(request.failures) < _LOOSE_AFTER

        def reason(some: Sequence[SkillCall]) -> str:
            meant, begun = grounded(some, names), bool(request.done)
            return guard.stopped(meant, request.held_id, exact=exact, begun=begun)

        calls = guard.kept_open(guard.put_near(calls))
        wrong = reason(calls)
        if not wrong:
            return calls, ""
        held = next((name for name, id_ in names.items() if id_ == request.held_id), None)
        # of what is only the rest of a request, any part would do
        part = () if request.done else trimmed(
            calls, lambda some: reason(some) or str(objection(some, held=held) or "")
        )  # fmt: skip
        return (part, "") if part else (calls, wrong)

    def program(self, request: PlanRequest, names: Mapping[str, str]) -> tuple[SkillCall, ...]:
        """Return the rule-based planner's program for the words, or ()."""
        lines = asked_lines(self.asked, known_here(request))
        return program_for(lines, request.units, names) if lines else ()


def fields_of(asked: Request) -> list[str]:
    """Return the parsed actions of a request, then its exclusions, a line each."""
    flat = [replace(deed, things=(one,)) for deed in asked.deeds for one in deed.things]
    known = [deed for deed in flat if deed.deed and deed.things[0].types]
    lines = [said(deed, plain=True) for deed in known]
    ruled_out = (deed for deed in asked.forbidden if deed.things)
    lines += [f"do not {deed.verb} the {deed.things[0].text}" for deed in ruled_out]
    return [*lines, *(f"leave the {one.text} alone" for one in asked.exclusions)]
