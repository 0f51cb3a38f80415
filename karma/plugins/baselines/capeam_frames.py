"""CAPEAM's plan: sub-goal frames, read off a program, then the table.

A frame is a triplet (action, object, receptacle). The source predicts frames with trained
networks, in the context of the instruction; here a planner's program is read by rule, and the
objects of the frames are made to agree: what is washed, heated, cooled or put somewhere is what was
picked up before.
"""

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from typing import Literal

from karma.agent.planning.program import SWITCH_AFTER
from karma.household.ids import short_type
from karma.household.skill_effects import BeliefState, apply, unmet
from karma.household.types import object_types
from karma.household.uses import (
    BIN,
    FAUCET,
    FRIDGE,
    KNIFE,
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

    Its beliefs follow the frames by `karma.household.skill_effects`: what the hand holds, at first
    a type or "", and what stands open.
    """

    calls: Sequence[SkillCall]
    hand: InitVar[str] = ""
    frames: list[SubGoal] = field(default_factory=list)
    unsupported: list[SkillCall] = field(default_factory=list)  # what no frame says
    running: str = ""  # the appliance whose switching a frame has taken in
    resting: SubGoal | None = None  # a change that left its thing in the appliance
    beliefs: BeliefState = field(init=False)

    def __post_init__(self, hand: str) -> None:
        """Read all calls."""
        self.beliefs = BeliefState.holding(hand)
        for number, call in enumerate(self.calls):
            self._step(call, self.calls[number + 1 :])
        self._leave()

    @property
    def held(self) -> str:
        """The type of object in the hand; "" if it is empty."""
        return self.beliefs.held.name if self.beliefs.held else ""

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
                self.beliefs = apply(_of(call.skill, thing), self.beliefs)
            case skill if skill in SWITCH_AFTER:
                self._switch(thing, skill)
            case _:
                self.unsupported.append(call)

    def _frame(self, action: Action, thing: str, place: str = "") -> SubGoal:
        """Append a frame, and note what its pick-up or put does to the hand."""
        frame = SubGoal(action=action, thing=thing, place=place)
        self.frames.append(frame)
        if action == "Pickup":
            self.beliefs = apply(_of("PickupObject", thing), self.beliefs)
        elif place or action == "Put":
            self.beliefs = apply(_of("PutObject", thing, place), self.beliefs)
        return frame

    def _pick_up(self, thing: str) -> None:
        if self.resting is not None and self.resting.thing == thing:
            self.resting = None  # the change ends with the thing in the hand anyway
            self.beliefs = apply(_of("PickupObject", thing), self.beliefs)
            return
        self._leave()
        if self.held != thing:
            self._free()
            opened = [
                item.name for item, states in self.beliefs.states.items() if "opened" in states
            ]
            self._frame("Pickup", thing, opened[-1] if opened else "")

    def _put(self, thing: str, place: str, rest: Sequence[SkillCall]) -> None:
        self._leave()
        thing = self.held or thing  # one object through all frames of a chain
        frame = self._frame(self._change(thing, place, rest), thing, place)
        if frame.action != "Put":
            self.resting = frame
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
        if self.held:
            self._frame("Put", self.held)

    def _slice(self, thing: str) -> None:
        self._leave()
        if "knife" in unmet(_of("SliceObject", thing), self.beliefs):
            self._free()
            self._frame("Pickup", KNIFE)
        self._frame("Slice", thing)

    def _switch(self, thing: str, skill: str) -> None:
        if self.running and (thing == self.running or _APPLIANCES.get(thing, ("", ""))[1] == thing):
            return
        if self.running == FAUCET and thing == SINK:
            return
        self._leave()
        self._frame("ToggleOn" if SWITCH_AFTER[skill] == "on" else "ToggleOff", thing)

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
