"""Which object a name means to the agent now."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from karma.agent.body.sightings import Sightings, known, means, offset, shifted
from karma.contracts import Knowledge, Known, SeenObject, Vec3
from karma.household.ids import is_part

_DEEPEST = 5  # things in things that are asked for
_SAME_PLACE_M = 0.3  # a memory this near to where a thing was missed is the same, stale memory


class Naming:
    """From names to things: the log and memory asked in order.

    `before` is what was seen here earlier, by id; no other name means such a thing.
    """

    def __init__(
        self,
        log: Sightings,
        knowledge: Knowledge,
        gap_m: Callable[[Vec3], float],
        before: Mapping[str, SeenObject],
    ) -> None:
        self._log, self._knowledge, self._gap, self._before = log, knowledge, gap_m, before

    def __contains__(self, object_id: object) -> bool:
        """Return whether the agent has seen a thing, or remembers it."""
        return object_id in self._log.seen or self._knowledge.where(str(object_id)) is not None

    def find(self, name: str, *, state: str = "", held: bool = True) -> Known | None:
        """Return the object that a name means, or None if the agent knows of none.

        In this order: the id itself; what is held; what a skill last turned to, if in view; what
        memory knows; the nearest in view; the nearest seen before.

        `state` is preferred among several of a type in view; `held`: the thing in the hand may be
        meant.
        """
        if held and self._log.held and means(name, self._log.held):
            return known(self._log.held, "held")
        found = self._believed(name, held=held)
        if found is not None and found.object_id != name and state:
            sight = self._log.in_view.get(found.object_id)
            if sight is None or state not in self._log.states(sight):
                found = self._nearest(name, self._log.in_view, state=state) or found
        return self._slice_of(found) if found else None

    def _believed(self, name: str, *, held: bool) -> Known | None:
        log = self._log
        if name in log.seen and name not in log.missed and (held or name != log.held_id):
            return known(log.seen[name], "seen")
        last = log.focus.get(name, "")  # of several the one in use, wherever it is by now
        last = "" if last in log.aside else last
        focus = log.in_view.get(last)
        if focus and not focus.pickupable:
            return known(focus, "seen")
        there = last in log.handled and last in log.seen and last not in log.missed
        if there and (held or last != log.held_id):
            return known(log.seen[last], "seen")
        found = self._knowledge.where(name)
        if found and self._credible(found) and (held or found.object_id != log.held_id):
            sight = log.seen.get(found.object_id)
            if sight and sight is not log.held:
                return known(sight, found.source)
            return self._carried_along(found)
        found = self._nearest(name, log.in_view) or self._nearest(name, log.seen)
        if found is None and name in self._before and name not in log.missed:
            return known(self._before[name], "seen")
        return found

    def _carried_along(self, found: Known) -> Known:
        """Return a memory of what lies in a thing that has been moved since, as moved with it."""
        place_id, depth = found.place_id, 0
        while place_id is not None and depth < _DEEPEST:
            sight, then = self._log.seen.get(place_id), self._knowledge.where(place_id)
            if sight is not None and then is not None and sight.pickupable:
                by = offset(then.position_m, sight.position_m)
                return replace(found, position_m=shifted(found.position_m, by))
            place_id, depth = then.place_id if then is not None else None, depth + 1
        return found

    def _credible(self, found: Known) -> bool:
        """Return whether a memory is not the one that was just found to be wrong."""
        if found.object_id in self._log.aside:
            return False
        missed = self._log.missed.get(found.object_id)
        return missed is None or math.dist(missed, found.position_m) > _SAME_PLACE_M

    def _nearest(
        self, name: str, sights: Mapping[str, SeenObject], *, state: str = ""
    ) -> Known | None:
        log = self._log
        fitting = [
            sight
            for object_id, sight in sights.items()
            if means(name, sight) and object_id not in log.missed and object_id != log.held_id
            if object_id not in log.aside and (not state or state in log.states(sight))
        ]

        def rank(sight: SeenObject) -> tuple[bool, float, str]:
            return sight.object_id in log.cut, self._gap(sight.box_center_m), sight.object_id

        near = min(fitting, key=rank, default=None)
        return known(near, "seen") if near is not None else None

    def others(self, one: Known) -> list[Known]:
        """Return the other things of a type that were seen and are not closed, nearest first."""
        sights = [
            sight
            for sight in self._log.seen.values()
            if sight.object_type == one.object_type and sight.object_id != one.object_id
            if "closed" not in self._log.states(sight) and sight.object_id != self._log.held_id
        ]
        sights.sort(key=lambda sight: (self._gap(sight.box_center_m), sight.object_id))
        return [known(sight, "seen") for sight in sights]

    def _slice_of(self, whole: Known) -> Known:
        """Return the nearest slice of a thing that has been cut, else the thing."""
        if whole.object_id not in self._log.cut:
            return whole
        parts = {k: v for k, v in self._log.seen.items() if is_part(k, whole.object_id)}
        views = {k: v for k, v in parts.items() if k in self._log.in_view}
        name = whole.object_id
        return self._nearest(name, views) or self._nearest(name, parts) or whole
