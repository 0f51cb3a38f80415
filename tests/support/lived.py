"""A small home with people, and a robot in it, for tests."""

from functools import cache
from itertools import pairwise

import numpy as np

from karma.plugins.homes.houses import build_home
from karma.plugins.homes.lived.designs import DESIGNS
from karma.plugins.homes.lived.home_map import HomeMap
from karma.plugins.homes.memory.setting import KnownPlace, MemorySetting
from karma.plugins.homes.types import Deed, HomeMoment, HomeQuestion, SaidThing, Sighting
from karma.types.planning import Meaning

DAY_S, HOUR_S = 86_400.0, 3_600.0


@cache
def small_home(rooms=2, seed=4):
    """Return a home of some rooms."""
    return build_home(rooms, seed)


@cache
def small_map(rooms=2, seed=4):
    """Return the robot's map of it."""
    return HomeMap(small_home(rooms, seed))


class LetterEmbedder:
    """Counts pairs of letters: texts that share words are near, without weights."""

    name, dimension = "letters", 64

    def embed(self, texts):
        """Return a row of length 1 per text."""
        rows = np.zeros((len(texts), self.dimension), dtype=np.float32)
        for row, text in zip(rows, texts, strict=True):
            for a, b in pairwise(text):
                row[(ord(a) * 31 + ord(b)) % self.dimension] += 1.0
            row /= max(float(np.linalg.norm(row)), 1e-6)
        return rows


PLACES = {
    name: KnownPlace(
        place_id=name, place_type=name.split("|")[0], room=room, room_kind=room.split("_")[0],
        openable=name.startswith("Drawer"),
    )
    for name, room in {
        "CounterTop|1": "kitchen_1", "SinkBasin|1": "kitchen_1", "Drawer|1": "kitchen_1",
        "CoffeeTable|1": "living_1", "Shelf|1": "living_1", "Desk|1": "bedroom_1",
    }.items()
}  # fmt: skip


def setting(units=10):
    """Return what designs are made with."""
    return MemorySetting(embedder=LetterEmbedder(), places=PLACES, units=units)


def seen(object_id, place_id, time_s, states=()):
    """Return a sighting; the id begins with the type."""
    place = PLACES.get(place_id)
    return Sighting(
        time_s=time_s, object_id=object_id, object_type=object_id.split("|")[0], place_id=place_id,
        room=place.room if place else "", position_m=(0.0, 0.0, 0.0), states=tuple(states),
    )  # fmt: skip


def moment(time_s, *sightings, looked_over=(), deed=None):
    """Return a moment."""
    return HomeMoment(
        time_s=time_s, room="kitchen_1", seen=sightings, looked_over=tuple(looked_over), deed=deed
    )


def where(kind, time_s, asked="place", **said):
    """Return a question for a thing of a type."""
    thing = SaidThing(
        phrase=f"the {kind.lower()}", types=(Meaning(name=kind, similarity=1.0),), **said
    )
    return HomeQuestion(text=f"where is the {kind}?", speaker="Ann", time_s=time_s, asked=asked,
                        thing=thing)  # fmt: skip


def put(object_id, place_id, time_s, who="Ann"):
    """Return the moment in which somebody puts a thing somewhere."""
    deed = Deed(time_s=time_s, who=who, action="PutObject", object_id=object_id,
                object_type=object_id.split("|")[0], place_id=place_id)  # fmt: skip
    return moment(time_s, seen(object_id, place_id, time_s), deed=deed)


def made(name, **given):
    """Return a memory of a design."""
    return DESIGNS[name](setting(**given))
