"""The robot's body in a lived-in home: it walks, looks, opens, takes and puts, and counts.

A walk is one `TeleportFull` to the spot that it leads to, charged and timed as the shortest walk
over the cells there (`HomeMap`); residents go on living meanwhile. Everything else is one world
action each. What it sees is what `karma.agent.perceive` reads of the world's event.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

from karma.agent.perceive import observe
from karma.contracts import Deed, HomeMoment, Observation, Pose, SeenObject, Sighting
from karma.household.places import HAND
from karma.household.types import object_types
from karma.methods.lived.home_map import HomeMap, LookSpot
from karma.world.core.rules import rules
from karma.world.residents import Household

TURNS = 2  # spots that a hand is tried from before it gives up
UNTOLD = frozenset(("off", "closed", "heated"))  # words of `State` that no sighting keeps


class HomeRobot:
    """Acts in a household and tells what it learns as moments.

    Args:
        household: where it lives.
        home_map: of its furniture.
        tell: takes every moment, in order.
    """

    def __init__(
        self, household: Household, home_map: HomeMap, tell: Callable[[HomeMoment], None]
    ) -> None:
        self.household, self.map, self._tell = household, home_map, tell
        self.at = home_map.start
        self.actions = 0  # world actions, a step of a walk counted as one
        self.watch: Callable[[Pose, float], None] | None = None  # shown each walk: from where, when

    @property
    def time_s(self) -> float:
        """The clock of the home."""
        return self.household.clock_s

    @property
    def held(self) -> str | None:
        """Id of what is in the hand."""
        held = self._sees().held
        return None if held is None else held.object_id

    def wait(self, time_s: float, *, watching: bool = True) -> None:
        """Let time pass; deeds of residents in the same room are seen."""
        self._witness(self.household.until(time_s), watching=watching)

    def go(self, spot: LookSpot) -> bool:
        """Walk to a spot; False where the world refuses it."""
        steps, begun_s, start = self.map.cost(self.at, spot), self.time_s, self.at.pose
        x, y, z = spot.pose.position_m
        there = {"x": x, "y": y, "z": z, "rotation": spot.pose.yaw_deg}
        event = self._act(
            "TeleportFull", **there, horizon=spot.pose.horizon_deg, standing=spot.pose.standing
        )
        if steps > 1:
            self.actions += steps - 1
            self.wait(self.time_s + (steps - 1) * rules().time.action_s)
        if event:
            self.at = spot
            if self.watch is not None:
                self.watch(start, begun_s)
        return event

    def look(self, over: str | None = None, since_s: float | None = None) -> HomeMoment:
        """Take note of what is in view, and of a place that was looked all over since a time."""
        view = self._sees()
        shows = any(one.object_id == over and "closed" not in one.states for one in view.seen)
        shown = (*view.seen, *filter(None, [view.held]))
        moment = HomeMoment(
            time_s=self.time_s, room=self.at.room,
            seen=tuple(self._sighting(one) for one in shown if one.pickupable),
            looked_over=(over,) if over and shows else (), looked_since_s=since_s,
        )  # fmt: skip
        self._tell(moment)
        return moment

    def look_at(self, place_id: str, *, until: Callable[[HomeMoment], bool] | None = None) -> bool:
        """Go and look all over a place, opening it if it is shut; True once `until` holds."""
        spots = self.map.spots[place_id]
        order = sorted(spots, key=lambda spot: (self.map.cost(self.at, spot), spot.number))
        began_s, reached = self.time_s, 0
        for spot in order:
            if not self.go(spot):
                continue
            reached += 1
            opened = self._open(place_id)
            moment = self.look(place_id if reached == len(order) else None, began_s)
            if until is not None and until(moment):
                return True
            if opened:
                self._act("CloseObject", objectId=place_id)
        return False

    def take(self, object_id: str, place_id: str | None) -> bool:
        """Pick a thing up, if need be from another spot of the place it is in or on."""
        if self.held is not None:
            return False
        others = [one for one in self.map.spots.get(place_id or "", ()) if one != self.at]
        taken = self._act("PickupObject", objectId=object_id) or any(
            self.go(spot) and self._act("PickupObject", objectId=object_id)
            for spot in others[:TURNS]
        )
        if taken:
            self.look()
        return taken

    def put(self, place_id: str) -> bool:
        """Bring what is held to a place and put it in or on there."""
        held = self.held
        for spot in self.map.spots.get(place_id, ())[:TURNS]:
            if held is None or not self.go(spot):
                continue
            opened = self._open(place_id)
            done = self._act("PutObject", objectId=place_id)
            if done:
                self.look()
            if opened:
                self._act("CloseObject", objectId=place_id)
            if done:
                return True
        return False

    def put_down(self) -> None:
        """Free the hand: onto the nearest surface that takes the thing."""
        surfaces = [
            (min(self.map.cost(self.at, spot) for spot in spots), place_id)
            for place_id, spots in self.map.spots.items()
            if not self.map.places[place_id].openable
        ]
        for _, place_id in sorted(surfaces)[:8]:
            if self.put(place_id):
                return
        self._act("DropHandObject", forceAction=True)

    def close(self, place_id: str) -> None:
        """Close a place that was opened to take something out."""
        if self.map.places[place_id].openable:
            self._act("CloseObject", objectId=place_id)

    # ------------------------------------------------------------- what happens

    def _open(self, place_id: str) -> bool:
        """Open a place that is not seen standing open; return whether it was opened."""
        if not self.map.places[place_id].openable:
            return False
        seen = self._sees().seen
        if any(one.object_id == place_id and "closed" not in one.states for one in seen):
            return False
        return self._act("OpenObject", objectId=place_id)

    def _act(self, action: str, **arguments: object) -> bool:
        before = len(self.household.log)
        event = self.household.robot(action, **arguments)
        self.actions += 1
        self._witness(self.household.log[before:])
        return bool(event)

    def _witness(self, deeds: Sequence[Deed], *, watching: bool = True) -> None:
        """Tell of the deeds that were the robot's own or happened in its room."""
        near = [one for one in deeds if one.who == "robot" or one.room == self.at.room]
        if not near or not watching:
            return
        types = object_types()
        carried = [one for one in near if types[one.object_type].can("pickupable")]
        things: dict[str, SeenObject] = {}
        if carried:
            told = {one for deed in carried for one in (deed.object_id, deed.place_id or "")}
            view = self._sees(told)
            shown = (*view.seen, *view.touched, *filter(None, [view.held]))
            things = {one.object_id: one for one in shown}
        for deed in near:
            self._tell(self._moment_of(deed, things))

    # ------------------------------------------------------------- what is seen

    def _sees(self, touched: Collection[str] = ()) -> Observation:
        return observe(self.household.world.last_event, touched=touched)

    def _sighting(self, seen: SeenObject) -> Sighting:
        """Return where a movable thing is now: the furniture that it is in or on."""
        place_id = self._furniture(seen)
        place = self.map.places.get(place_id or "")
        return Sighting(
            time_s=self.time_s,
            object_id=seen.object_id,
            object_type=seen.object_type,
            place_id=place_id,
            room=self.at.room if place is None else place.room,
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
        return HomeMoment(time_s=deed.time_s, room=self.at.room, seen=seen, deed=deed)

    def _furniture(self, thing: SeenObject | None) -> str | None:
        """Return the id of the furniture that a thing lies in or on, however deep; None: none."""
        holders = () if thing is None else thing.parent_ids
        return next((one for one in holders if one == HAND or one in self.map.places), None)
