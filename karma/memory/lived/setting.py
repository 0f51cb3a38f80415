"""What every design of a home's memory is made with."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from karma.contracts import Embedder, Sighting
from karma.household.types import in_words


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownPlace:
    """A receptacle of the home: it is furniture, and stays."""

    place_id: str
    place_type: str
    room: str  # its name
    room_kind: str  # "kitchen", "living", "bedroom" or "bathroom"
    openable: bool  # what is in it shows only when it stands open


@dataclass(frozen=True, slots=True, kw_only=True)
class MemorySetting:
    """What is the same for every design in one home."""

    embedder: Embedder  # of short texts; it keeps what it has embedded
    places: Mapping[str, KnownPlace]  # by id
    units: int = 10  # lines of short-term memory, where a design has one
    folder: Path | None = None  # for what is to survive a restart; None: nothing is written
    seed: int = 0


def sighting_text(sighting: Sighting, places: Mapping[str, KnownPlace]) -> str:
    """Return a sighting in plain words, without its time: what designs embed and prompts show.

    >>> sighting_text(Sighting(time_s=0, object_id="a", object_type="TVStand", place_id=None,
    ...     room="living_1", position_m=(0, 0, 0), states=("dirty",)), {})
    'dirty tv stand, living'
    """
    place = places.get(sighting.place_id or "")
    states = [state for state in sighting.states if state != "none"]
    words = " ".join([*states, in_words(sighting.object_type)])
    room = place.room_kind if place else sighting.room.rpartition("_")[0] or sighting.room
    where = [in_words(place.place_type)] if place else []
    return ", ".join([words, *where, room])
