"""Programs that are tried: carried out until a line is refused, and told of in the next request.

What an errand changed besides is put back: doors are shut, what ran is off, tools lie again.
"""

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from karma.agent.body.afterwards import checked
from karma.agent.body.refusals import NOT_FOUND
from karma.agent.body.sightings import offset, shifted
from karma.agent.body.skills import Skills
from karma.agent.planning.first_program import left_undone
from karma.agent.planning.planner import grounded
from karma.agent.planning.program import PUTS
from karma.agent.seeing.perceive import place_of
from karma.contracts import (
    Check,
    Experience,
    FailedProgram,
    MemoryUnit,
    Plan,
    PlanRequest,
    Request,
    SaidDeed,
    SkillCall,
    SkillResult,
)
from karma.household.deeds import deed_kind
from karma.household.ids import type_of
from karma.household.places import HAND
from karma.household.uses import LAMPS, kind_of, switch_of
from karma.memory.short_term import merged_states


@dataclass(slots=True)
class Programs:
    """The programs of one request; the first that was carried out says what is to be done."""

    instruction: str
    first: tuple[SkillCall, ...] = ()
    calls: tuple[SkillCall, ...] = ()  # of the last
    results: Sequence[SkillResult] = ()  # of the last, as far as it was tried
    before: tuple[SkillResult, ...] = ()  # what went well of the others

    def add(self, plan: Plan, results: Sequence[SkillResult]) -> None:
        """Take in a program that was carried out, as far as it went."""
        self.before += tuple(result for result in self.results if result.ok)
        self.calls, self.results = grounded(plan.calls, plan.names), results
        self.first = self.first or self.calls

    def go_on(self, result: SkillResult) -> None:
        """Take in one more call that went well."""
        tried = len(self.results)
        self.calls = (*self.calls[:tried], result.call, *self.calls[tried:])
        self.results = [*self.results, result]

    @property
    def ran(self) -> bool:
        """Whether every line of the last program went well."""
        return bool(self.results) and all(result.ok for result in self.results)

    @property
    def finished(self) -> bool:
        """Whether, besides, nothing is left that the first one was to do."""
        return self.ran and not left_undone(self.first, self.done, self.instruction)

    @property
    def done(self) -> tuple[SkillCall, ...]:
        """All calls that went well, in order."""
        return tuple(result.call for result in (*self.before, *self.results) if result.ok)

    def checks(self, experience: Experience) -> tuple[Check, ...]:
        """Return how it stands with all that was done and that was to be done."""
        told = [*(result.call for result in self.before), *self.calls]
        left = left_undone(self.first, told, self.instruction)
        told += [call for call in self.first if kind_of(call.objects[0]) in left]
        return checked(told, (*self.before, *self.results), experience)


def carried_out(
    plan: Plan, skills: Skills, only: Mapping[str, str] | None = None
) -> Generator[SkillResult, None, list[SkillResult]]:
    """Run a program until a call is refused; returns what came of each call that was tried.

    `only`: type -> id of the one thing of the type that is meant.
    """
    results: list[SkillResult] = []
    skills.begin_program()
    for call in grounded(plan.calls, plan.names):
        call = _of_one(call, only or {})
        results.append(skills.run(call))
        yield results[-1]
        if not results[-1].ok:
            break
    return results


def _of_one(call: SkillCall, only: Mapping[str, str]) -> SkillCall:
    """Return a call about the one thing and place that is meant, not about another of its type."""
    first = only.get(kind_of(call.objects[0]))
    place = only.get(kind_of(call.objects[-1])) if call.skill in PUTS else None
    if place is not None:
        call = replace(call, objects=(*call.objects[:-1], place), exact=True)
    if first is None or (not call.objects[1:] and call.skill == "PutObject"):
        return call
    return replace(call, objects=(first, *call.objects[1:]), turn=0)


def after_run(request: PlanRequest, programs: Programs) -> PlanRequest:
    """Return the request after a failure: told of, and not searched for again what is not there.

    The last of the programs' results is the refusal.
    """
    result = programs.results[-1]
    in_vain = result.call.skill == "Explore" and result.reason.startswith(NOT_FOUND)
    missing = result.call.objects[-1:] if in_vain else ()
    failure = FailedProgram(
        lines=tuple(map(str, programs.calls)),
        failed=len(programs.results) - 1,
        reason=result.detail or result.reason,
        ran=True,
    )
    return replace(
        request,
        error=f"{result.call}: {result.reason}",
        failures=(*request.failures, failure),
        missing=(*request.missing, *missing),
        done=programs.done,
    )


def as_left(units: Iterable[MemoryUnit], experience: Experience) -> list[MemoryUnit]:
    """Return units with what the agent's deeds made of them, handled or not.

    What a tap or an oven did to a thing that was only remembered there is added. What was poured
    out is not filled: other states end when their opposite comes; these have none. What was seen is
    where it was seen; what lies in a thing that was moved has moved with it.
    """
    before = {unit.object_id: unit for unit in units}
    changed = []
    for unit in before.values():
        ended = experience.ended.get(unit.object_id, ())
        effects = experience.effects.get(unit.object_id, ())
        states = tuple(word for word in unit.states if word not in ended)
        placed = _placed(unit, before, experience)
        changed.append(replace(placed, states=merged_states(states, effects)))
    return changed


def lost(units: Iterable[MemoryUnit], experience: Experience) -> list[MemoryUnit]:
    """Return the units to forget: cut, missed where they were, or thrown with what they lay in."""
    before = {unit.object_id: unit for unit in units}

    def is_spilled(unit: MemoryUnit | None, depth: int = 0) -> bool:
        if unit is None or depth > len(before) or unit.object_id in experience.seen:
            return False
        return unit.place_id in experience.spilled or is_spilled(
            before.get(unit.place_id or ""), depth + 1
        )

    return [
        unit for unit in before.values() if unit.object_id in experience.gone or is_spilled(unit)
    ]


def _placed(
    unit: MemoryUnit, before: Mapping[str, MemoryUnit], experience: Experience
) -> MemoryUnit:
    """Return a unit where it is by now, as far as the agent's own eyes and hands know."""
    sight = experience.seen.get(unit.object_id)
    if sight is not None:
        return replace(unit, position_m=sight.position_m, place_id=place_of(sight))
    holder, passed = unit.place_id, set[str]()
    while holder is not None and holder not in passed:
        passed.add(holder)
        sight, then = experience.seen.get(holder), before.get(holder)
        if sight is not None:
            if not sight.pickupable:
                return unit
            by = offset(then.position_m, sight.position_m) if then is not None else None
            at = shifted(unit.position_m, by) if by is not None else sight.position_m
            return replace(unit, position_m=at)
        holder = then.place_id if then is not None else None
    return unit


# ----------------------------------------------------------------- what is put back


def put_back(asked: Request, skills: Skills) -> Iterator[SkillResult]:
    """Undo what nobody asked for, as far as the world lets it; what it refuses is left."""
    for call in _tool_put_down(asked, skills.experience):
        yield skills.run(call)
    for name, skill in reversed(list(skills.experience.left.items())):
        if not _is_wanted(asked, name, skill):
            yield skills.run(SkillCall.of(skill, name))


def _tool_put_down(asked: Request, experience: Experience) -> Iterator[SkillCall]:
    """Yield what puts a tool that is still held back to where it was taken from."""
    held = experience.held
    place = experience.taken.get(held.object_id) if held is not None else None
    if held is None or place is None or place == HAND:
        return
    deeds = {deed.deed for deed in asked.deeds}
    tools = {one for deed in deeds for one in deed_kind(deed).tools}
    named = {kind_of(one) for thing in asked.mentions for one in thing.types}
    if kind_of(held.object_type) not in tools - named:
        return
    sight = experience.seen.get(place)
    if sight is not None and "closed" in sight.states:
        yield SkillCall.of("OpenObject", place)
    yield SkillCall.of("PutObject", held.object_id, place)


def _is_wanted(asked: Request, name: str, skill: str) -> bool:
    """Return whether a door was to be open, or something to run."""
    deeds = ("open",) if skill == "CloseObject" else ("on", "look")
    against = "close" if skill == "CloseObject" else "off"
    kept = [deed for deed in asked.forbidden if deed.deed == against]
    kind, about = kind_of(type_of(name)), _kinds(kept)
    if kept and (kind in about or not about):
        return True  # "but don't close the door"
    said = [deed for deed in (*asked.deeds, *asked.rest) if deed.deed in deeds]
    if any(not deed.things or any(t.anything or t.told for t in deed.things) for deed in said):
        return True
    lit = kind in LAMPS and any(deed.deed == "look" for deed in said)
    return lit or switch_of(kind) in map(switch_of, _kinds(said))


def _kinds(deeds: Iterable[SaidDeed]) -> set[str]:
    """Return the kinds of things that some deeds are about."""
    return {kind_of(kind) for deed in deeds for thing in deed.things for kind in thing.types}
