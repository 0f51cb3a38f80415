"""The paper's symbolic goals (KARMA §4.1, Table 3), and whether a world's events have met them.

A name in a goal is an AI2-THOR object type, an object id, or several of either with `/` between
them ("any of these"). A type also means its slices and its basin: `Apple` covers AppleSliced, `Egg`
EggCracked, `Sink` SinkBasin, `Bathtub` BathtubBasin; an id covers what was cut from that object.
A goal is existential, but all goals of one sub-task that mention the same name must hold of ONE
object: INSIDE(Apple, Sink) and STATE(Apple, clean) ask for the same apple. A whole that was cut
has been replaced by its slices; any one slice may stand for it.

A goal may count: 2*ON(Pen, Desk) asks for two different pens on ONE desk. Then as many objects are
chosen for the name as its highest count says, and a goal with a lower count, or none, asks it of so
many of the chosen: with ON(Pen, Box) one of these two pens is to be in a box as well.

ON and INSIDE are the same: the object lies in the receptacle, be it in another that can be carried
(in a bowl in the fridge). ON a place "(x, y, z)", or ON what holds nothing, is to lie within
`NEAR_M` of it: the authors' "near".
"""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple, Protocol, Self

from karma.agent.seeing.perceive import truth_of
from karma.errors import KarmaError
from karma.goals.objects import (
    DEEDS,
    TEMPERATURES,
    ObjectIndex,
    RememberedDeeds,
    fewest_missed,
    linked,
    suited,
)
from karma.household.ids import is_position
from karma.household.pieces import EGG, is_piece, piece_type
from karma.household.places import NEAR_M
from karma.household.states import END_STATES, GOAL_STATES, canonical_state
from karma.household.uses import MOMENTARY
from karma.types.observation import TrueObject, Truth
from karma.types.roles import Event, World
from karma.types.tasks import Goal, SubTask

ARITY = {
    "ON": 2, "INSIDE": 2, "STATE": 2, "HOLDON": 2, "TOGGLEON": 1, "TOGGLEOFF": 1, "OPEN": 1,
    "CLOSED": 1,
}  # fmt: skip
_SAME_PREDICATE = {
    "SWITCHON": "TOGGLEON", "SWITCHOFF": "TOGGLEOFF", "IN": "INSIDE", "CLOSE": "CLOSED",
}  # fmt: skip
MOST = 20  # that a goal may count
_FORM = re.compile(
    r"\s*(?:(?P<count>[0-9]{1,9})\s*\*\s*)?(?P<word>[A-Za-z]+)\s*\((?P<arguments>.*)\)\s*(?::\s*1)?\s*",
    re.DOTALL,
)
Fact = tuple[Goal, tuple[str, ...]]  # a goal and the ids of the things that it holds of


# ----------------------------------------------------------------- reading


def read_goal(text: str) -> Goal:
    """Return the predicate and arguments as written: predicate canonical, names unchecked.

    Raises:
        KarmaError: it is not of the form PREDICATE(argument, ...) with an optional ": 1" behind and
            an optional count before it, as in "2*ON(Pen, Desk)".
    """
    match = _FORM.fullmatch(text)
    if match is None:
        raise KarmaError(f"goal {text!r} is not of the form PREDICATE(argument, ...)")
    word = match["word"].upper()
    arguments = (part.strip() for part in re.split(r",(?![^(]*\))", match["arguments"]))
    count = int(match["count"] or 1)
    if not 1 <= count <= MOST:
        raise KarmaError(f"goal {text!r}: the count is {count}; it may be 1 to {MOST}")
    return Goal(predicate=_SAME_PREDICATE.get(word, word), arguments=tuple(arguments), count=count)


def parse_goal(text: str) -> Goal:
    """Return a goal in the paper's notation, e.g. "INSIDE(Apple, Fridge): 1", "2*ON(Pen, Desk)".

    Predicates are case-insensitive; SWITCHON is TOGGLEON; a STATE word becomes its canonical form.

    Raises:
        KarmaError: unknown predicate or state word, or the wrong number of arguments.
    """
    goal = read_goal(text)
    wanted = ARITY.get(goal.predicate)
    if wanted is None:
        raise KarmaError(f"goal {text!r}: unknown predicate; known are {', '.join(ARITY)}")
    if len(goal.arguments) != wanted or not all(goal.arguments):
        raise KarmaError(f"goal {text!r}: {goal.predicate} takes {wanted} argument(s)")
    if goal.predicate == "HOLDON" and goal.arguments[0].lower() not in ("robot", "agent"):
        raise KarmaError(f"goal {text!r}: HOLDON takes robot and an object")
    if goal.predicate == "HOLDON" and goal.count > 1:
        raise KarmaError(f"goal {text!r}: the robot holds one thing at a time")
    if goal.predicate != "STATE":
        return goal
    word = canonical_state(goal.arguments[1])
    if word is None:
        known = ", ".join(sorted(GOAL_STATES))
        raise KarmaError(f"goal {text!r}: unknown state; known are {known}")
    return replace(goal, arguments=(goal.arguments[0], word))


def object_names(goal: Goal) -> tuple[str, ...]:
    """Return the arguments that name objects, in order: no robot, state word or coordinates."""
    arguments = goal.arguments
    if goal.predicate == "HOLDON":
        return arguments[1:]
    if goal.predicate == "STATE" or is_position(arguments[-1]):
        return arguments[:1]
    return arguments


def alternatives(name: str) -> tuple[str, ...]:
    """Return the types or ids that a name allows, most likely first."""
    return tuple(part.strip() for part in name.split("/"))


def _names_of(goals: Sequence[Goal]) -> dict[Goal, tuple[str, ...]]:
    return {goal: object_names(goal) for goal in goals}


# ----------------------------------------------------------------- watching


class Progress(NamedTuple):
    """How many of a sub-task's conditions are met."""

    met: int
    of: int


class Meanings(NamedTuple):
    """One moment of a world: what names mean in it, and what is true."""

    named: Callable[[str], list[TrueObject]]  # a name -> the objects that it covers
    true: Callable[[Goal, Sequence[TrueObject]], bool]  # of one object for each of a goal's names


class GoalTracker:
    """Watches the events of one task and says which goals hold.

    Placements, HOLDON, OPEN and CLOSED are read off the event asked about. What a world does not
    keep, the tracker remembers over all sub-tasks of the task: deeds (cleaned, heated, cooled) and
    temperatures, as `RememberedDeeds` tells them. Of the other states:

    * clean: not dirty, however that came about; of what is never dirty, as food, once cleaned.
    * shining: on and in view.

    Slices have what was done to the whole. Only where a goal names the type of the pieces, as in
    STATE(AppleSliced, heated), is it to be done to a slice itself: so it is in ALFRED.

    A placement counts when it holds at the end of its sub-task, or held at some moment of it and
    nobody undid it on purpose: see `Standing`.

    TOGGLEON of a momentary appliance (`MOMENTARY`) asks that it ran at some moment of the sub-task;
    of anything else, that it is on when asked.
    """

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._deeds = RememberedDeeds()
        self._on: frozenset[str] = frozenset()
        self._ran: set[str] = set()
        self._standing = Standing()

    def start(self, event: Event) -> None:
        """Forget everything and take the first event of a task; also begins its first sub-task."""
        self._forget()
        self.update(event)

    def begin_subtask(self, subtask: SubTask, event: Event) -> None:
        """Begin the next sub-task: what still runs counts as running in it, the rest is over."""
        self._ran = set(self._on)
        self._standing = Standing.of(subtask)
        self._look(truth_of(event))

    def update(self, event: Event) -> None:
        """Take in one event, in order."""
        truth = truth_of(event)
        self._deeds.update(truth)
        self._on = frozenset(t.object_id for t in truth.objects if "on" in t.states)
        self._ran |= self._on
        self._look(truth)

    def reset(self) -> None:
        """Do nothing: the tracker is started by whoever resets its world."""

    def watch(self, action: str, arguments: Mapping[str, Any], event: Event) -> None:
        """Take in the event of an action, if that can change what holds."""
        if action not in _CHANGE_NO_GOAL:
            self.update(event)

    def _look(self, truth: Truth) -> None:
        """See which goals of the sub-task hold, of which things."""
        if not self._standing.goals:
            return
        index = ObjectIndex(truth)
        now = [
            (goal, _ids(things))
            for goal in self._standing.goals
            for things in product(*_objects_named(goal, index))
            if self._true_now(index, goal, things)
        ]
        self._standing.look(now, index.is_carried)

    def holds(self, goal: Goal, event: Event) -> bool:
        """Return whether one goal holds, taken alone."""
        return not self.unmet((goal,), event)

    def unmet(self, goals: Sequence[Goal], event: Event) -> tuple[Goal, ...]:
        """Return the goals of one sub-task that do not hold, in order; () when it succeeded.

        Of the ways to choose objects for the names, the one that meets most goals counts.
        """
        index = ObjectIndex(truth_of(event))
        missed: set[Goal] = set()
        for group in linked(_names_of(goals)):
            missed |= self._missed(group, index)
        return tuple(goal for goal in goals if goal in missed)

    def progress(self, goals: Sequence[Goal], event: Event) -> Progress:
        """Return how many conditions of one sub-task are met, and of how many.

        As ALFRED counts: a goal taken alone is one condition, or as many as it counts; goals that
        share a name are together one more, which is met when one choice of objects meets them all.
        So all are met just when `unmet` is empty.
        """
        index = ObjectIndex(truth_of(event))
        met = of = 0
        for group in linked(_names_of(goals)):
            for goal in group:
                named = _objects_named(goal, index)
                met += min(goal.count, suited(goal, named, partial(self._true, index)))
                of += goal.count
            if len(group) > 1:
                met += not self._missed(group, index)
                of += 1
        return Progress(met, of)

    def meanings(self, event: Event) -> Meanings:
        """Return what names mean at an event, and which goals hold of which objects."""
        index = ObjectIndex(truth_of(event))
        return Meanings(lambda name: index.named(alternatives(name)), partial(self._true, index))

    def _missed(self, goals: Sequence[Goal], index: ObjectIndex) -> frozenset[Goal]:
        names = _names_of(goals)
        named = {name: index.named(alternatives(name)) for its in names.values() for name in its}
        return fewest_missed(names, named, partial(self._true, index))

    def _true(self, index: ObjectIndex, goal: Goal, things: Sequence[TrueObject]) -> bool:
        return self._standing.has(goal, _ids(things)) or self._true_now(index, goal, things)

    def _true_now(self, index: ObjectIndex, goal: Goal, things: Sequence[TrueObject]) -> bool:
        first = things[0]
        match goal.predicate:
            case "ON" | "INSIDE" if is_position(goal.arguments[1]):
                place = [float(x) for x in goal.arguments[1].strip("() ").split(",")]
                return _near(first, place) and first.object_id not in index.held
            case "ON" if not things[1].receptacle:
                place_m = things[1].position_m
                return _near(first, place_m) and first.object_id not in index.held
            case "ON" | "INSIDE":
                return things[1].object_id in index.holders(first)
            case "HOLDON":
                return first.object_id in index.held
            case "STATE":
                return self._in_state(first, *goal.arguments)
            case "TOGGLEON" if first.object_type in MOMENTARY:
                return first.object_id in self._ran
            case _:
                return self._in_state(first, goal.arguments[0], END_STATES[goal.predicate])

    def _in_state(self, thing: TrueObject, name: str, word: str) -> bool:
        state = canonical_state(word) or word
        if state == "clean" and thing.dirtyable:
            return "dirty" not in thing.states
        if state in DEEDS:
            pieces = all(map(is_piece, alternatives(name)))
            return self._deeds.done(thing.object_id, state, itself=pieces)
        if state in TEMPERATURES:
            return self._deeds.is_now(thing.object_id, state)
        match state:
            case "empty":
                return "filled" not in thing.states and not thing.child_ids
            case "broken":
                return thing.broken or thing.object_type == piece_type(EGG)
            case "clean":
                return self._deeds.done(thing.object_id, "cleaned")
            case "shining":
                return "on" in thing.states and thing.visible
            case "off":
                return "on" not in thing.states
            case _:
                return state in thing.states


class Watcher(Protocol):
    """What sees all that is done in a world."""

    def reset(self) -> None:
        """Know that the world is about to load a scene."""

    def watch(self, action: str, arguments: Mapping[str, Any], event: Event) -> None:
        """See one action and what came of it."""


class WatchedWorld:
    """A world whose actions are shown to somebody, a goal tracker or a log; it changes nothing."""

    def __init__(self, world: World, watcher: Watcher) -> None:
        self._world, self._watcher = world, watcher

    @property
    def last_event(self) -> Event:
        """The world's own."""
        return self._world.last_event

    def reset(self, scene: str) -> Event:
        """Load a scene."""
        self._watcher.reset()
        return self._world.reset(scene)

    def step(self, action: str, **arguments: Any) -> Event:
        """Do one action and show it."""
        event = self._world.step(action, **arguments)
        self._watcher.watch(action, arguments, event)
        return event

    def stop(self) -> None:
        """Release what the world holds."""
        self._world.stop()


_CHANGE_NO_GOAL = frozenset(
    (
        "MoveAhead", "MoveBack", "MoveLeft", "MoveRight", "RotateLeft", "RotateRight", "LookUp",
        "LookDown", "GetReachablePositions", "GetInteractablePoses", "GetShortestPath",
    )
)  # fmt: skip


def _objects_named(goal: Goal, index: ObjectIndex) -> list[list[TrueObject]]:
    return [index.named(alternatives(name)) for name in object_names(goal)]


def _ids(things: Sequence[TrueObject]) -> tuple[str, ...]:
    return tuple(thing.object_id for thing in things)


def _near(thing: TrueObject, place: Sequence[float]) -> bool:
    gaps = [a - b for a, b in zip(thing.position_m, place, strict=True)]
    return max(map(abs, gaps)) <= NEAR_M and sum(gap**2 for gap in gaps) <= NEAR_M**2


# ----------------------------------------------------------------- what stands meanwhile


@dataclass(slots=True)
class Standing:
    """Keeps what stands, over the events of one sub-task."""

    goals: tuple[Goal, ...] = ()  # that it has to be told of
    passing: frozenset[Goal] = frozenset()
    _facts: frozenset[Fact] = field(default=frozenset())

    @classmethod
    def of(cls, subtask: SubTask) -> Self:
        """Begin a sub-task, of which nothing has held yet."""
        passing = frozenset(subtask.passing)
        goals = (g for g in subtask.goals if g in passing or g.predicate in ("ON", "INSIDE"))
        return cls(tuple(goals), passing)

    def look(self, now: Collection[Fact], is_carried: Callable[[str], bool]) -> None:
        """Take in one event.

        `is_carried` says of an id whether it is in the hand, or in what is there.
        """
        kept = (one for one in self._facts if one[0] in self.passing or not is_carried(one[1][0]))
        self._facts = frozenset((*now, *kept))

    def has(self, goal: Goal, ids: tuple[str, ...]) -> bool:
        """Return whether a goal stands for some things."""
        return (goal, ids) in self._facts
