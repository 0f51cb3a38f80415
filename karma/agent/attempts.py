"""The programs tried for an instruction, and the request to the planner after a failure."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

from karma.agent.body.afterwards import checked
from karma.agent.body.refusals import NOT_FOUND
from karma.agent.planning.first_program import left_undone, replaces_first
from karma.agent.planning.planner import grounded
from karma.agent.planning.program import PUTS
from karma.household.uses import kind_of
from karma.types.events import Check, Plan, SkillResult
from karma.types.memory import Experience
from karma.types.planning import FailedProgram, PlanRequest, SkillCall


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempts:
    """The programs of a request; the first executed program defines its objects and effects."""

    instruction: str
    objects: Mapping[str, Collection[str]] = field(default_factory=dict)  # mentioned, and types
    first: tuple[SkillCall, ...] = ()
    calls: tuple[SkillCall, ...] = ()  # of the last program
    results: tuple[SkillResult, ...] = ()  # of the last program, up to its first failure
    before: tuple[SkillResult, ...] = ()  # successful ones of the others

    def with_program(
        self, calls: tuple[SkillCall, ...], results: Iterable[SkillResult]
    ) -> "Attempts":
        """Return the attempts with an executed program and its results."""
        is_first = not self.first or replaces_first(
            self.first, calls, self.instruction, self.objects
        )
        return replace(
            self,
            first=calls if is_first else self.first,
            calls=calls,
            results=tuple(results),
            before=self.before + tuple(result for result in self.results if result.ok),
        )

    def with_result(self, result: SkillResult) -> "Attempts":
        """Return the attempts with a successful call after the last program."""
        tried = len(self.results)
        calls = (*self.calls[:tried], result.call, *self.calls[tried:])
        return replace(self, calls=calls, results=(*self.results, result))

    @property
    def ran(self) -> bool:
        """Whether every line of the last program succeeded."""
        return bool(self.results) and all(result.ok for result in self.results)

    @property
    def finished(self) -> bool:
        """Whether the last program ran, and nothing of the first program is left undone."""
        return self.ran and not left_undone(self.first, self.done, self.instruction)

    @property
    def done(self) -> tuple[SkillCall, ...]:
        """All successful calls, in order."""
        return tuple(result.call for result in (*self.before, *self.results) if result.ok)

    def checks(self, experience: Experience) -> tuple[Check, ...]:
        """Return the observed state of each effect of the programs."""
        planned = [*(result.call for result in self.before), *self.calls]
        left = left_undone(self.first, planned, self.instruction)
        planned += [call for call in self.first if kind_of(call.objects[0]) in left]
        return checked(planned, (*self.before, *self.results), experience)

    def failure_told(self, request: PlanRequest) -> PlanRequest:
        """Return the request after a failure: program quoted, missing objects excluded."""
        result = self.results[-1]
        unsuccessful = result.call.skill == "Explore" and result.reason.startswith(NOT_FOUND)
        missing = result.call.objects[-1:] if unsuccessful else ()
        failure = FailedProgram(
            lines=tuple(map(str, self.calls)),
            failed=len(self.results) - 1,
            reason=result.detail or result.reason,
            ran=True,
        )
        return replace(
            request,
            error=f"{result.call}: {result.reason}",
            failures=(*request.failures, failure),
            missing=(*request.missing, *missing),
            first=self.first,
            done=self.done,
        )


def bound(answer: Plan, only: Mapping[str, str]) -> tuple[SkillCall, ...]:
    """Return an answer's calls with ids; `only`: type -> id of the single admitted object."""
    calls = []
    for call in grounded(answer.calls, answer.names):
        first = only.get(kind_of(call.objects[0]))
        place = only.get(kind_of(call.objects[-1])) if call.skill in PUTS else None
        if place is not None:
            call = replace(call, objects=(*call.objects[:-1], place), exact=True)
        if first is not None and (call.objects[1:] or call.skill != "PutObject"):
            call = replace(call, objects=(first, *call.objects[1:]), turn=0)
        calls.append(call)
    return tuple(calls)
