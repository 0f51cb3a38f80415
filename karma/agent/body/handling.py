"""What the hand does: pick up, put down, throw, pour out, slice, open, close, break, switch."""

import math
from contextlib import suppress

from karma.agent.body.reach import Reach
from karma.agent.body.refusals import RefusedError, hand_full, put_refused
from karma.agent.body.search import Search
from karma.agent.body.sightings import known, means
from karma.agent.body.walk import Stance
from karma.agent.planning.program import CHANGES, DOOR_AFTER, SKILL_OF, SWITCH_AFTER
from karma.agent.seeing.eyes import SWITCH_M, nearest
from karma.household.containment import goes_in
from karma.household.ids import part_id, root_id, type_of
from karma.household.pieces import is_piece
from karma.household.places import NEAR_M
from karma.household.saying import preposition
from karma.household.states import OPPOSITES
from karma.household.types import types_with
from karma.household.uses import BASIN_OF, BURNER, KNOB, STOVE, TAP_OF, TAPS
from karma.types.memory import Known
from karma.types.observation import SeenObject
from karma.types.space import outside_m

THROW_FORCE = 100.0  # AI2-THOR's moveMagnitude
_OTHER_RECEPTACLES = 3  # tried when the one that was meant is full


class Handling:
    """Skills of the hand; each returns a remark, and raises `RefusedError` with its reason."""

    def __init__(self, reach: Reach) -> None:
        self._reach, self._log, self._walker = reach, reach.log, reach.walker

    def pick_up(self, name: str) -> str:
        """Take a thing into the empty hand."""
        held = self._log.held
        if held is None:
            self._reach.act(self._reach.resolve(name), "PickupObject")
            return ""
        if means(name, held):
            return "it is in the hand already"
        kind = held.object_type
        raise RefusedError(
            f"the hand holds {kind}; put it down first, "
            f"e.g. PutObject(robot, '{kind}', 'CounterTop')",
            hand_full(held, self._reach.known_types()),
        )

    def put(self, thing: str | None, name: str, *, exact: bool = False) -> str:
        """Put what is held, which must be `thing` if that is given, into or onto a receptacle.

        A full receptacle gives way to another of its type, unless it is `exact`, or a movable
        object that was named by its id.
        """
        held, log = self._held(thing), self._log
        target = self._reach.resolve(name, state="opened", held=False)
        kind = target.object_type
        may_change = not exact and (name == kind or kind not in types_with("pickupable"))
        try:
            self._put_into(held, target)
        except RefusedError as refusal:
            if refusal.is_for("full") and may_change:
                others = [one.object_id for one in self._reach.others(target)]
                seen = [log.seen[other] for other in others if other in log.seen]
                standing_open = [sight for sight in seen if "closed" not in log.states(sight)]
                for sight in standing_open[:_OTHER_RECEPTACLES]:
                    with suppress(RefusedError):
                        self._put_into(held, known(sight))
                        return f"the nearest {kind} is full, another one was taken"
            types = self._reach.known_types()
            detail = put_refused(refusal, held, target, self._reach.others(target), log, types)
            raise RefusedError(str(refusal), detail or refusal.detail, refusal.why) from None
        return ""

    def put_near(self, thing: str, name: str) -> str:
        """Put what is held near another thing, or near a place "(x, y, z)" in metres.

        It goes on what that lies on, or on what is nearest to it; where it comes to lie too far
        away it is taken up again, and put down from elsewhere.
        """
        held = self._held(thing)
        other = self._spot(name)
        tried: list[Stance] = []
        while len(tried) < self._reach.limits.views:
            if not self._reach.next_stance(other, tried, nearest=True):
                break
            for place in self._under(other, held):
                with suppress(RefusedError):
                    self._reach.act(place, "PutObject", also=held.object_id, from_here=True)
                    lies = self._log.seen[held.object_id]
                    if math.dist(lies.position_m, other.position_m) <= NEAR_M:
                        return ""
                    self._reach.act(known(lies), "PickupObject")
        raise RefusedError(f"there is no room for {held.object_type} near {name}")

    def _spot(self, name: str) -> Known:
        """Return what an object is to be near, an object or a place; refuses what is neither."""
        if not name.startswith("("):
            other = self._reach.resolve(name, held=False)
            self._reach.approach(other)
            return other
        try:
            x, y, z = (float(part) for part in name.strip("() ").split(","))
        except ValueError:
            raise RefusedError(f"{name} is no place (x, y, z) in metres") from None
        return Known(object_id=name, object_type=name, position_m=(x, y, z))

    def _under(self, other: Known, held: SeenObject) -> list[Known]:
        """Return the receptacles within reach that may take an object near another.

        First the receptacle that the other lies on, then the nearest to it.
        """
        on = self._log.seen.get(other.object_id)
        ranked = []
        for name, sight in self._log.in_view.items():
            gap = math.hypot(*outside_m(other.position_m, sight.box_center_m, sight.box_size_m))
            takes = gap <= NEAR_M and goes_in(held.object_type, sight.object_type)
            inside = root_id(name) == root_id(other.object_id)
            inside = inside and preposition(sight.object_type) == "in"  # beside a sink, not in it
            if takes and not inside and name in self._log.within_reach:
                ranked.append((on is None or name not in on.parent_ids, gap, name))
        return [known(self._log.in_view[name]) for _, _, name in sorted(ranked)]

    def throw(self, name: str) -> str:
        """Throw away what is held."""
        held = self._held(name)
        event = self._walker.do("ThrowObject", moveMagnitude=THROW_FORCE)
        self._log.spill(held.object_id)
        self._reach.done(known(held), event, [held.object_id])
        return ""

    def empty(self, name: str) -> str:
        """Pour out what a vessel holds; one that is empty is left as it is."""
        target = self._reach.resolve(name)
        try:
            self._reach.act(target, SKILL_OF["EmptyObject"].action)
        except RefusedError as refusal:
            if not refusal.is_for("empty"):
                raise
            return "it is empty already"
        self._log.emptied |= {target.object_id}
        return ""

    def act(self, skill: str, name: str) -> str:
        """Do one action on an object: open, close, break, slice."""
        target = self._reach.resolve(name, state=OPPOSITES.get(DOOR_AFTER.get(skill, ""), ""))
        if skill == "SliceObject" and is_piece(target.object_type):
            self._reach.use(target)
            return "it is sliced already"
        self._reach.approach(target)
        sight = self._log.seen[target.object_id]
        if skill == "CloseObject" and "closed" in self._log.states(sight):
            return "it is closed already"
        observation = self._reach.act(target, skill)
        if skill in CHANGES:
            self._log.gain(target.object_id, CHANGES[skill])
        if skill == "SliceObject":
            self._log.slice(target.object_id, observation.pieces)
        return ""

    def _held(self, name: str | None) -> SeenObject:
        """Return what is held; refuse when that is nothing, or not what the name means."""
        held = self._log.held
        if held is None:
            raise RefusedError(f"the hand is empty; PickupObject(robot, '{name or '...'}') first")
        if name is not None and not means(name, held):
            put_down = hand_full(held, self._reach.known_types())
            raise RefusedError(
                f"the hand holds {held.object_type}, not {name}",
                f"{put_down}, then PickupObject(robot, '{name}')",
            )
        return held

    def _put_into(self, held: SeenObject, target: Known) -> None:
        """Put down where the basin, if the target has one, has come into view."""
        self._reach.approach(self._basin(target, held) or target)
        tried = [self._walker.stance()]
        while (place := self._basin(target, held)) is None:
            if len(tried) > self._reach.limits.views or not self._reach.next_stance(target, tried):
                place = target
                break
        self._reach.act(place, "PutObject", also=held.object_id)

    def _basin(self, target: Known, held: SeenObject) -> Known | None:
        """Return where things are put: a sink's basin, None while it is not known."""
        basin = BASIN_OF.get(target.object_type)
        kind = held.object_type
        if basin and not goes_in(kind, basin) and goes_in(kind, target.object_type):
            return target  # a plunger stands in a bathtub, says the table, and not in its basin
        return self._reach.names.find(part_id(target.object_id, basin)) if basin else target

    # ------------------------------------------------------------- switches

    def toggle(self, skill: str, name: str) -> str:
        """Switch an object, or what switches it, on or off; returns a remark, or refuses."""
        name, word = BURNER if name == STOVE else name, SWITCH_AFTER[skill]
        target = self._switch(name, word)
        self._reach.approach(target)
        sight = self._log.seen[target.object_id]
        if word in self._log.states(sight):
            if word == "off" or sight.object_type not in TAPS:
                return f"it is {word} already"
            self._reach.act(target, SKILL_OF["ToggleOff"].action)  # water runs when it is put on
        self._reach.act(target, SKILL_OF[skill].action)
        return ""

    def _switch(self, name: str, word: str) -> Known:
        """Return what has to be toggled: a stove's knob, a sink's tap, or the object itself."""
        kind, before = type_of(name), OPPOSITES[word]
        if kind == BURNER or name == KNOB:
            return self._knob(name, word)
        if kind in TAP_OF:
            if name != kind:
                self._reach.approach(self._reach.resolve(name))  # its own tap is nearest then
            return self._reach.resolve(TAP_OF[kind], state=before)
        if name in TAPS and (tap := self._tap_over_last(name)) is not None:
            return tap
        return self._reach.resolve(name, state=before)

    def _tap_over_last(self, name: str) -> Known | None:
        """Return the tap over what was put down last (a room may have several), or None.

        The believed tap is taken if it is near enough; else the agent steps up and looks around.
        """
        seen = self._log.seen
        last = next((seen.get(name) for name in reversed(self._log.handled_ids)), None)
        if last is None:
            return None
        believed = self._reach.names.find(name)
        if believed and math.dist(believed.position_m, last.box_center_m) <= SWITCH_M:
            return believed
        near = nearest(last, name, seen.values())
        if near is None:
            self._walker.walk_near(last.box_center_m)
            Search(self._reach).look_around()
            near = nearest(last, name, seen.values())
        return known(near) if near is not None else None

    def _knob(self, name: str, word: str) -> Known:
        """Return the knob of a burner: the named one; else one that is on, or has a pan on it."""

        def knobs() -> list[SeenObject]:
            sights = self._log.seen.values()
            return [sight for sight in sights if sight.object_type == KNOB and sight.controls]

        found = knobs()
        if not found:
            self._reach.approach(self._reach.names.find(KNOB) or self._reach.resolve(name))
            found = knobs()
        if found and name != type_of(name) and not any(name in knob.controls for knob in found):
            self._reach.approach(self._reach.resolve(name))
            Search(self._reach).look_around()
            found = [knob for knob in knobs() if name in knob.controls]
            if not found:
                raise RefusedError(f"its knob is not in sight: {name}")
        movable = (sight for sight in self._log.seen.values() if sight.pickupable)
        laden = {parent for sight in movable for parent in sight.parent_ids}
        ranked = [
            (
                name not in knob.controls,
                word == "off" and "on" not in self._log.states(knob),
                laden.isdisjoint(knob.controls),
                self._walker.gap(knob.position_m),
                knob.object_id,
            )
            for knob in found
        ]
        return self._reach.resolve(min(ranked)[-1] if ranked else KNOB)
