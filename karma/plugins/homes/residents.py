"""A home in which people live: they really act in the world, and every deed is logged.

Moves are drawn a day ahead, thing by thing, as Poisson draws whose rates are scaled to the wanted
disturbance. When its time comes a move is made by somebody who is at home and awake, with the
world's own actions; what the world refuses does not happen and is counted.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from karma.errors import KarmaError
from karma.household.ids import type_of
from karma.household.places import FLOOR, HAND
from karma.household.types import object_types
from karma.plugins.homes.habits import Span, habits, rates_drawn
from karma.plugins.homes.houses import room_name
from karma.plugins.homes.types import Deed, Sighting
from karma.seeds import stream
from karma.types.space import Pose
from karma.world.actions.table import ACTIONS
from karma.world.core.effects import settle
from karma.world.core.scene import Scene, SceneObject
from karma.world.core.state import Performed, WorldState
from karma.world.core.thing import is_inert, is_movable
from karma.world.event import WorldEvent
from karma.world.sim import EmbeddedWorld

DAY_S, HOUR_S = 86_400.0, 3_600.0
ACTION_S = 2.0  # of the robot: a step, a turn, a grip
_TRIES = 3  # places that a thing is brought to before it stays where it was
_LOGGED = frozenset(
    (
        "PickupObject", "PutObject", "OpenObject", "CloseObject", "ToggleObjectOn", "DirtyObject",
        "ToggleObjectOff", "CleanObject", "SliceObject", "DropHandObject", "FillObjectWithLiquid",
        "EmptyLiquidFromObject",
    )
)  # of the robot's actions: those that change a thing  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Resident:
    """A person and their day."""

    name: str
    wake_h: float
    sleep_h: float
    away_h: tuple[tuple[float, float] | None, ...]  # of each weekday; None: at home

    def is_up(self, time_s: float) -> bool:
        """Return whether the person is at home and awake."""
        hour = time_s % DAY_S / HOUR_S
        away = self.away_h[int(time_s // DAY_S) % 7]
        at_home = away is None or not away[0] <= hour < away[1]
        return self.wake_h <= hour < self.sleep_h and at_home


@dataclass(frozen=True, slots=True, kw_only=True)
class _Move:
    """A thing that somebody will move, and the draws that decide how."""

    time_s: float
    object_id: str
    activity: str
    draws: tuple[float, ...]  # in [0, 1)


class Household:
    """A home with up to four people, its clock and its log of truth.

    `disturbance` is the share of the movable things that are moved at least once a day, to 0.5.

    Raises:
        KarmaError: a number is out of its bounds.
    """

    def __init__(self, scene: Scene, *, seed: int, people: int, disturbance: float) -> None:
        most = len(habits().people.names)
        if not 0 <= people <= most or not 0.0 <= disturbance <= 0.5:
            raise KarmaError(
                f"{people} people, disturbance {disturbance:g}: not 0 to {most}, 0 to 0.5"
            )
        self._scene, self._seed = scene, seed
        self.world = EmbeddedWorld(scene)
        self.clock_s = 0.0
        self.log: list[Deed] = []
        self.refused = 0  # deeds that the world did not let happen
        self.residents = tuple(_drawn(name, seed) for name in habits().people.names[:people])
        self._rooms = {one.name: _bedroom(scene) for one in self.residents}
        self._places = resting_places(scene)
        things = {one.id: one.type for one in scene.objects if is_movable(one)}
        rng = stream(seed, "residents", "rates")
        self._rates = rates_drawn(things, disturbance if people else 0.0, rng)  # moves a day
        self._usual = {one.id: one.parents[0] for one in scene.objects if one.parents}
        self._waiting: list[_Move] = []  # the last one first
        self._drawn_days = 0

    def fork(self) -> "Household":
        """Return the same home at the same moment, that goes on by itself."""
        other = copy(self)
        other.world = copy(self.world)  # moments are frozen: each goes on with its own
        other.log, other._waiting = self.log.copy(), self._waiting.copy()
        other._rooms = self._rooms.copy()
        return other

    def until(self, time_s: float) -> tuple[Deed, ...]:
        """Let people live until a time; return what they did, in order."""
        before = len(self.log)
        for move in self._due(time_s):
            self._make(move)
        return tuple(self.log[before:])

    def skip(self, time_s: float) -> None:
        """Go to a time; what was to be done before is not done."""
        for _ in self._due(time_s):
            pass

    def _due(self, time_s: float) -> Iterator[_Move]:
        """Yield the moves until a time, which it is then."""
        while self._drawn_days * DAY_S < time_s:
            self._draw_day(self._drawn_days)
            self._drawn_days += 1
        while self._waiting and self._waiting[-1].time_s < time_s:
            yield self._waiting.pop()
        self.clock_s = max(self.clock_s, time_s)

    def robot(self, action: str, **arguments: Any) -> WorldEvent:
        """Do one action of the robot; people live on for as long as it takes."""
        thing_id = arguments.get("objectId") or self.world.state.held
        if action == "PutObject":
            thing_id = self.world.state.held
        place_id = self._place_of(thing_id)
        event = self.world.step(action, **arguments)
        if event and action in _LOGGED and thing_id in event.state.objects:
            if action == "PutObject":
                place_id = self._place_of(thing_id)
            time_s = max(self.clock_s, self.log[-1].time_s if self.log else 0.0)
            self._log("robot", action, str(thing_id), place_id, time_s, "")
        self.until(self.clock_s + ACTION_S)
        return event

    def room_of(self, name: str) -> str:
        """Return the room that a resident is in, or was in last."""
        return self._rooms[name]

    def now(self, among: Collection[str] = ()) -> dict[str, Sighting]:
        """Return where every movable thing is: the nearest receptacle, or furniture of some ids."""
        state = self.world.state
        found = {}
        for thing in filter(is_movable, state.objects.values()):
            there = (one for one in thing.parents if not among or one in among)
            place_id = HAND if thing.id in state.in_hand else next(there, None)
            found[thing.id] = Sighting(
                time_s=self.clock_s,
                object_id=thing.id,
                object_type=thing.type,
                place_id=place_id,
                room=self._places.get(place_id or "") or self._room_at(thing),
                position_m=thing.center,
                states=states_of(thing),
            )
        return found

    # ------------------------------------------------------------- days

    def _draw_day(self, day: int) -> None:
        """Draw the moves of a day; each thing has draws of its own."""
        table, rng = habits(), stream(self._seed, "residents", "day", str(day))
        rates = self._rates
        counts = rng.poisson(np.fromiter(rates.values(), dtype=float, count=len(rates)))
        moves = []
        for object_id, count in zip(rates, counts.tolist(), strict=True):
            for _ in range(min(count, 12)):
                names = table.types[type_of(object_id)].activities
                name = names[int(rng.integers(len(names)))]
                hour = float(rng.uniform(*table.activities[name].hours))
                draws = tuple(rng.random(8).tolist())
                time_s = day * DAY_S + hour * HOUR_S
                moves.append(_Move(time_s=time_s, object_id=object_id, activity=name, draws=draws))
        self._waiting += moves
        self._waiting.sort(key=lambda move: (-move.time_s, move.object_id))

    def _make(self, move: _Move) -> None:
        """Have somebody make a move, if anybody is there and the world lets it happen."""
        up = [one for one in self.residents if one.is_up(move.time_s)]
        thing = self.world.state.objects.get(move.object_id)
        if not up or thing is None or is_inert(thing):
            return
        if thing.is_picked_up or thing.id in self.world.state.in_hand:
            return
        who = up[int(move.draws[0] * len(up))].name
        for number in range(_TRIES):
            goal = self._goal(thing, move, move.draws[1 + number], first=number == 0)
            if goal is not None and self._carry(who, thing, goal, move):
                return
        self.refused += 1

    def _goal(
        self, thing: SceneObject, move: _Move, draw: float, *, first: bool
    ) -> SceneObject | None:
        """Return where a thing is brought: to its usual place, where it is used, or astray.

        A place takes the thing's type and is not where it is now.
        """
        people, activity = habits().people, habits().activities[move.activity]
        objects, types = self.world.state.objects, object_types()
        here = self._place_of(thing.id)
        usual = self._usual.get(thing.id)
        if first and usual is not None and usual != here and move.draws[4] < people.habit:
            return objects.get(usual)
        fitting = [
            place_id
            for place_id in self._places
            if place_id != here
            and types[thing.type].fits(types[objects[place_id].type], self.world.state.room.rules)
        ]
        if move.draws[5] >= people.stray:
            to = [one for one in fitting if objects[one].type in activity.to]
            wanted = [one for one in to if kind_of_room(self._places[one]) in activity.rooms]
            fitting = wanted or to or fitting
        return objects[fitting[int(draw * len(fitting))]] if fitting else None

    # ------------------------------------------------------------- deeds

    def _carry(self, who: str, thing: SceneObject, goal: SceneObject, move: _Move) -> bool:
        """Take a thing, do to it what belongs to the activity, and put it down; all or nothing."""
        activity, start = habits().activities[move.activity], self.world.state
        here, shut_in = self._place_of(thing.id), self._shut_holder(start, thing)
        attempt = _Attempt(replace(start, held=None, pose=self._before(thing, start.pose)))
        attempt.do("OpenObject", shut_in, shut_in)
        attempt.do("PickupObject", thing.id, here)
        attempt.do("CloseObject", shut_in, shut_in)
        change = self._change(thing, activity.washes, activity.dirties, move.draws[6])
        if not attempt.do(change, thing.id, here):
            return False
        attempt.state = replace(attempt.state, pose=self._before(goal, start.pose))
        door = goal.id if self._is_shut(goal) else None
        attempt.do("OpenObject", door, door)
        attempt.do("PutObject", thing.id, goal.id)
        if not attempt.do("CloseObject", door, door):
            return False
        self._settle(attempt.state, start)
        self._note(who, attempt.done, move, habits().people.walk_s)
        return True

    def _before(self, thing: SceneObject, pose: Pose) -> Pose:
        """Return a pose beside a thing: where a person stands is where things are put first."""
        x, _, z = thing.center
        return replace(pose, position_m=(x, pose.position_m[1], z), yaw_deg=0.0, horizon_deg=30.0)

    def _settle(self, state: WorldState, before: WorldState) -> None:
        """Give the robot its own body back; effects of the household follow."""
        after = replace(
            state,
            pose=before.pose,
            held=before.held,
            hand_m=before.hand_m,
            hand_turn_deg=before.hand_turn_deg,
        )
        self.world.back_to(WorldEvent(state=settle(after), action="Pass"))

    def _note(
        self, who: str, done: Sequence[tuple[str, str, str | None]], move: _Move, walk: Span
    ) -> None:
        """Log deeds one after another; the way from taking to putting takes its time."""
        time_s = max(move.time_s, self.log[-1].time_s if self.log else 0.0)
        for action, object_id, place_id in done:
            if action == "PutObject":
                time_s += walk[0] + move.draws[7] * (walk[1] - walk[0])
            self._log(who, action, object_id, place_id, time_s, move.activity)
            time_s += habits().people.seconds_per_action
        self._rooms[who] = self.log[-1].room

    def _change(self, thing: SceneObject, washes: float, dirties: float, draw: float) -> str | None:
        if "dirtyable" not in thing.capabilities:
            return None
        if thing.is_dirty:
            return "CleanObject" if draw < washes else None
        return "DirtyObject" if draw < dirties else None

    def _log(
        self,
        who: str,
        action: str,
        object_id: str,
        place_id: str | None,
        time_s: float,
        activity: str,
    ) -> None:
        thing = self.world.state.objects[object_id]
        self.log.append(
            Deed(
                time_s=round(time_s, 1),
                who=who,
                action=action,
                object_id=object_id,
                object_type=thing.type,
                place_id=place_id,
                room=self._places.get(place_id or "") or self._room_at(thing),
                states=states_of(thing),
                activity=activity,
            )
        )

    # ------------------------------------------------------------- where

    def _place_of(self, object_id: str | None) -> str | None:
        thing = self.world.state.objects.get(object_id or "")
        if thing is None or not thing.parents:
            return None
        return thing.parents[0]

    def _room_at(self, thing: SceneObject) -> str:
        return room_name(self._scene, thing.center[0], thing.center[2])

    def _shut_holder(self, state: WorldState, thing: SceneObject) -> str | None:
        """Return the id of a closed receptacle that a thing is in."""
        return next((one for one in thing.parents if self._is_shut(state.objects[one])), None)

    @staticmethod
    def _is_shut(thing: SceneObject) -> bool:
        return "openable" in thing.capabilities and thing.openness <= 0


def states_of(thing: SceneObject) -> tuple[str, ...]:
    """Return the words of `State` that are true of a thing, sorted."""
    words = {
        "cooked": thing.is_cooked, "dirty": thing.is_dirty, "filled": thing.is_filled,
        "sliced": thing.is_sliced, "used up": thing.is_used_up, "on": thing.is_toggled,
        "opened": "openable" in thing.capabilities and thing.openness > 0,
    }  # fmt: skip
    return tuple(sorted(word for word, holds in words.items() if holds))


class _Attempt:
    """Deeds on a moment of its own, `state`; all or nothing: none is done after a refusal."""

    def __init__(self, state: WorldState) -> None:
        self.state, self.fine = state, True
        self.done: list[tuple[str, str, str | None]] = []  # action, object, place

    def do(self, action: str | None, object_id: str | None, place_id: str | None) -> bool:
        """Do one of the world's own actions, if one and its object are named.

        Returns:
            Whether nothing has been refused so far.
        """
        if self.fine and action is not None and object_id is not None:
            self.done.append((action, object_id, place_id))
            target = place_id if action == "PutObject" else object_id
            result = ACTIONS[action].handler(self.state, objectId=target, forceAction=True)
            self.fine = isinstance(result, Performed)
            self.state = result.state if isinstance(result, Performed) else self.state
        return self.fine


def resting_places(scene: Scene) -> Mapping[str, str]:
    """Return the rooms of the furniture that things are put in or on, by its id."""
    found = {}
    for thing in scene.objects:
        can = thing.capabilities
        if "receptacle" in can and "pickupable" not in can and thing.type != FLOOR:
            found[thing.id] = room_name(scene, thing.center[0], thing.center[2])
    return found


def kind_of_room(name: str) -> str:
    """Return the kind that a room's name begins with: "kitchen" of "kitchen_1"."""
    return name.rpartition("_")[0]


def _bedroom(scene: Scene) -> str:
    names = [room.name for room in scene.rooms or ()]
    return next((name for name in names if name.startswith("bedroom")), (names or [scene.name])[0])


def _drawn(name: str, seed: int) -> Resident:
    people, rng = habits().people, stream(seed, "residents", "person", name)
    wake, sleep = float(rng.uniform(*people.wake_h)), float(rng.uniform(*people.sleep_h))
    away: list[tuple[float, float] | None] = []
    for weekday in range(7):
        goes = weekday < 5 and rng.random() < people.away_chance
        span = (float(rng.uniform(*people.away_from_h)), float(rng.uniform(*people.away_to_h)))
        away.append(span if goes else None)
    return Resident(name=name, wake_h=wake, sleep_h=sleep, away_h=tuple(away))
