"""Programs that are tried: carried out until a line is refused, and told of in the next request."""

from collections.abc import Generator, Iterable, Sequence
from dataclasses import replace

from karma.agent.planner import grounded
from karma.agent.skills import Skills
from karma.contracts import Experience, FailedProgram, MemoryUnit, Plan, PlanRequest, SkillResult
from karma.memory.short_term import merged_states


def carried_out(plan: Plan, skills: Skills) -> Generator[SkillResult, None, list[SkillResult]]:
    """Run a program until a call is refused; returns what came of each call that was tried."""
    results: list[SkillResult] = []
    skills.begin_program()
    for call in grounded(plan.calls, plan.names):
        results.append(skills.run(call))
        yield results[-1]
        if not results[-1].ok:
            break
    return results


def after_answer(request: PlanRequest, plan: Plan) -> PlanRequest:
    """Return the request after an answer: one that was refused is told of."""
    if plan.failure is None:
        return request
    return replace(request, failures=(*request.failures, plan.failure))


def after_run(request: PlanRequest, plan: Plan, results: Sequence[SkillResult]) -> PlanRequest:
    """Return the request after a failure: told of, and not searched for again what is not there.

    Args:
        request: the one before.
        plan: that failed.
        results: of its calls; the last one is the refusal.
    """
    result = results[-1]
    missing = result.call.objects[-1:] if result.call.skill == "Explore" else ()
    failure = FailedProgram(
        lines=tuple(map(str, grounded(plan.calls, plan.names))),
        failed=len(results) - 1,
        reason=result.detail or result.reason,
        ran=True,
    )
    return replace(
        request,
        error=f"{result.call}: {result.reason}",
        failures=(*request.failures, failure),
        missing=(*request.missing, *missing),
    )


def as_left(units: Iterable[MemoryUnit], experience: Experience) -> list[MemoryUnit]:
    """Return units with what the agent's deeds made of them, handled or not.

    What a tap or an oven did to a thing that was only remembered there is added. What was poured
    out is not filled: other states end when their opposite comes; these have none.
    """
    changed = []
    for unit in units:
        ended = experience.ended.get(unit.object_id, ())
        effects = experience.effects.get(unit.object_id, ())
        states = tuple(word for word in unit.states if word not in ended)
        changed.append(replace(unit, states=merged_states(states, effects)))
    return changed
