"""The robot's body in a lived-in home: it walks, looks, opens, takes and puts, and counts.

Legs, hand and eyes are those of every agent (`karma.agent`), in a home where residents go on living
at each of its actions.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from karma.agent.body.handling import Handling
from karma.agent.body.reach import Reach, SkillLimits
from karma.agent.body.refusals import RefusedError
from karma.agent.body.search import best_next
from karma.agent.body.walk import OutOfActionsError
from karma.agent.seeing.eyes import MetadataEyes
from karma.agent.seeing.perceive import observe
from karma.household.places import HAND, LIKELY
from karma.household.types import object_types
from karma.plugins.homes.lived.home_map import HomeMap
from karma.plugins.homes.residents import Household
from karma.plugins.homes.types import Deed, Fact, HomeMoment, LikelyPlace, Sighting
from karma.types.observation import SeenObject
from karma.types.roles import Event
from karma.types.space import Pose

UNTOLD = frozenset(("off", "closed", "heated"))  # words of `State` that no sighting keeps


class HomeRobot:
    """Acts in a household and tells what it learns as moments; see `Stage`."""

    def __init__(
        self, household: Household, home_map: HomeMap, tell: Callable[[HomeMoment], None]
    ) -> None:
        self.household, self.map, self._tell = household, home_map, tell
        self._reach = Reach(self, home_map, SkillLimits(), MetadataEyes(), {})
        self._walker, self._hand = self._reach.walker, Handling(self._reach)
        self.actions = 0  # of the world; the first asks for the map of the floor
        self._walker.start()

    @property
    def last_event(self) -> Event:
        """The event of the last action, or of what a resident has done since."""
        return self.household.world.last_event

    def step(self, action: str, **arguments: Any) -> Event:
        """Do one action; deeds of residents in the same room are seen meanwhile."""
        before = len(self.household.log)
        event = self.household.robot(action, **arguments)
        self.actions += 1
        self._witness(self.household.log[before:])
        return event

    @property
    def time_s(self) -> float:
        """The clock of the home."""
        return self.household.clock_s

    @property
    def room(self) -> str:
        """The room that it is in."""
        return self.map.room_at(*self._walker.position)

    @property
    def held(self) -> str | None:
        """Id of what is in the hand."""
        return self._reach.log.held_id

    def way(self, place_id: str) -> float:
        """Return how many actions it takes to get to where a place is looked at from."""
        return min(map(self._cost, self.map.spots[place_id]))

    def _cost(self, spot: Pose) -> float:
        return self._walker.cost(self._walker.stance(spot))

    def wait(self, time_s: float) -> None:
        """Let time pass; deeds of residents in the same room are seen."""
        self._witness(self.household.until(time_s))

    def go(self, spot: Pose) -> bool:
        """Walk to a spot and look from there; False where something is in the way."""
        return self._managed(lambda: self._reach.stand(self._walker.stance(spot)))

    def look(self, over: str | None = None, since_s: float | None = None) -> HomeMoment:
        """Tell what is in view, and of a place that was looked all over since a time."""
        log = self._reach.log
        place = log.in_view.get(over or "")
        shows = place is not None and "closed" not in place.states
        shown = (*log.in_view.values(), *filter(None, [log.held]))
        moment = HomeMoment(
            time_s=self.time_s, room=self.room,
            seen=tuple(self._sighting(one) for one in shown if one.pickupable),
            looked_over=(over,) if over and shows else (), looked_since_s=since_s,
        )  # fmt: skip
        self._tell(moment)
        return moment

    def look_at(self, place_id: str, *, until: Callable[[HomeMoment], bool] | None = None) -> bool:
        """Go and look all over a place, opening it if it is shut; True once `until` holds."""
        order = sorted(self.map.spots[place_id], key=self._cost)
        began_s, reached = self.time_s, 0
        for spot in order:
            if not self.go(spot):
                continue
            reached += 1
            if opened := self._open(place_id):
                self.go(spot)
            moment = self.look(place_id if reached == len(order) else None, began_s)
            if until is not None and until(moment):
                return True
            if opened:
                self.close(place_id)
        return False

    def take(self, object_id: str) -> bool:
        """Pick up a thing that was just seen."""
        taken = self._managed(lambda: self._hand.pick_up(object_id))
        if taken:
            self.look()
        return taken

    def put(self, place_id: str) -> bool:
        """Bring what is held to a place and put it in or on there."""
        opened = self._open(place_id)
        done = self._managed(lambda: self._hand.put(None, place_id, exact=True))
        if done:
            self.look()
        if opened:
            self.close(place_id)
        return done

    def put_down(self) -> None:
        """Free the hand: onto the nearest surface that takes the thing."""
        surfaces = [one for one, place in self.map.places.items() if not place.openable]
        near = sorted(surfaces, key=lambda one: (self.way(one), one))
        if not any(map(self.put, near[:8])):
            self.step("DropHandObject", forceAction=True)
            self._reach.look()

    def close(self, place_id: str) -> None:
        """Close a place that was opened."""
        if self.map.places[place_id].openable:
            self._managed(lambda: self._hand.act("CloseObject", place_id))

    def _open(self, place_id: str) -> bool:
        """Open a place that is not seen standing open; return whether it was opened."""
        seen = self._reach.log.in_view.get(place_id)
        if not self.map.places[place_id].openable or (seen and "opened" in seen.states):
            return False
        return self._managed(lambda: self._hand.act("OpenObject", place_id))

    def _managed(self, do: Callable[[], str | bool]) -> bool:
        """Do something with the body; False where it cannot be done."""
        self._walker.start()
        try:
            return do() is not False
        except (RefusedError, OutOfActionsError):
            return False

    # ------------------------------------------------------------- what happens

    def _witness(self, deeds: Sequence[Deed]) -> None:
        """Tell of the deeds that were the robot's own or happened in its room."""
        near = [one for one in deeds if one.who == "robot" or one.room == self.room]
        if not near:
            return
        types = object_types()
        carried = [one for one in near if types[one.object_type].can("pickupable")]
        things: dict[str, SeenObject] = {}
        if carried:
            told = {one for deed in carried for one in (deed.object_id, deed.place_id or "")}
            view = observe(self.last_event, touched=told)
            shown = (*view.seen, *view.touched, *filter(None, [view.held]))
            things = {one.object_id: one for one in shown}
        for deed in near:
            self._tell(self._moment_of(deed, things))

    # ------------------------------------------------------------- what is seen

    def _sighting(self, seen: SeenObject) -> Sighting:
        """Return where a movable thing is now: the furniture that it is in or on."""
        place_id = self._furniture(seen)
        place = self.map.places.get(place_id or "")
        return Sighting(
            time_s=self.time_s,
            object_id=seen.object_id,
            object_type=seen.object_type,
            place_id=place_id,
            room=self.room if place is None else place.room,
            position_m=seen.box_center_m,
            states=tuple(word for word in seen.states if word not in UNTOLD),
        )

    def _moment_of(self, deed: Deed, things: Mapping[str, SeenObject]) -> HomeMoment:
        """Return a deed that was seen, with where it left the thing."""
        thing, place_id = things.get(deed.object_id), deed.place_id
        seen: tuple[Sighting, ...] = ()
        if thing is not None and thing.pickupable:
            if deed.action == "PickupObject":
                place_id = HAND
            elif place_id is not None and place_id not in self.map.places:
                place_id = self._furniture(things.get(place_id))
            sight = self._sighting(thing)
            seen = (
                replace(
                    sight, time_s=deed.time_s, place_id=place_id, room=deed.room, states=deed.states
                ),
            )
        return HomeMoment(time_s=deed.time_s, room=self.room, seen=seen, deed=deed)

    def _furniture(self, thing: SeenObject | None) -> str | None:
        """Return the id of the furniture that a thing lies in or on, however deep; None: none."""
        holders = () if thing is None else thing.parent_ids
        return next((one for one in holders if one == HAND or one in self.map.places), None)


LOOK_ACTIONS = 4  # that a look costs beside the way, about


def looks(
    robot: HomeRobot,
    object_type: str | None,
    believed: Sequence[Fact],
    likely: Callable[[], Sequence[LikelyPlace]],
) -> Iterator[str]:
    """Yield places to look at, each once, the best from where the robot then stands.

    Where the memory gives chances, by chance over cost, asked for anew after every look. Without
    them what it believes comes first, then furniture in the order of a household's habits: where
    things are found at all, the nearest first.

    `believed`: the newest facts about what may be meant, the likeliest first.
    """
    types, places = object_types(), robot.map.places
    kind = types.get(object_type or "")
    held = {one.sighting.place_id or "": one.holds for one in reversed(believed)}
    sure = {place_id: holds for place_id, holds in held.items() if holds is not None}
    trusted = [] if sure else [one.sighting.place_id for one in believed]

    def asked() -> dict[str, float]:
        return {place.place_id: place.chance for place in likely()} or sure

    def rank(one: str) -> tuple[Any, ...]:
        place_type, cost = places[one].place_type, look_cost(robot, one)
        trust = trusted.index(one) if one in trusted else len(trusted)
        chance = max(chances.get(one, 0.0), 0.0)
        hopeless = not chance and one not in trusted and not fits(place_type)
        return hopeless, trust, -chance / cost, _rank(place_type), cost, one

    def fits(place_type: str) -> bool:
        return kind is None or kind.fits(types[place_type])

    chances = asked()
    for place_id in best_next(places, rank):
        if rank(place_id)[0]:
            break
        yield place_id
        chances = asked()


def look_cost(robot: HomeRobot, place_id: str) -> float:
    """Return how many actions a look at a place costs from here."""
    return LOOK_ACTIONS + robot.way(place_id)


def nearest_next(robot: HomeRobot, place_ids: Iterable[str]) -> Iterator[str]:
    """Yield places, each the nearest from where the robot then stands."""
    return best_next(place_ids, lambda one: (look_cost(robot, one), one))


def _rank(place_type: str) -> int:
    """Return how late a kind of furniture is looked at: thirds of the household's order."""
    return LIKELY.index(place_type) // 5 if place_type in LIKELY else len(LIKELY)
