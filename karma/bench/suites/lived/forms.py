"""Words of requests: sentences and verbs of `forms.toml`, names of things and places."""

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from karma.bench.suites.lived.request import Words
from karma.files import read_toml
from karma.household.places import ON_TOP
from karma.household.types import in_words
from karma.language.lexemes import lexicon, pick_common, types_called, unseen_lexicon
from karma.memory.lived.setting import KnownPlace

FORMS = Path(__file__).with_name("forms.toml")


class _FormsOfKind(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    forms: tuple[str, ...]


class RequestForms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of `forms.toml`."""

    place: _FormsOfKind
    errand: _FormsOfKind
    place_then: _FormsOfKind
    time: _FormsOfKind
    who: _FormsOfKind
    count: _FormsOfKind
    did: Mapping[str, tuple[str, ...]]  # action -> verbs, past
    do: Mapping[str, tuple[str, ...]]  # action -> verbs, after "did"


@cache
def request_forms() -> RequestForms:
    """Return the table, read once."""
    return read_toml(FORMS, RequestForms)


def thing_word(
    object_type: str, present: Iterable[str], rng: np.random.Generator, *, words: Words
) -> str | None:
    """Return a word for a type that fits no other type of the home; None if there is none."""
    if words == "plain":
        return in_words(object_type)
    table = unseen_lexicon() if words == "held-out" else lexicon()
    entry = table.get(object_type)
    if entry is None:
        return in_words(object_type)
    others = set(present) - {object_type}
    names = tuple(
        one
        for one in entry.names
        if not others & set(types_called(one)) and not one.startswith("the ")
    )
    return pick_common(rng, names) if names else None


def place_phrase(place: KnownPlace, places: Mapping[str, KnownPlace]) -> str:
    """Return a place as people say it: its kind, and its room where others have one too.

    >>> here = KnownPlace(place_id="a", place_type="CoffeeTable", room="living_1",
    ...     room_kind="living", openable=False)
    >>> place_phrase(here, {"a": here})
    'on the coffee table'
    """
    return f"{'on' if place.place_type in ON_TOP else 'in'} the {_called(place, places)}"


def _called(place: KnownPlace, places: Mapping[str, KnownPlace]) -> str:
    name = in_words(place.place_type)
    rooms = {one.room for one in places.values() if one.place_type == place.place_type}
    if len(rooms) == 1:
        return name
    return f"{name} in the {room_phrase(place.room_kind)}"


def room_phrase(kind: str) -> str:
    """Return a kind of room as people say it."""
    return "living room" if kind == "living" else kind


def meant_by(place: KnownPlace, places: Mapping[str, KnownPlace]) -> tuple[str, ...]:
    """Return the ids of all places that its phrase may mean."""
    rooms = {one.room for one in places.values() if one.place_type == place.place_type}
    return tuple(
        one.place_id
        for one in places.values()
        if one.place_type == place.place_type
        and (len(rooms) == 1 or one.room_kind == place.room_kind)
    )
