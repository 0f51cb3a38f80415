"""HELPER's executor: repairs each sub-goal, finds its objects, and does it."""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from karma.bench.rows.baseline import Budget, is_known_tap
from karma.bench.rows.capeam.prior import likely_places
from karma.bench.rows.helper.inspector import (
    ends_there,
    idle,
    whole_first,
    with_object,
    without_object,
)
from karma.bench.rows.helper.memory import ObjectMemory
from karma.contracts import Area, SeenObject, SkillCall, SkillResult, Vec3
from karma.household.uses import FOUND_BY_SKILL

LIKELY = 3  # kinds of places asked for
INSTANCES = 2  # of each kind
NEAR_STEPS = 75  # for one of those
POINT_STEPS = 50  # for one point anywhere
POINTS = 20

Ending = Literal["done", "failed", "skipped"]
Deed = Generator[SkillResult, None, bool]  # returns whether it worked


class Executor:
    """Carries out sub-goals of one instruction.

    Args:
        budget: of the body, whose knowledge is `memory`.
        memory: the sequence's object memory.
        points: cells to stand on, for looking anywhere.
        rng: draws among them.
    """

    def __init__(
        self,
        budget: Budget,
        memory: ObjectMemory,
        points: Sequence[Vec3],
        rng: np.random.Generator,
    ) -> None:
        self.skills, self.memory, self.budget = budget.skills, memory, budget
        self.last_error = ""
        self._points, self._rng = points, rng
        self._landmark = ""  # what was opened last and not closed since
        self._put = ""  # what was put down last

    def look(self) -> None:
        """Write what the skills saw and did into memory."""
        self.memory.observe(self.skills.experience)

    def subgoal(
        self, call: SkillCall, rest: Sequence[SkillCall]
    ) -> Generator[SkillResult, None, Ending]:
        """Carry out one sub-goal, yielding everything done for it; returns what came of it.

        Args:
            call: with types for names, as planned.
            rest: what is planned after it.
        """
        if any(name in self.memory.could_not_find for name in call.objects):
            return "skipped"
        first = whole_first(call, self.memory)
        for step in [*([first] if first else []), call]:
            if not (yield from self._repaired(step)):
                return "failed"
        if call.skill == "PutObject" and len(call.objects) == 2 and ends_there(call, rest):
            self.memory.finish(self._put)
        return "done"

    # ------------------------------------------------------------- the inspector at work

    def _repaired(self, call: SkillCall) -> Deed:
        """Do what must come first, then the call itself."""
        for step in [*without_object(call, self.skills.experience.held, self.memory), call]:
            if not (yield from self._located(step)):
                return False
            ready = self._ground(step)
            if idle(ready, self.memory) or step.skill == "Explore":
                continue
            for deed in [*with_object(ready, self.memory), ready]:
                if not (yield from self._do(deed)):
                    return False
        return True

    def _ground(self, call: SkillCall) -> SkillCall:
        """Put the ids of the best known objects in place of types."""
        best = {name: self.memory.best(name) for name in call.objects if name not in FOUND_BY_SKILL}
        names = {name: one.sight.object_id for name, one in best.items() if one is not None}
        return replace(call, objects=tuple(names.get(name, name) for name in call.objects))

    def _do(self, call: SkillCall) -> Deed:
        """Run one skill and write down what came of it."""
        held = self.skills.experience.held
        result = self.skills.run(call, max_actions=self.budget.left)
        self.look()
        yield result
        if not result.ok:
            self.memory.failed(call.objects[-1])
            self._fail(call, result.reason)
        elif call.skill == "PutObject" and held is not None:
            self._put = held.object_id
            self.memory.placed(held.object_id)
        elif call.skill in ("OpenObject", "CloseObject"):
            self._landmark = call.objects[0] if call.skill == "OpenObject" else ""
        return result.ok

    def _fail(self, call: SkillCall, reason: str) -> None:
        self.budget.failures += 1
        self.last_error = f"Failed sub-goal: {call}. Error: {reason}"

    # ------------------------------------------------------------- the locator

    def _located(self, call: SkillCall) -> Deed:
        """Look for what is not in memory: near the landmark, where it is likely, anywhere."""
        near = [place for place in call.positions if isinstance(place, str)]
        for name in call.objects:
            if is_known_tap(name, self.skills) or self.memory.best(name) is not None:
                continue
            for place in self._places(name, near):
                yield self._search(name, place)
                if self.memory.best(name) is not None or self.budget.is_spent:
                    break
            if self.memory.best(name) is None:
                self.memory.could_not_find.add(name)
                self._fail(call, f"could not find {name}")
                return False
        return True

    def _places(self, name: str, near: Sequence[str]) -> Iterator[SeenObject | Area]:
        """Yield places to look at: landmarks, likely furniture, then cells drawn at random."""
        marks = [*near, *([self._landmark] if self._landmark else [])]
        tried: set[str] = set()
        for kind in [*marks, *list(likely_places(name))[:LIKELY]]:
            for one in self.memory.of(kind)[:INSTANCES]:
                if one.sight.object_id not in tried:
                    tried.add(one.sight.object_id)
                    yield one.sight
        order = self._rng.permutation(len(self._points))[:POINTS]
        for number in order:
            yield Area(name=f"point_{number}", position_m=self._points[number])

    def _search(self, name: str, place: SeenObject | Area) -> SkillResult:
        most = self.budget.left
        if isinstance(place, Area):
            result = self.skills.look_from(name, place, max_actions=min(POINT_STEPS, most))
        elif "closed" in place.states:
            result = self.skills.look_into(name, place, max_actions=min(NEAR_STEPS, most))
        else:
            area = Area(name=place.object_id, position_m=place.box_center_m)
            result = self.skills.look_from(name, area, max_actions=min(NEAR_STEPS, most))
        self.look()
        return result
