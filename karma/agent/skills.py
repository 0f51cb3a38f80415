"""The 13 skills of KARMA's Listing 2, carried out with AI2-THOR's actions.

A skill acts on what the agent believes (its memory, and what it has seen since it began); when a
belief proves wrong it says so. A refusal is a value whose reason a planner can act on. `walk` moves
the body, `sightings` keeps the log and knows what a name means, `reach` brings a thing within reach
and acts on it, `search` looks for things.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Literal

from karma.agent.program import SKILLS
from karma.agent.reach import Limits, Reach, RefusedError
from karma.agent.search import look_around, look_from, look_into, search
from karma.agent.sightings import known, means
from karma.agent.walk import OutOfActionsError
from karma.contracts import (
    Area,
    Knowledge,
    Known,
    Observation,
    SeenObject,
    SkillCall,
    SkillResult,
    World,
)
from karma.household.ids import part_id, type_of
from karma.household.pieces import is_piece
from karma.household.states import DOOR_AFTER, OPPOSITES
from karma.household.uses import BASIN_OF, BURNER, KNOB, STOVE, TAP_OF, TAPS

THROW_FORCE = 100.0  # AI2-THOR's moveMagnitude
_OTHER_RECEPTACLES = 3  # tried when the one that was meant is full
_SHUT_IN = "it is in a closed container; open that first"
_TAP_OVER_M = 1.0  # a tap this near to what was put down last is the one that is meant
_ARITY = {s.name: (len(s.arguments) - s.optional, s.arguments) for s in SKILLS}


class Skills:
    """Runs skill calls in a world and keeps the log that the agent's memory is fed from.

    Args:
        world: a world that has been reset.
        knowledge: the agent's memory.
        limits: how hard a skill tries.
    """

    def __init__(self, world: World, knowledge: Knowledge, *, limits: Limits | None = None) -> None:
        self.actions = 0  # world actions so far
        self.explorations = 0  # area nodes visited and containers opened so far
        self._reach = Reach(world, knowledge, limits or Limits())

    @property
    def seen(self) -> dict[str, SeenObject]:
        """The latest sight of everything that was in view at a look or an interaction."""
        return self._reach.log.seen

    @property
    def views(self) -> dict[str, Observation]:
        """The observation in whose picture each id was last in view or in the hand."""
        return self._reach.log.views

    @property
    def handled(self) -> list[str]:
        """Ids of what was manipulated or put into, in order, with repeats."""
        return self._reach.log.handled

    @property
    def effects(self) -> dict[str, list[str]]:
        """Lasting state words that the agent brought about, by id."""
        return self._reach.log.effects

    @property
    def held(self) -> SeenObject | None:
        """What was in the hand at the last look."""
        return self._reach.log.held

    @property
    def missed(self) -> frozenset[str]:
        """Ids of what was not where memory had it."""
        return frozenset(self._reach.log.missed)

    @property
    def cut(self) -> frozenset[str]:
        """Ids of wholes that were seen sliced, and are no more."""
        return frozenset(self._reach.log.cut)

    def look(self) -> None:
        """Take note of what is in view now; every skill does so too."""
        self._reach.look()

    def look_around(self) -> None:
        """Turn round once, looking down at tables and straight ahead, and take note."""
        self._reach.walker.start()
        look_around(self._reach)
        self.actions += self._reach.walker.actions

    def look_from(self, name: str, area: Area, *, max_actions: int | None = None) -> SkillResult:
        """Walk near one place and look around for a thing; ok if it is in view then.

        Args:
            name: what is looked for; "" only looks.
            area: the place.
            max_actions: for the way and the look; None for the limits' own.
        """
        explore = SkillCall(skill="Explore", objects=(name,), positions=(area.name,))
        call = explore if name else SkillCall(skill="GoToObject", objects=(area.name,))

        def look() -> str:
            found = look_from(self._reach, name, area.position_m)
            return _take_note(self._reach, name, found)

        return self._counted(call, look, max_actions)

    def look_into(
        self, name: str, container: SeenObject, *, max_actions: int | None = None
    ) -> SkillResult:
        """Open a closed container and look; it is closed again if the thing is not there.

        Args:
            name: what is looked for; "" only looks.
            container: as it was seen.
            max_actions: for all of it; None for the limits' own.
        """
        explore = SkillCall(skill="Explore", objects=(name,), positions=(container.object_id,))
        call = explore if name else SkillCall(skill="GoToObject", objects=(container.object_id,))

        def look() -> str:
            return _take_note(self._reach, name, look_into(self._reach, name, container))

        return self._counted(call, look, max_actions)

    def run(self, call: SkillCall, *, max_actions: int | None = None) -> SkillResult:
        """Carry out one skill call.

        Args:
            call: what to do.
            max_actions: how many world actions it may take; None for the limits' own.

        Returns:
            ok, or a refusal with its reason; what the names resolved to; what it cost.

        Raises:
            ValueError: no such skill, or a wrong number of objects.
        """
        _check(call)
        return self._counted(call, lambda: _carry_out(call, self._reach), max_actions)

    def _counted(
        self, call: SkillCall, do: Callable[[], str], max_actions: int | None
    ) -> SkillResult:
        """Do something and say what it cost; a refusal becomes a result."""
        reach = self._reach
        most = reach.limits.max_actions
        reach.walker.max_actions = most if max_actions is None else min(max_actions, most)
        try:
            reach.start()
            ok, reason = True, do()
        except RefusedError as refusal:
            ok, reason = False, str(refusal)
        except OutOfActionsError:
            reach.look()
            spent = f"gave up after {reach.walker.actions} actions"
            ok, reason = False, f"{spent} on {call.objects[-1]}"
        self.actions += reach.walker.actions
        self.explorations += reach.explorations
        return SkillResult(
            call=call,
            ok=ok,
            reason=reason,
            actions=reach.walker.actions,
            explorations=reach.explorations,
            object_ids=tuple(dict.fromkeys(reach.used)),
        )


def _take_note(reach: Reach, name: str, found: Known | None) -> str:
    """Keep what a search found, and not the places searched on the way."""
    if name and found is None:
        raise RefusedError(f"no {name} there")
    reach.used = []
    if found is not None:
        reach.use(found)
    return ""


def _check(call: SkillCall) -> None:
    if call.skill not in _ARITY:
        raise ValueError(f"no skill named {call.skill!r}")
    least, kinds = _ARITY[call.skill]
    most = kinds.count("object")
    if not min(least, most) <= len(call.objects) <= most:
        raise ValueError(f"{call.skill} takes {most} object(s): {call}")
    if call.positions and "positions" not in kinds:
        raise ValueError(f"{call.skill} takes no positions: {call}")


def _carry_out(call: SkillCall, reach: Reach) -> str:
    """Do one skill; returns a remark, raises RefusedError."""
    name = call.objects[-1]
    match call.skill:
        case "GoToObject":
            return _go_to(reach, name)
        case "PickupObject":
            return _pick_up(reach, name)
        case "PutObject":
            return _put(reach, call.objects[:-1], name)
        case "SwitchOn" | "ToggleOn":
            return _toggle(reach, name, "on")
        case "SwitchOff" | "ToggleOff":
            return _toggle(reach, name, "off")
        case "SliceObject":
            return _slice(reach, name)
        case "ThrowObject":
            return _throw(reach, name)
        case "Explore":
            return _explore(reach, name, call)
        case _:
            return _simple(reach, call.skill, name)


def _go_to(reach: Reach, name: str) -> str:
    for area in reach.knowledge.areas():
        if area.name == name:
            reach.walker.walk_near(area.position_m)
            reach.look()
            return ""
    return "" if reach.approach(reach.resolve(name), closed_will_do=True) else _SHUT_IN


def _pick_up(reach: Reach, name: str) -> str:
    held = reach.log.held
    if held is None:
        reach.act(reach.resolve(name), "PickupObject")
        return ""
    if means(name, held):
        return "it is in the hand already"
    kind = held.object_type
    raise RefusedError(
        f"the hand holds {kind}; put it down first, e.g. PutObject(robot, '{kind}', 'CounterTop')"
    )


def _held(reach: Reach, name: str | None) -> SeenObject:
    """Return what is held; refuse when that is nothing, or not what the name means."""
    held = reach.log.held
    if held is None:
        raise RefusedError(f"the hand is empty; PickupObject(robot, '{name or '...'}') first")
    if name is not None and not means(name, held):
        raise RefusedError(f"the hand holds {held.object_type}, not {name}")
    return held


def _put(reach: Reach, first: tuple[str, ...], name: str) -> str:
    held = _held(reach, first[0] if first else None)
    target = reach.resolve(name, state="opened", held=False)
    try:
        _put_into(reach, held, target)
    except RefusedError as refusal:
        others = reach.log.others(target, reach.walker.gap)[:_OTHER_RECEPTACLES]
        if "No valid position" not in str(refusal) or name != target.object_type:
            raise
        for other in others:  # one that is full may stand beside another of its type
            with suppress(RefusedError):
                _put_into(reach, held, other)
                return f"the nearest {name} is full, another one was taken"
        raise
    return ""


def _put_into(reach: Reach, held: SeenObject, target: Known) -> None:
    reach.approach(_basin(reach, target) or target)
    tried = [reach.walker.here()]
    while (place := _basin(reach, target)) is None:
        if len(tried) > reach.limits.views or not reach.next_view(target, tried):
            place = target
            break
    reach.act(place, "PutObject", also=held.object_id)


def _basin(reach: Reach, target: Known) -> Known | None:
    """Return where things are put: the basin of a sink or bathtub, None if it is not known yet."""
    basin = BASIN_OF.get(target.object_type)
    return reach.find(part_id(target.object_id, basin)) if basin else target


def _throw(reach: Reach, name: str) -> str:
    held = _held(reach, name)
    event = reach.walker.do("ThrowObject", moveMagnitude=THROW_FORCE)
    reach.done(known(held, "held"), event)
    return ""


def _simple(reach: Reach, skill: str, name: str) -> str:
    wanted = OPPOSITES.get(DOOR_AFTER.get(skill, ""), "")
    target = reach.resolve(name, state=wanted)
    reach.approach(target)
    if skill == "CloseObject" and "closed" in reach.log.seen[target.object_id].states:
        return "it is closed already"
    reach.act(target, skill)
    return ""


def _slice(reach: Reach, name: str) -> str:
    target = reach.resolve(name)
    if is_piece(target.object_type):
        reach.use(target)
        return "it is sliced already"
    reach.log.sliced(target.object_id, reach.act(target, "SliceObject"))
    return ""


def _toggle(reach: Reach, name: str, word: Literal["on", "off"]) -> str:
    target = _switch_of(reach, name, word)
    reach.approach(target)
    sight = reach.log.seen[target.object_id]
    if word in sight.states:
        if word == "off" or sight.object_type not in TAPS:
            return f"it is {word} already"
        reach.act(target, "ToggleObjectOff")  # off and on again: what lies there gets water
    observation = reach.act(target, "ToggleObjectOn" if word == "on" else "ToggleObjectOff")
    if word == "on":
        reach.log.switched(observation)
    return ""


def _switch_of(reach: Reach, name: str, word: Literal["on", "off"]) -> Known:
    """Return what has to be toggled: a stove's knob, a sink's tap, or the thing itself."""
    name = BURNER if name == STOVE else name
    kind, before = type_of(name), OPPOSITES[word]
    if kind == BURNER or name == KNOB:
        return _knob(reach, name, word)
    if kind in TAP_OF:
        if name != kind:
            reach.approach(reach.resolve(name))  # its own tap is the nearest one then
        return reach.resolve(TAP_OF[kind], state=before)
    if name in TAPS and (tap := _tap_over_last(reach, name)) is not None:
        return tap
    return reach.resolve(name, state=before)


def _tap_over_last(reach: Reach, kind: str) -> Known | None:
    """Return the tap over what was put down last (a room may have several), or None.

    The believed one is taken if it is near enough; else the agent steps up and looks around.
    """
    last = next((reach.log.seen.get(name) for name in reversed(reach.log.handled)), None)
    if last is None:
        return None
    believed = reach.find(kind)
    if believed and math.dist(believed.position_m, last.box_center_m) <= _TAP_OVER_M:
        return believed
    near = _nearest_tap(reach, kind, last)
    if near is None:
        reach.walker.walk_near(last.box_center_m)
        look_around(reach)
        near = _nearest_tap(reach, kind, last)
    return near


def _nearest_tap(reach: Reach, kind: str, last: SeenObject) -> Known | None:
    taps = [
        (math.dist(sight.box_center_m, last.box_center_m), sight.object_id, sight)
        for sight in reach.log.seen.values()
        if sight.object_type == kind
    ]
    gap, _, tap = min(taps, default=(math.inf, "", last))
    return known(tap, "seen") if gap <= _TAP_OVER_M else None


def _knob(reach: Reach, name: str, word: Literal["on", "off"]) -> Known:
    """Return the knob of a burner: the named one; else one that is on, or has a pan on it."""
    knobs = _knobs(reach)
    if not knobs:
        reach.approach(reach.find(KNOB) or reach.resolve(name))
        knobs = _knobs(reach)
    laden = {p for sight in reach.log.seen.values() if sight.pickupable for p in sight.parent_ids}

    def rank(knob: SeenObject) -> tuple[bool, bool, bool, float, str]:
        burners = knob.controls
        cold = word == "off" and "on" not in knob.states
        gap = reach.walker.gap(knob.position_m)
        return name not in burners, cold, not laden & set(burners), gap, knob.object_id

    return reach.resolve(min(knobs, key=rank).object_id if knobs else KNOB)


def _knobs(reach: Reach) -> list[SeenObject]:
    sights = reach.log.seen.values()
    return [sight for sight in sights if sight.object_type == KNOB and sight.controls]


def _open_round(reach: Reach, target: Known) -> None:
    """Open the closed container that a thing is remembered in, and look for it there."""
    place = reach.shut_in(target)
    if place is not None:
        reach.act(known(place, "seen"), "OpenObject")
        reach.explorations += 1
    reach.approach(target)


def _explore(reach: Reach, name: str, call: SkillCall) -> str:
    passed: set[str] = set()  # a memory that proves wrong gives way to the next one
    while (target := reach.find(name)) is not None and target.object_id not in passed:
        passed.add(target.object_id)
        try:
            if not reach.approach(target, closed_will_do=True):
                _open_round(reach, target)
            return ""
        except RefusedError:
            continue
    found = search(reach, name, call.positions)
    reach.used = []  # not the places searched on the way
    reach.use(found)
    return ""
