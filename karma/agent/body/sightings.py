"""What the agent has seen and done since an instruction was given, and what a name means by it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from karma.agent.planning.program import UNDONE_BY
from karma.agent.seeing.perceive import place_of
from karma.household.ids import is_part, whole_id
from karma.household.pieces import goes_by, is_piece
from karma.household.places import HAND
from karma.household.states import ENDS
from karma.household.types import object_types
from karma.types.memory import Experience, Known
from karma.types.observation import Observation, SeenObject
from karma.types.roles import Knowledge
from karma.types.space import CameraPose, Pose, Vec3

_CHANGES_M = 2.0  # from so far away a deed may have changed what is seen


@dataclass(slots=True)
class Sightings:
    """The running log: only what was in view or in the agent's own hands."""

    seen: dict[str, SeenObject] = field(default_factory=dict)  # the latest sight of each id
    views: dict[str, Observation] = field(default_factory=dict)  # with the latest sight in view
    seen_from: dict[str, Pose] = field(default_factory=dict)  # where it was within reach
    handled: list[str] = field(default_factory=list)  # in the order of use, with repeats
    effects: dict[str, list[str]] = field(default_factory=dict)  # what no metadata flag tells
    ended: dict[str, list[str]] = field(default_factory=dict)  # states that a deed ended
    missed: dict[str, Vec3] = field(default_factory=dict)  # id -> where it was not found
    aside: frozenset[str] = frozenset()  # ids that no type name means now
    cut: set[str] = field(default_factory=set)  # wholes that were seen sliced
    spilled: set[str] = field(default_factory=set)  # vessels that were thrown
    in_view: dict[str, SeenObject] = field(default_factory=dict)
    within_reach: frozenset[str] = frozenset()  # in view, and not behind glass
    held: SeenObject | None = None
    left: dict[str, str] = field(default_factory=dict)  # opened or on by itself -> what undoes it
    taken: dict[str, str] = field(default_factory=dict)  # id -> id of where it was first taken from
    focus: dict[str, str] = field(default_factory=dict)  # type -> id that a skill last turned to
    looked_from: set[tuple[float, float]] = field(default_factory=set)  # cells, x and z
    looked_into: set[str] = field(default_factory=set)  # what holds things, by id
    looks: list[CameraPose] = field(default_factory=list)  # all of them, the last one last

    def add(self, observation: Observation) -> None:
        """Take note of what is in view, in the hand, or was touched."""
        if not self.looks or self.looks[-1] != observation.camera:
            self.looks.append(observation.camera)
        seen = [sight for sight in observation.seen if sight.is_somewhere]
        self.in_view = {sight.object_id: sight for sight in seen}
        self.within_reach = observation.reachable
        self.held = observation.held
        self.seen_from.update(dict.fromkeys(observation.reachable, observation.pose))
        for sight in (*observation.touched, *observation.seen, *filter(None, [observation.held])):
            self._carry_along(sight)
        for object_id in sorted(observation.cooled):
            self.gain(object_id, "cooled")
        for sight in observation.touched:
            self._note(sight)
        for sight in (*seen, *filter(None, [observation.held])):
            self._note(sight)
            self.views[sight.object_id] = observation

    def experience(self) -> Experience:
        """Return the log as it stands."""
        return Experience(
            seen=dict(self.seen),
            views=dict(self.views),
            held=self.held,
            handled_ids=tuple(self.handled),
            effects={object_id: tuple(words) for object_id, words in self.effects.items()},
            ended={object_id: tuple(words) for object_id, words in self.ended.items()},
            missed=frozenset(self.missed),
            cut=frozenset(self.cut),
            spilled=frozenset(self.spilled),
            left=dict(self.left),
            taken=dict(self.taken),
        )

    def acted(self, action: str, object_id: str, place: str | None) -> None:
        """Note a deed that went well, where another one undoes it.

        `action` is AI2-THOR's; `place` is where the thing was before.
        """
        if action in UNDONE_BY:
            self.left[object_id] = UNDONE_BY[action]
        elif action in ("CloseObject", "ToggleObjectOff"):
            self.left.pop(object_id, None)
        elif action == "PickupObject" and place is not None:
            self.taken.setdefault(object_id, place)

    def spill(self, vessel: str) -> None:
        """Note that a thing was thrown: of what lay in it nobody knows where it is now."""
        self.spilled.add(vessel)
        for object_id in [one for one, sight in self.seen.items() if vessel in sight.parent_ids]:
            del self.seen[object_id]
            self.spill(object_id)

    def _carry_along(self, holder: SeenObject) -> None:
        """Move what lies in a thing by as much as the thing has moved, at every depth."""
        before = self.seen.get(holder.object_id)
        if before is None or before.position_m == holder.position_m:
            return
        by = offset(before.position_m, holder.position_m)
        for object_id, sight in list(self.seen.items()):
            if holder.object_id in sight.parent_ids:
                moved = replace(
                    sight,
                    position_m=shifted(sight.position_m, by),
                    box_center_m=shifted(sight.box_center_m, by),
                )
                self._carry_along(moved)
                self.seen[object_id] = moved

    def _note(self, sight: SeenObject) -> None:
        self.seen[sight.object_id] = self._without_door(sight)
        self.missed.pop(sight.object_id, None)
        if "sliced" in sight.states or is_piece(sight.object_type):
            self._inherit(sight)

    def _without_door(self, sight: SeenObject) -> SeenObject:
        """Return the sight with the box it had when closed: an open door widens AI2-THOR's box."""
        before = self.seen.get(sight.object_id)
        if before is None or "opened" not in sight.states:
            return sight
        if before.position_m != sight.position_m:
            return sight
        return replace(sight, box_center_m=before.box_center_m, box_size_m=before.box_size_m)

    def _inherit(self, sight: SeenObject) -> None:
        """Give a slice what was done to the whole."""
        whole = whole_id(sight.object_id)
        if whole in self.seen or whole in self.effects:
            self.cut.add(whole)
            for word in [*self.effects.get(whole, []), "sliced"]:
                self.gain(sight.object_id, word)
        elif (kind := object_types().get(sight.object_type)) and kind.slices_into:
            self.cut.add(sight.object_id)

    def states(self, sight: SeenObject) -> tuple[str, ...]:
        """Return the states of a thing, as the last look that had it in view shows them."""
        view = self.views.get(sight.object_id)
        return sight.states if view is None else view.look_at(sight)

    @property
    def held_id(self) -> str | None:
        """Id of what is in the hand."""
        return self.held.object_id if self.held else None

    def changed(self, object_id: str, position: Vec3) -> None:
        """Note that something was done to a thing: there may be more to see around it now."""
        self.looked_into.discard(object_id)
        x, _, z = position
        self.looks = [
            one for one in self.looks if math.dist(one.position_m[::2], (x, z)) > _CHANGES_M
        ]
        self.looked_from = {
            cell for cell in self.looked_from if math.dist(cell, (x, z)) > _CHANGES_M
        }

    def gain(self, object_id: str, word: str) -> None:
        """Note a lasting effect on an object, once; its opposite has ended."""
        words = self.effects.setdefault(object_id, [])
        if (opposite := ENDS.get(word)) in words:
            words.remove(opposite)
        if word not in words:
            words.append(word)

    def end(self, object_id: str, word: str) -> None:
        """Note that a deed ended a state, once."""
        words = self.ended.setdefault(object_id, [])
        if word not in words:
            words.append(word)

    def switched(self, observation: Observation) -> None:
        """Note what a switched-on tap or oven did to the things the agent knows of."""
        for word, ids in (("cleaned", observation.washed), ("heated", observation.heated)):
            for object_id in sorted(ids):
                self.gain(object_id, word)

    def sliced(self, whole: str, observation: Observation) -> None:
        """Note a cut: the whole is no more, its slices inherit what was done to it."""
        self.gain(whole, "sliced")
        self.cut.add(whole)
        for sight in observation.pieces:
            self._note(sight)


def offset(before: Vec3, now: Vec3) -> Vec3:
    """Return how far a thing has moved, metres."""
    return (now[0] - before[0], now[1] - before[1], now[2] - before[2])


def shifted(point: Vec3, by: Vec3) -> Vec3:
    """Return a point moved by so much."""
    return (point[0] + by[0], point[1] + by[1], point[2] + by[2])


def known(sight: SeenObject, source: Any) -> Known:
    """Return a sight as a belief about where the thing is."""
    place = place_of(sight)
    return Known(
        object_id=sight.object_id,
        object_type=sight.object_type,
        position_m=sight.position_m,
        place_id=None if place == HAND else place,
        source=source,
    )


def means(name: str, sight: SeenObject) -> bool:
    """Return whether a name may mean this object: its id or type, or those of its whole."""
    object_id, kind = sight.object_id, sight.object_type
    return goes_by(name, object_id, kind) or (is_piece(kind) and is_part(object_id, name))


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
        held = held and self._log.held_id not in self._log.aside
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
