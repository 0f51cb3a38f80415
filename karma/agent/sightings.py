"""What the agent has seen and done since it began, and which object a name means."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from karma.agent.perceive import place_of
from karma.contracts import Knowledge, Known, Observation, Pose, SeenObject, Vec3
from karma.household.ids import is_part, whole_id
from karma.household.pieces import goes_by, is_piece
from karma.household.places import HAND
from karma.household.types import object_types

_CHANGES_M = 2.0  # from so far away a deed may have changed what is seen
_SAME_PLACE_M = 0.3  # a memory this near to where a thing was missed is the same, stale memory


@dataclass(slots=True)
class Sightings:
    """The running log: only what was in view or in the agent's own hands."""

    seen: dict[str, SeenObject] = field(default_factory=dict)  # the latest sight of each id
    views: dict[str, Observation] = field(default_factory=dict)  # with the latest sight in view
    seen_from: dict[str, Pose] = field(default_factory=dict)  # where it was within reach
    handled: list[str] = field(default_factory=list)  # in the order of use, with repeats
    effects: dict[str, list[str]] = field(default_factory=dict)  # what no metadata flag tells
    missed: dict[str, Vec3] = field(default_factory=dict)  # id -> where it was not found
    cut: set[str] = field(default_factory=set)  # wholes that were seen sliced
    in_view: dict[str, SeenObject] = field(default_factory=dict)
    within_reach: frozenset[str] = frozenset()  # in view, and not behind glass
    held: SeenObject | None = None
    focus: dict[str, str] = field(default_factory=dict)  # type -> id that a skill last turned to
    looked_from: set[tuple[float, float]] = field(default_factory=set)  # cells, x and z
    looked_into: set[str] = field(default_factory=set)  # containers, by id

    def add(self, observation: Observation) -> None:
        """Take note of what is in view, in the hand, or was touched."""
        self.in_view = {sight.object_id: sight for sight in observation.seen}
        self.within_reach = observation.reachable
        self.held = observation.held
        self.seen_from.update(dict.fromkeys(observation.reachable, observation.pose))
        for sight in observation.touched:
            self._note(sight)
        for sight in (*observation.seen, *filter(None, [observation.held])):
            self._note(sight)
            self.views[sight.object_id] = observation

    def _note(self, sight: SeenObject) -> None:
        self.seen[sight.object_id] = self._without_door(sight)
        self.missed.pop(sight.object_id, None)
        if "sliced" in sight.states:
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

    @property
    def held_id(self) -> str | None:
        """Id of what is in the hand."""
        return self.held.object_id if self.held else None

    def miss(self, object_id: str, position: Vec3) -> None:
        """Note that a thing is not where it was believed to be."""
        self.missed[object_id] = position

    def changed(self, object_id: str, position: Vec3) -> None:
        """Note that something was done to a thing: there may be more to see around it now."""
        self.looked_into.discard(object_id)
        x, _, z = position
        self.looked_from = {
            cell for cell in self.looked_from if math.dist(cell, (x, z)) > _CHANGES_M
        }

    def gain(self, object_id: str, word: str) -> None:
        """Note a lasting effect on an object, once."""
        words = self.effects.setdefault(object_id, [])
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

    # ------------------------------------------------------------- what a name means

    def resolve(
        self, name: str, knowledge: Knowledge, here: "Here", *, state: str = "", held: bool = True
    ) -> Known | None:
        """Return the object that a name means, or None if the agent knows of none.

        In this order: the id itself; what is held; what a skill last turned to, if in view; what
        memory knows; the nearest in view; the nearest seen before.

        Args:
            name: object id or type.
            knowledge: the agent's memory.
            here: horizontal distance from the agent.
            state: a word that is to be preferred among several of a type in view.
            held: whether the thing in the hand may be meant.
        """
        if held and self.held and means(name, self.held):
            return known(self.held, "held")
        found = self._believed(name, knowledge, here, held=held)
        if found is not None and found.object_id != name and state:
            sight = self.in_view.get(found.object_id)
            if sight is None or state not in sight.states:
                found = self._nearest(name, self.in_view, here, state=state) or found
        return self._slice_of(found, here) if found else None

    def _believed(
        self, name: str, knowledge: Knowledge, here: "Here", *, held: bool
    ) -> Known | None:
        if name in self.seen and name not in self.missed and (held or name != self.held_id):
            return known(self.seen[name], "seen")
        focus = self.in_view.get(self.focus.get(name, ""))
        if focus and not focus.pickupable:
            return known(focus, "seen")
        last = self.focus.get(name, "")  # of several the one in use, wherever it is by now
        there = last in self.handled and last in self.seen and last not in self.missed
        if there and (held or last != self.held_id):
            return known(self.seen[last], "seen")
        found = knowledge.where(name)
        if found and self._credible(found) and (held or found.object_id != self.held_id):
            sight = self.seen.get(found.object_id)
            return known(sight, found.source) if sight and sight is not self.held else found
        return self._nearest(name, self.in_view, here) or self._nearest(name, self.seen, here)

    def _credible(self, found: Known) -> bool:
        """Return whether a memory is not the one that was just found to be wrong."""
        missed = self.missed.get(found.object_id)
        return missed is None or math.dist(missed, found.position_m) > _SAME_PLACE_M

    def _nearest(
        self, name: str, sights: Mapping[str, SeenObject], here: "Here", *, state: str = ""
    ) -> Known | None:
        fitting = [
            sight
            for object_id, sight in sights.items()
            if means(name, sight) and object_id not in self.missed and object_id != self.held_id
            if not state or state in sight.states
        ]
        if not fitting:
            return None
        near = min(
            fitting, key=lambda s: (s.object_id in self.cut, here(s.box_center_m), s.object_id)
        )
        return known(near, "seen")

    def others(self, one: Known, here: "Here") -> list[Known]:
        """Return the other things of a type that were seen and are not closed, nearest first."""
        sights = [
            sight
            for sight in self.seen.values()
            if sight.object_type == one.object_type and sight.object_id != one.object_id
            if "closed" not in sight.states and sight.object_id != self.held_id
        ]
        sights.sort(key=lambda sight: (here(sight.box_center_m), sight.object_id))
        return [known(sight, "seen") for sight in sights]

    def _slice_of(self, whole: Known, here: "Here") -> Known:
        """Return the nearest slice of a thing that has been cut, else the thing."""
        if whole.object_id not in self.cut:
            return whole
        parts = {k: v for k, v in self.seen.items() if is_part(k, whole.object_id)}
        views = {k: v for k, v in parts.items() if k in self.in_view}
        name = whole.object_id
        return self._nearest(name, views, here) or self._nearest(name, parts, here) or whole


Here = Callable[[Vec3], float]


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
