"""The log of what the agent saw and did since an instruction was given, and the names in it."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

from karma.agent.planning.program import UNDONE_BY
from karma.agent.seeing.perceive import place_of
from karma.household.containment import holders
from karma.household.ids import is_part, whole_id
from karma.household.pieces import goes_by, is_piece
from karma.household.places import HAND
from karma.household.types import object_types
from karma.memory.short_term import merged_states
from karma.types.memory import Experience, Known, MemoryUnit
from karma.types.observation import Observation, SeenObject
from karma.types.roles import Knowledge
from karma.types.space import CameraPose, Pose, Vec3

Belief = TypeVar("Belief", Known, MemoryUnit)
_CHANGES_M = 2.0  # an action may change what is seen from so near


@dataclass(slots=True)
class Sightings:
    """The running log: only what was in view or in the agent's own hands."""

    # the fields of `Experience`
    seen: dict[str, SeenObject] = field(default_factory=dict)
    views: dict[str, Observation] = field(default_factory=dict)
    held: SeenObject | None = None
    handled_ids: tuple[str, ...] = ()
    effects: dict[str, tuple[str, ...]] = field(default_factory=dict)
    missed: dict[str, Vec3] = field(default_factory=dict)
    cut: frozenset[str] = frozenset()
    emptied: frozenset[str] = frozenset()
    spilled: frozenset[str] = frozenset()
    left: dict[str, str] = field(default_factory=dict)
    taken: dict[str, str] = field(default_factory=dict)
    # for skills only
    seen_from: dict[str, Pose] = field(default_factory=dict)  # where it was within reach
    aside: frozenset[str] = frozenset()  # ids that no type name means now
    in_view: dict[str, SeenObject] = field(default_factory=dict)
    within_reach: frozenset[str] = frozenset()  # in view, and not behind glass
    focus: dict[str, str] = field(default_factory=dict)  # type -> id that a skill last turned to
    looked_from: set[tuple[float, float]] = field(default_factory=set)  # cells, x and z
    looked_into: set[str] = field(default_factory=set)  # ids of receptacles
    looks: list[CameraPose] = field(default_factory=list)  # all of them, the last one last

    def experience(self) -> Experience:
        """Return a copy of the log."""
        return Experience(**{one.name: copy(getattr(self, one.name)) for one in fields(Experience)})

    @property
    def held_id(self) -> str | None:
        """Id of what is in the hand."""
        return self.held.object_id if self.held else None

    def states(self, sight: SeenObject) -> tuple[str, ...]:
        """Return the states of an object, as the last look that had it in view shows them."""
        view = self.views.get(sight.object_id)
        return sight.states if view is None else view.look_at(sight)

    # ------------------------------------------------------------- looks

    def add(self, observation: Observation) -> None:
        """Add what is in view, in the hand, or was touched."""
        if not self.looks or self.looks[-1] != observation.camera:
            self.looks.append(observation.camera)
        held = (observation.held,) if observation.held else ()
        seen = [sight for sight in observation.seen if sight.is_somewhere]
        self.in_view = {sight.object_id: sight for sight in seen}
        self.within_reach = observation.reachable
        self.held = observation.held
        self.seen_from.update(dict.fromkeys(observation.reachable, observation.pose))
        for sight in (*observation.touched, *observation.seen, *held):
            self._carry_along(sight)
        gained = {"cleaned": observation.washed, "heated": observation.heated}
        gained["cooled"] = observation.cooled
        for word, ids in gained.items():
            for object_id in sorted(ids):
                self.gain(object_id, word)
        for sight in (*observation.touched, *seen, *held):
            self._note(sight)
        self.views.update({sight.object_id: observation for sight in (*seen, *held)})

    def _carry_along(self, holder: SeenObject) -> None:
        """Move the contents of an object as far as it has moved, at every depth."""
        before = self.seen.get(holder.object_id)
        if before is None or before.position_m == holder.position_m:
            return
        for object_id, sight in list(self.seen.items()):
            if holder.object_id in sight.parent_ids:
                moved = replace(
                    sight,
                    position_m=shifted(sight.position_m, before.position_m, holder.position_m),
                    box_center_m=shifted(sight.box_center_m, before.position_m, holder.position_m),
                )
                self._carry_along(moved)
                self.seen[object_id] = moved

    def _note(self, sight: SeenObject) -> None:
        before = self.seen.get(sight.object_id)
        if before and "opened" in sight.states and before.position_m == sight.position_m:
            # an open door widens AI2-THOR's box; the box of the closed object counts
            box = before.box_center_m, before.box_size_m
            sight = replace(sight, box_center_m=box[0], box_size_m=box[1])
        self.seen[sight.object_id] = sight
        self.missed.pop(sight.object_id, None)
        if "sliced" in sight.states or is_piece(sight.object_type):
            whole = whole_id(sight.object_id)
            if whole in self.seen or whole in self.effects:  # a slice inherits from the whole
                self.cut |= {whole}
                self.gain(sight.object_id, *self.effects.get(whole, ()), "sliced")
            elif (kind := object_types().get(sight.object_type)) and kind.slices_into:
                self.cut |= {sight.object_id}

    # ------------------------------------------------------------- actions

    def acted(self, action: str, object_id: str, place: str | None) -> None:
        """Note a successful action of AI2-THOR, if a skill undoes it or it took from a place."""
        if action in UNDONE_BY:
            self.left[object_id] = UNDONE_BY[action]
        elif action in ("CloseObject", "ToggleObjectOff"):
            self.left.pop(object_id, None)
        elif action == "PickupObject" and place is not None:
            self.taken.setdefault(object_id, place)

    def handled(self, touched: Sequence[str], at: Vec3) -> None:
        """Note that objects were used; there may be more to see around the last now."""
        self.handled_ids += tuple(touched)
        self.looked_into.discard(touched[-1])

        (x, _, z), far = at, _CHANGES_M
        self.looks = [one for one in self.looks if math.dist(one.position_m[::2], (x, z)) > far]
        self.looked_from = {cell for cell in self.looked_from if math.dist(cell, (x, z)) > far}

    def gain(self, object_id: str, *words: str) -> None:
        """Note lasting effects on an object; their opposites have ended."""
        self.effects[object_id] = merged_states(self.effects.get(object_id, ()), words)

    def slice(self, whole: str, pieces: Iterable[SeenObject]) -> None:
        """Note a cut: the whole is no more, its slices inherit what was done to it."""
        self.cut |= {whole}
        for sight in pieces:
            self._note(sight)

    def spill(self, vessel: str) -> None:
        """Note that an object was thrown: its contents may lie anywhere."""
        self.spilled |= {vessel}
        for object_id in [one for one, sight in self.seen.items() if vessel in sight.parent_ids]:
            del self.seen[object_id]
            self.spill(object_id)


def shifted(point: Vec3, before: Vec3, now: Vec3) -> Vec3:
    """Return a point moved as far as something else has moved."""
    (x, y, z), (a, b, c), (d, e, f) = point, before, now
    return (x + (d - a), y + (e - b), z + (f - c))


def carried(
    belief: Belief,
    before: Callable[[str], Belief | None],
    seen: Mapping[str, SeenObject],
) -> Vec3:
    """Return where an object is by now: it has moved with the movable object that holds it."""

    def above(name: str) -> str | None:
        then = before(name)
        return then.place_id if then is not None else None

    for holder in holders(belief.place_id, above):
        if (sight := seen.get(holder)) is not None:
            if not sight.pickupable:
                break
            then = before(holder)
            at = belief.position_m, sight.position_m
            return shifted(at[0], then.position_m, at[1]) if then is not None else at[1]
    return belief.position_m


def known(sight: SeenObject) -> Known:
    """Return a sight as a belief about where the object is."""
    place = place_of(sight)
    return Known(
        object_id=sight.object_id,
        object_type=sight.object_type,
        position_m=sight.position_m,
        place_id=None if place == HAND else place,
    )


def means(name: str, sight: SeenObject) -> bool:
    """Return whether a name may mean this object: its id or type, or those of its whole."""
    object_id, kind = sight.object_id, sight.object_type
    return goes_by(name, object_id, kind) or (is_piece(kind) and is_part(object_id, name))


_SAME_PLACE_M = 0.3  # a memory this near to where an object was missed is the same, stale memory


@dataclass(eq=False, slots=True)
class Naming:
    """From names to objects: the log and memory asked in order.

    `before` is what was seen here earlier, by id; no other name means such an object.
    """

    _log: Sightings
    _knowledge: Knowledge
    _gap: Callable[[Vec3], float]
    _before: Mapping[str, SeenObject]

    def __contains__(self, object_id: object) -> bool:
        """Return whether the agent has seen an object, or remembers it."""
        return object_id in self._log.seen or self._knowledge.where(str(object_id)) is not None

    def find(self, name: str, *, state: str = "", held: bool = True) -> Known | None:
        """Return the object that a name means, or None if the agent knows of none.

        In this order: the id itself; what is held; what a skill last turned to, if in view; what
        memory knows; the nearest in view; the nearest seen before.

        `state` is preferred among several of a type in view; `held`: the object in the hand may be
        meant.
        """
        log = self._log
        held = held and log.held_id not in log.aside
        if held and log.held and means(name, log.held):
            return known(log.held)
        found = self._believed(name, held=held)
        if found is not None and found.object_id != name and state:
            sight = log.in_view.get(found.object_id)
            if sight is None or state not in log.states(sight):
                found = self._nearest(name, log.in_view, state=state) or found
        if found is None or found.object_id not in log.cut:
            return found
        parts = {k: v for k, v in log.seen.items() if is_part(k, found.object_id)}
        views = {k: v for k, v in parts.items() if k in log.in_view}
        whole = found.object_id
        return self._nearest(whole, views) or self._nearest(whole, parts) or found

    def _believed(self, name: str, *, held: bool) -> Known | None:
        log = self._log
        if name in log.seen and name not in log.missed and (held or name != log.held_id):
            return known(log.seen[name])
        last = log.focus.get(name, "")  # of several the one in use, wherever it is by now
        last = "" if last in log.aside else last
        focus = log.in_view.get(last)
        if focus and not focus.pickupable:
            return known(focus)
        there = last in log.handled_ids and last in log.seen and last not in log.missed
        if there and (held or last != log.held_id):
            return known(log.seen[last])
        found = self._knowledge.where(name)
        if found and self._credible(found) and (held or found.object_id != log.held_id):
            sight = log.seen.get(found.object_id)
            if sight and sight is not log.held:
                return known(sight)
            return replace(found, position_m=carried(found, self._knowledge.where, log.seen))
        found = self._nearest(name, log.in_view) or self._nearest(name, log.seen)
        if found is None and name in self._before and name not in log.missed:
            return known(self._before[name])
        return found

    def _credible(self, found: Known) -> bool:
        """Return whether a memory is not the one that was just found to be wrong."""
        missed = self._log.missed.get(found.object_id)
        is_stale = missed is not None and math.dist(missed, found.position_m) <= _SAME_PLACE_M
        return found.object_id not in self._log.aside and not is_stale

    def _nearest(
        self, name: str, sights: Mapping[str, SeenObject], *, state: str = ""
    ) -> Known | None:
        log = self._log
        out = {*log.missed, log.held_id, *log.aside}
        fitting = [
            (object_id in log.cut, self._gap(sight.box_center_m), object_id)
            for object_id, sight in sights.items()
            if object_id not in out and means(name, sight)
            if not state or state in log.states(sight)
        ]
        return known(sights[min(fitting)[2]]) if fitting else None
