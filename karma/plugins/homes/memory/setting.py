"""What every design of a home's memory is made with; whether things are as a question says."""

from collections.abc import Mapping
from dataclasses import dataclass

from karma.household.types import in_words
from karma.plugins.homes.types import SaidThing, Sighting
from karma.types.roles import Embedder

MARGIN = 0.03  # below the best meaning, within which another type may be meant as well


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


def types_meant(said: SaidThing) -> tuple[str, ...]:
    """Return the object types that words may mean: the nearest, and what is about as near."""
    best = said.types[0].similarity if said.types else 0.0
    return tuple(one.name for one in said.types if one.similarity >= best - MARGIN)


def ranks_of(said: SaidThing) -> dict[str, int]:
    """Return the object types that words may mean at all, the likelier ones lower."""
    return {meaning.name: rank for rank, meaning in enumerate(said.types)}


def is_of_past(said: SaidThing) -> bool:
    """Return whether a thing is known by what was, not by what is."""
    return bool(said.who or said.action or said.after_s is not None or said.before_s is not None)


def has_states(seen: Sighting, said: SaidThing) -> bool:
    """Return whether a thing has all states that were said; "cleaned" is what is not dirty."""
    return all(
        state in seen.states or (state == "cleaned" and "dirty" not in seen.states)
        for state in said.states
    )


def is_said_place(place: KnownPlace | None, said: SaidThing) -> bool:
    """Return whether furniture is of the kind, and in the room, that was said, if any was."""
    if place is None:
        return not said.place_types and not said.room
    kind = not said.place_types or place.place_type in said.place_types
    return kind and (not said.room or said.room in (place.room_kind, place.room))
