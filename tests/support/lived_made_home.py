"""Made-up homes to ask in: a log, a start and what a robot saw, without a world."""

from dataclasses import dataclass

import numpy as np

from karma.bench.suites.lived.request import HomeView
from karma.contracts import Deed, HomeMoment, Sighting
from karma.household.types import object_types
from karma.memory.lived.setting import KnownPlace
from tests.support.lived import DAY_S, HOUR_S
from tests.support.lived_oracle import dirty_at, places_at

OPEN_PLACES = {
    "CounterTop|1": "kitchen_1", "SinkBasin|1": "kitchen_1", "DiningTable|1": "kitchen_1",
    "CoffeeTable|1": "living_1", "Shelf|1": "living_1", "Desk|1": "bedroom_1",
    "Desk|2": "bedroom_2", "SideTable|1": "bedroom_2", "CounterTop|2": "bathroom_1",
}  # fmt: skip
SHUT_PLACES = {"Drawer|1": "kitchen_1", "Cabinet|1": "kitchen_1"}
THINGS = (
    "Mug", "Mug", "Mug", "Plate", "Plate", "Bowl", "Cup", "Cup", "Book", "KeyChain",
    "RemoteControl", "Newspaper", "Pen", "Pen", "Apple", "Vase",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class MadeHome:
    """A home of which only the log, the moments and the start exist."""

    places: dict[str, KnownPlace]
    start: dict[str, Sighting]
    log: tuple[Deed, ...]
    seen: tuple[HomeMoment, ...]
    people: tuple[str, ...] = ("Ann", "Ben", "Cleo")

    def view(self, time_s):
        """Return what requests are drawn from at a time."""
        return HomeView(
            time_s=time_s, people=self.people, places=self.places,
            log=tuple(one for one in self.log if one.time_s <= time_s),
            seen=tuple(one for one in self.seen if one.time_s <= time_s),
            now=self.sightings(time_s), start=self.start, takes=lambda thing, place: True,
            words="plain",
        )  # fmt: skip

    def sightings(self, time_s):
        """Return where all things are at a time."""
        where, dirty = (
            places_at(self.start, self.log, time_s),
            dirty_at(self.start, self.log, time_s),
        )
        return {key: self.sighting(key, where[key], dirty[key], time_s) for key in self.start}

    def sighting(self, key, place_id, is_dirty, time_s):
        """Return one thing as it is."""
        room = self.places[place_id].room if place_id in self.places else ""
        return Sighting(
            time_s=time_s, object_id=key, object_type=key.split("|")[0], place_id=place_id,
            room=room, position_m=(0.0, 0.0, 0.0), states=("dirty",) if is_dirty else (),
        )  # fmt: skip


def made_home(seed, days=5, deeds=12):
    """Return a home whose things are moved by chance; the robot sees half of it, and rounds."""
    rng = np.random.default_rng([seed, 77])
    rooms = OPEN_PLACES | SHUT_PLACES
    places = {
        key: KnownPlace(
            place_id=key, place_type=key.split("|")[0], room=room,
            room_kind=room.split("_")[0], openable=key in SHUT_PLACES,
        )
        for key, room in rooms.items()
    }  # fmt: skip
    empty = MadeHome(places=places, start={}, log=(), seen=())
    ids = [f"{kind}|{number}" for number, kind in enumerate(THINGS)]
    start = {
        key: empty.sighting(key, _some_place(rng, key, places, None), rng.random() < 0.4, 0.0)
        for key in ids
    }
    home = MadeHome(places=places, start=start, log=(), seen=())
    log, witnessed = _lived(rng, home, days, deeds)
    home = MadeHome(places=places, start=start, log=log, seen=())
    moments = [HomeMoment(time_s=6 * HOUR_S, room="kitchen_1", seen=tuple(start.values()))]
    moments += [
        _round(home, day * DAY_S + hour * HOUR_S) for day in range(days) for hour in (9, 17.5)
    ]
    for deed in witnessed:
        shown = home.sightings(deed.time_s)[deed.object_id]
        moments.append(HomeMoment(time_s=deed.time_s, room=shown.room, seen=(shown,), deed=deed))
    moments.sort(key=lambda one: one.time_s)
    return MadeHome(places=places, start=start, log=log, seen=tuple(moments))


def _some_place(rng, key, places, but):
    types = object_types()
    thing = types[key.split("|")[0]]
    fitting = [
        one.place_id
        for one in places.values()
        if thing.fits(types[one.place_type]) and one.place_id != but
    ]
    return fitting[int(rng.integers(len(fitting)))]


def _lived(rng, home, days, deeds):
    """Return the deeds of some days, and those that the robot saw."""
    where = {key: one.place_id for key, one in home.start.items()}
    dirty = {key: bool(one.states) for key, one in home.start.items()}
    log, witnessed = [], []
    for day in range(days):
        for hour in np.sort(rng.uniform(7, 22.5, deeds)):
            key = list(where)[int(rng.integers(len(where)))]
            who = home.people[int(rng.integers(3))] if rng.random() < 0.9 else "robot"
            time_s = round(day * DAY_S + float(hour) * HOUR_S, 1)
            goal = _some_place(rng, key, home.places, where[key])
            steps = [("PickupObject", where[key])]
            if object_types()[key.split("|")[0]].can("dirtyable") and rng.random() < 0.6:
                dirty[key] = not dirty[key]
                steps.append(("DirtyObject" if dirty[key] else "CleanObject", where[key]))
            steps.append(("PutObject", goal))
            saw = rng.random() < 0.5
            for number, (action, place_id) in enumerate(steps):
                deed = Deed(
                    time_s=time_s + number, who=who, action=action, object_id=key,
                    object_type=key.split("|")[0], place_id=place_id,
                )  # fmt: skip
                log.append(deed)
                witnessed += [deed] if saw else []
            where[key] = goal
    log.sort(key=lambda one: one.time_s)
    return tuple(log), witnessed


def _round(home, time_s):
    shown = tuple(one for one in home.sightings(time_s).values() if one.place_id in OPEN_PLACES)
    return HomeMoment(time_s=time_s, room="kitchen_1", seen=shown, looked_over=tuple(OPEN_PLACES))
