"""Switching things on and off: which knob, tap or lamp is meant, and what came of it."""

import math
from typing import Literal

from karma.agent.body.reach import Reach
from karma.agent.body.refusals import RefusedError
from karma.agent.body.search import Search
from karma.agent.body.sightings import known
from karma.agent.planning.program import SKILL_OF
from karma.contracts import Known, SeenObject
from karma.household.ids import type_of
from karma.household.states import OPPOSITES
from karma.household.uses import BURNER, KNOB, STOVE, TAP_OF, TAPS

_ON, _OFF = SKILL_OF["ToggleOn"].action, SKILL_OF["ToggleOff"].action
_TAP_OVER_M = 1.0  # a tap this near to what was put down last is the one that is meant


class Switching:
    """The skills SwitchOn, SwitchOff, ToggleOn, ToggleOff."""

    def __init__(self, reach: Reach, search: Search) -> None:
        self._reach, self._log, self._walker = reach, reach.log, reach.walker
        self._search = search

    def toggle(self, name: str, word: Literal["on", "off"]) -> str:
        """Switch a thing, or what switches it, on or off; returns a remark.

        Raises:
            RefusedError: it is not known, not within reach, or the world refuses.
        """
        target = self._switch_of(name, word)
        self._reach.approach(target)
        sight = self._log.seen[target.object_id]
        if word in self._log.states(sight):
            if word == "off" or sight.object_type not in TAPS:
                return f"it is {word} already"
            self._reach.act(target, _OFF)  # and on again: what lies there gets water
        observation = self._reach.act(target, _ON if word == "on" else _OFF)
        if word == "on":
            self._log.switched(observation)
        return ""

    def _switch_of(self, name: str, word: Literal["on", "off"]) -> Known:
        """Return what has to be toggled: a stove's knob, a sink's tap, or the thing itself."""
        name = BURNER if name == STOVE else name
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

    def _tap_over_last(self, kind: str) -> Known | None:
        """Return the tap over what was put down last (a room may have several), or None.

        The believed one is taken if it is near enough; else the agent steps up and looks around.
        """
        last = next((self._log.seen.get(name) for name in reversed(self._log.handled)), None)
        if last is None:
            return None
        believed = self._reach.names.find(kind)
        if believed and math.dist(believed.position_m, last.box_center_m) <= _TAP_OVER_M:
            return believed
        near = self._nearest_tap(kind, last)
        if near is None:
            self._walker.walk_near(last.box_center_m)
            self._search.look_around()
            near = self._nearest_tap(kind, last)
        return near

    def _nearest_tap(self, kind: str, last: SeenObject) -> Known | None:
        taps = [
            (math.dist(sight.box_center_m, last.box_center_m), sight.object_id, sight)
            for sight in self._log.seen.values()
            if sight.object_type == kind
        ]
        gap, _, tap = min(taps, default=(math.inf, "", last))
        return known(tap, "seen") if gap <= _TAP_OVER_M else None

    def _knob(self, name: str, word: Literal["on", "off"]) -> Known:
        """Return the knob of a burner: the named one; else one that is on, or has a pan on it."""
        knobs = self._knobs()
        if not knobs:
            self._reach.approach(self._reach.names.find(KNOB) or self._reach.resolve(name))
            knobs = self._knobs()
        if knobs and name != type_of(name) and not any(name in knob.controls for knob in knobs):
            self._reach.approach(self._reach.resolve(name))
            self._search.look_around()
            knobs = [knob for knob in self._knobs() if name in knob.controls]
            if not knobs:
                raise RefusedError(f"its knob is not in sight: {name}")
        movable = (sight for sight in self._log.seen.values() if sight.pickupable)
        laden = {parent for sight in movable for parent in sight.parent_ids}

        def rank(knob: SeenObject) -> tuple[bool, bool, bool, float, str]:
            burners = knob.controls
            cold = word == "off" and "on" not in self._log.states(knob)
            gap = self._walker.gap(knob.position_m)
            return name not in burners, cold, not laden & set(burners), gap, knob.object_id

        return self._reach.resolve(min(knobs, key=rank).object_id if knobs else KNOB)

    def _knobs(self) -> list[SeenObject]:
        sights = self._log.seen.values()
        return [sight for sight in sights if sight.object_type == KNOB and sight.controls]
