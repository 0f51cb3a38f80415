"""Whether a thing and a place are as a question says."""

from karma.contracts import SaidThing, Sighting
from karma.memory.lived.setting import KnownPlace

MARGIN = 0.03  # below the best meaning, within which another type may be meant as well


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
