"""CAPEAM's plan: sub-goal frames, read off a program, then the table.

A frame is a triplet (action, object, receptacle). The source predicts frames with trained
networks, in the context of the instruction; here a planner's program is read by rule, and the
objects of the frames are made to agree: what is washed, heated, cooled or put somewhere is what was
picked up before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from karma.agent.planning.program import SWITCH_AFTER
from karma.household.ids import short_type
from karma.household.types import object_types
from karma.household.uses import (
    BIN,
    FAUCET,
    FRIDGE,
    KNIFE,
    KNIVES,
    MICROWAVE,
    SINK,
    without_basin,
)
from karma.types.planning import SkillCall

Action = Literal["Pickup", "Put", "Clean", "Cool", "Heat", "Slice", "ToggleOn", "ToggleOff"]
_of = SkillCall.of
_APPLIANCES: dict[str, tuple[Action, str]] = {
    SINK: ("Clean", FAUCET), MICROWAVE: ("Heat", MICROWAVE),
}  # receptacle -> what it does, and what must be switched on for it  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class SubGoal:
    """One sub-goal frame of the source."""

    action: Action
    thing: str  # a type
    place: str = ""  # type of the receptacle; "" to be chosen when it is due


@dataclass(slots=True)
class ProgramReader:
    """Reads a program (of types or short names) call by call as frames.

    It tracks what is in the hand, at first a type or "", and what stands open.
    """

    calls: Sequence[SkillCall]
    hand: str = ""
    frames: list[SubGoal] = field(default_factory=list)
    unsupported: list[SkillCall] = field(default_factory=list)  # what no frame says
    open: str = ""  # what was opened last and not closed since
    running: str = ""  # the appliance whose switching a frame has taken in
    resting: SubGoal | None = None  # a change that left its thing in the appliance

    def __post_init__(self) -> None:
        """Read all calls."""
        for number, call in enumerate(self.calls):
            self._step(call, self.calls[number + 1 :])
        self._leave()

    def _step(self, call: SkillCall, rest: Sequence[SkillCall]) -> None:
        thing = _kind(call.objects[0])
        match call.skill:
            case "GoToObject" | "Explore":
                return
            case "PickupObject":
                self._pick_up(thing)
            case "PutObject" | "ThrowObject":
                tossed = call.skill == "ThrowObject"
                self._put(thing, BIN if tossed else _kind(call.objects[-1]), rest)
            case "SliceObject":
                self._slice(thing)
            case "OpenObject" | "CloseObject":
                if not self._wraps(thing):
                    self.unsupported.append(call)
                self.open = thing if call.skill == "OpenObject" else ""
            case skill if skill in SWITCH_AFTER:
                self._switch(thing, skill)
            case _:
                self.unsupported.append(call)

    def _pick_up(self, thing: str) -> None:
        rests = self.resting
        if rests is not None and rests.thing == thing:
            self.resting = None  # the change ends with the thing in the hand anyway
        else:
            self._leave()
            if self.hand == thing:
                return
            self._free()
            self.frames.append(SubGoal(action="Pickup", thing=thing, place=self.open))
        self.hand = thing

    def _put(self, thing: str, place: str, rest: Sequence[SkillCall]) -> None:
        self._leave()
        thing = self.hand or thing  # one object through all frames of a chain
        action = self._change(thing, place, rest)
        self.frames.append(SubGoal(action=action, thing=thing, place=place))
        self.hand = ""
        if action != "Put":
            self.resting = self.frames[-1]
            self.running = _APPLIANCES[place][1] if place in _APPLIANCES else ""

    def _change(self, thing: str, place: str, rest: Sequence[SkillCall]) -> Action:
        """Return the action that a put is part of: a change by an appliance, or the put alone."""
        if place == FRIDGE:
            again = any(c.skill == "PickupObject" and _kind(c.objects[0]) == thing for c in rest)
            return "Cool" if again else "Put"
        action, switch = _APPLIANCES.get(place, ("Put", ""))
        for call in rest:
            if call.skill in ("PickupObject", "PutObject"):
                break
            if SWITCH_AFTER.get(call.skill) == "on" and _kind(call.objects[0]) in (switch, place):
                return action
        return "Put"

    def _leave(self) -> None:
        """Append a put where the program leaves a changed thing in its appliance."""
        if self.resting is not None:
            self.frames.append(
                SubGoal(action="Put", thing=self.resting.thing, place=self.resting.place)
            )
        self.resting, self.running = None, ""

    def _free(self) -> None:
        if self.hand:
            self.frames.append(SubGoal(action="Put", thing=self.hand))
            self.hand = ""

    def _slice(self, thing: str) -> None:
        self._leave()
        if self.hand not in KNIVES:
            self._free()
            self.frames.append(SubGoal(action="Pickup", thing=KNIFE))
            self.hand = KNIFE
        self.frames.append(SubGoal(action="Slice", thing=thing))

    def _switch(self, thing: str, skill: str) -> None:
        if self.running and (thing == self.running or _APPLIANCES.get(thing, ("", ""))[1] == thing):
            return
        if self.running == FAUCET and thing == SINK:
            return
        self._leave()
        action: Action = "ToggleOn" if SWITCH_AFTER[skill] == "on" else "ToggleOff"
        self.frames.append(SubGoal(action=action, thing=thing))

    def _wraps(self, place: str) -> bool:
        """Return whether opening and closing this is part of putting in or taking out."""
        inside = False
        for call in self.calls:
            if call.skill == "PutObject" and _kind(call.objects[-1]) == place:
                return True
            if call.skill == "PickupObject" and inside:
                return True
            if call.skill in ("OpenObject", "CloseObject") and _kind(call.objects[0]) == place:
                inside = call.skill == "OpenObject"
        return False


# ----------------------------------------------------------------- the table


def expand(frame: SubGoal, *, shut_in: str = "") -> tuple[SkillCall, ...]:
    """Return the actions of a frame, by the table of the source.

    They name types, which are bound to objects when each is due.

    `shut_in`: type of the closed receptacle that the thing is in, "" if it lies open.
    """
    thing, place = frame.thing, frame.place
    take = _of("PickupObject", thing)
    match frame.action:
        case "Pickup":
            return _wrapped(shut_in, take)
        case "Slice":
            return _wrapped(shut_in, _of("SliceObject", thing))
        case "Put":
            kind = object_types().get(place)
            box = place if kind is not None and kind.must_be_open else ""
            return _wrapped(box, _of("PutObject", thing, place))
        case "Clean":
            run = _of("ToggleOn", FAUCET), _of("ToggleOff", FAUCET)
            return (_of("PutObject", thing, SINK), *run, take)
        case "Cool":
            put = _of("PutObject", thing, FRIDGE)
            return (*_wrapped(FRIDGE, put), *_wrapped(FRIDGE, take))
        case "Heat":
            put, oven = _of("PutObject", thing, MICROWAVE), MICROWAVE
            run = _of("ToggleOn", oven), _of("ToggleOff", oven)
            return (*_wrapped(oven, put), *run, *_wrapped(oven, take))
        case _:
            return (_of(frame.action, thing),)


def _wrapped(box: str, step: SkillCall) -> tuple[SkillCall, ...]:
    return (_of("OpenObject", box), step, _of("CloseObject", box)) if box else (step,)


def _kind(name: str) -> str:
    """Return the type of a short name; a basin becomes the furniture that it is part of."""
    return without_basin(short_type(name))
