"""The robot's body in a lived-in home: it walks, looks, opens, takes and puts, and counts.

A walk is one `TeleportFull` to the spot that it leads to, charged and timed as the shortest walk
over the cells there (`HomeMap`); residents go on living meanwhile. Everything else is one world
action each. What it sees is what the world's own sight shows from there.
"""

from collections.abc import Callable, Iterator, Sequence

from karma.contracts import Deed, HomeMoment, Pose, Sighting
from karma.household.places import HAND
from karma.methods.lived.home_map import HomeMap, LookSpot
from karma.world.core.objects import Objects
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.state import WorldState
from karma.world.core.thing import is_inert
from karma.world.residents import Household, states_of

TURNS = 2  # spots that a hand is tried from before it gives up


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
        return self.household.world.state.held

    def wait(self, time_s: float, *, watching: bool = True) -> None:
        """Let time pass; deeds of residents in the same room are seen."""
        self._witness(self.household.until(time_s), watching=watching)

    def go(self, spot: LookSpot) -> bool:
        """Walk to a spot; False where the world refuses it."""
        steps, begun_s, start = self.map.cost(self.at, spot), self.time_s, self._pose()
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

    def look(self, looked_over: Sequence[str] = (), since_s: float | None = None) -> HomeMoment:
        """Take note of what is in view, and of the places that were looked over since a time."""
        state = self.household.world.state
        seen = tuple(sightings(state, self.map, self.time_s, self._room_of_place))
        moment = HomeMoment(
            time_s=self.time_s, room=self.at.room, seen=seen, looked_over=tuple(looked_over),
            looked_since_s=since_s,
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
            opened = self.is_shut(place_id) and self._act("OpenObject", objectId=place_id)
            shows = place_id in self.household.world.state.sight.visible
            all_of_it = reached == len(order) and shows and not self.is_shut(place_id)
            moment = self.look((place_id,) if all_of_it else (), began_s)
            if until is not None and until(moment):
                return True
            if opened:
                self._act("CloseObject", objectId=place_id)
        return False

    def is_shut(self, place_id: str) -> bool:
        """Return whether a place must be opened to see what is in it."""
        thing = self.household.world.state.objects[place_id]
        return "openable" in thing.capabilities and thing.openness <= 0

    def take(self, object_id: str, place_id: str | None) -> bool:
        """Pick a thing up, if need be from another spot of the place it is in or on."""
        if self.held is not None:
            return False
        if self._act("PickupObject", objectId=object_id):
            return self._took(object_id)
        spots = self.map.spots.get(place_id or "", ())
        for spot in [spot for spot in spots if spot != self.at][:TURNS]:
            if self.go(spot) and self._act("PickupObject", objectId=object_id):
                return self._took(object_id)
        return False

    def put(self, place_id: str) -> bool:
        """Bring what is held to a place and put it in or on there."""
        held = self.held
        for spot in self.map.spots.get(place_id, ())[:TURNS]:
            if held is None or not self.go(spot):
                continue
            opened = self.is_shut(place_id) and self._act("OpenObject", objectId=place_id)
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
        if "openable" in self.household.world.state.objects[place_id].capabilities:
            self._act("CloseObject", objectId=place_id)

    def is_still_so(self, seen: Sighting) -> bool:
        """Return whether a thing is where it was seen: the truth, for figures only."""
        state = self.household.world.state
        thing = state.objects.get(seen.object_id)
        if thing is None or is_inert(thing) or thing.id in state.in_hand:
            return False
        return resting_place(state.objects, thing, self.map) == seen.place_id

    # ------------------------------------------------------------- what happens

    def _pose(self) -> Pose:
        return self.household.world.state.pose

    def _took(self, object_id: str) -> bool:
        self.look()
        return True

    def _act(self, action: str, **arguments: object) -> bool:
        before = len(self.household.log)
        event = self.household.robot(action, **arguments)
        self.actions += 1
        self._witness(self.household.log[before:])
        return bool(event)

    def _witness(self, deeds: Sequence[Deed], *, watching: bool = True) -> None:
        """Tell of the deeds that were the robot's own or happened in its room."""
        if not watching:
            return
        for deed in deeds:
            if deed.who == "robot" or deed.room == self.at.room:
                self._tell(self._moment_of(deed))

    def _moment_of(self, deed: Deed) -> HomeMoment:
        objects = self.household.world.state.objects
        thing = objects.get(deed.object_id)
        seen: tuple[Sighting, ...] = ()
        if thing is not None and "pickupable" in thing.capabilities:
            in_hand = deed.action == "PickupObject"
            place = HAND if in_hand else _furniture(objects, deed.place_id, self.map)
            seen = (
                Sighting(
                    time_s=deed.time_s,
                    object_id=deed.object_id,
                    object_type=deed.object_type,
                    place_id=place,
                    room=deed.room,
                    position_m=thing.center,
                    states=deed.states,
                ),
            )
        return HomeMoment(time_s=deed.time_s, room=self.at.room, seen=seen, deed=deed)

    def _room_of_place(self, place_id: str | None) -> str:
        place = self.map.places.get(place_id or "")
        return place.room if place is not None else self.at.room


def sightings(
    state: WorldState, home: HomeMap, time_s: float, room_of: Callable[[str | None], str]
) -> Iterator[Sighting]:
    """Yield the movable things in view, in the order of the scene."""
    visible = state.sight.visible
    for object_id in state.objects:
        if object_id not in visible:
            continue
        thing = state.objects[object_id]
        if "pickupable" in thing.capabilities and not is_inert(thing):
            yield sighting_of(state, thing, home, time_s, room_of)


def sighting_of(
    state: WorldState,
    thing: SceneObject,
    home: HomeMap,
    time_s: float,
    room_of: Callable[[str | None], str],
) -> Sighting:
    """Return where a movable thing is now: the furniture that it is in or on."""
    held = thing.id in state.in_hand
    place = HAND if held else resting_place(state.objects, thing, home)
    return Sighting(
        time_s=time_s,
        object_id=thing.id,
        object_type=thing.type,
        place_id=place,
        room=room_of(place),
        position_m=thing.center,
        states=states_of(thing),
    )


def resting_place(objects: Objects, thing: SceneObject, home: HomeMap) -> str | None:
    """Return the id of the furniture that a thing lies in or on, however deep; None: the floor."""
    for parent in thing.parents:
        found = _furniture(objects, parent, home)
        if found is not None:
            return found
    return None


def _furniture(objects: Objects, place_id: str | None, home: HomeMap) -> str | None:
    if place_id is None or place_id in home.places:
        return place_id
    thing = objects.get(place_id)
    return None if thing is None else resting_place(objects, thing, home)
