"""How things and places are said to people: "the mug is in the sink", from types and ids."""

from karma.household.ids import type_of
from karma.household.pieces import base_type
from karma.household.places import HAND
from karma.household.types import object_types, words_of
from karma.household.uses import BASINS, SINK, without_basin

_LIDDED = ("Toilet",)  # it opens, but things are put on it
_HOLLOW = frozenset(
    (
        SINK, *BASINS, "Bathtub", "GarbageCan", "Bowl", "Mug", "Cup", "Pot", "WateringCan",
        "Toaster", "CoffeeMachine",
    )
)  # fmt: skip


def name_of(name: str) -> str:
    """Return what people call a thing, from its id or type.

    >>> name_of("CounterTop|+01.00|+00.90|-02.00"), name_of("Sink|1|2|3|SinkBasin")
    ('counter top', 'sink')
    """
    return spoken(without_basin(base_type(type_of(name))))


def spoken(kind: str) -> str:
    """Return a type as words.

    >>> spoken("CounterTop"), spoken("CellPhone"), spoken("TVStand")
    ('counter top', 'cell phone', 'TV stand')
    """
    words = words_of(kind).split(" ")
    return " ".join(one if one.isupper() and len(one) > 1 else one.lower() for one in words)


def preposition(place: str) -> str:
    """Return "in" or "on", as it is said of a receptacle.

    >>> preposition("Fridge"), preposition("CounterTop"), preposition("Sink"), preposition("Plate")
    ('in', 'on', 'in', 'on')
    """
    name = type_of(place)
    kind = object_types().get(name)
    if name in _LIDDED:
        return "on"
    return "in" if name in _HOLLOW or (kind is not None and kind.can("openable")) else "on"


def told_place(place_id: str | None) -> str:
    """Return where a thing is, in words.

    >>> told_place("hand"), told_place(None), told_place("Fridge|1|2|3")
    ('in the hand', 'somewhere', 'in the fridge')
    """
    if place_id is None:
        return "somewhere"
    return f"{preposition(place_id)} the {name_of(place_id)}" if place_id != HAND else "in the hand"


def with_article(words: str) -> str:
    """Return a name with its indefinite article.

    >>> with_article("apple"), with_article("Mug")
    ('an apple', 'a Mug')
    """
    return f"{'an' if words[:1].lower() in 'aeiou' else 'a'} {words}"


def plural_of(word: str) -> str:
    """Return the plural of a name.

    >>> plural_of("butter knife"), plural_of("box"), plural_of("potato"), plural_of("loaf of bread")
    ('butter knives', 'boxes', 'potatoes', 'loaves of bread')
    """
    word, of, rest = word.partition(" of ")
    return _plural(word) + of + rest


def _plural(word: str) -> str:
    if word.endswith(("knife", "loaf")):
        return word.removesuffix("fe").removesuffix("f") + "ves"
    if word.endswith(("ss", "x", "ch", "sh", "tomato", "potato")):
        return f"{word}es"
    if word.endswith("s"):
        return word
    if word.endswith("y") and word[-2] not in "aeiou":
        return f"{word[:-1]}ies"
    return f"{word}s"
