"""Map the names in a model's answer to AI2-THOR object types."""

import re
from collections.abc import Callable, Collection, Mapping

from karma.household.saying import plural_of, spoken
from karma.household.types import object_types
from karma.household.uses import BIN, BURNER, FAUCET, LAMPS
from karma.types.roles import Embedder
from karma.types.space import Vectors

_GROUPS: Mapping[str, tuple[str, ...]] = {
    "lamp": LAMPS,
    "light": (*LAMPS, "LightSwitch"),
    "table": ("DiningTable", "CoffeeTable", "SideTable"),
    "counter": ("CounterTop",),
    "bin": (BIN,),
    "trash": (BIN,),
    "keys": ("KeyChain",),
    "tap": (FAUCET,),
    "phone": ("CellPhone",),
    "salt": ("SaltShaker",),
    "pepper": ("PepperShaker",),
    "burner": (BURNER,),
    "stove": (BURNER,),
    "couch": ("Sofa",),
    "tv": ("Television",),
    "remote": ("RemoteControl",),
    "sponge": ("DishSponge",),
    "wine": ("WineBottle",),
}
"""What people call several types, or one whose name is longer."""

MIN_SIMILARITY = 0.6  # cosine of a name and a type's words, for them to mean the same

Similar = Callable[[str, Collection[str]], tuple[str, float]]
"""Returns the nearest of some texts, and its cosine similarity."""


def nearest_text(embedder: Embedder | None) -> Similar | None:
    """Return a nearest-text search by an embedder, or None without an embedder."""
    if embedder is None:
        return None
    kept: dict[tuple[str, ...], Vectors] = {}

    def similar(text: str, others: Collection[str]) -> tuple[str, float]:
        key = tuple(others)
        if key not in kept:
            kept[key] = embedder.embed(key)
        cosines = kept[key] @ embedder.embed([text])[0]
        best = int(cosines.argmax())
        return key[best], float(cosines[best])

    return similar


def types_named(name: str, similar: Similar | None = None) -> tuple[str, ...]:
    """Return the object types that a name means, () if it means none.

    A name that is no type's is looked up in a short list, then by similarity.

    >>> types_named("coffee_table"), types_named("Mugs"), types_named("Couch")
    (('CoffeeTable',), ('Mug',), ('Sofa',))
    """
    key = _key(name)
    kinds = {_key(kind): kind for kind in object_types()}
    plurals = {_key(plural_of(spoken(kind))): kind for kind in object_types()}
    if key in kinds or key in plurals:
        return (kinds.get(key) or plurals[key],)
    for group in (key, key.removesuffix("s")):
        if group in _GROUPS:
            return _GROUPS[group]
    if similar is None:
        return ()
    words = {spoken(kind): kind for kind in object_types()}
    nearest, cosine = similar(_spaced(name), words)
    return (words[nearest],) if cosine >= MIN_SIMILARITY else ()


def _key(name: str) -> str:
    return re.sub(r"[^a-z]", "", name.lower())


def _spaced(name: str) -> str:
    return re.sub(r"(?<=[a-z])(?=[A-Z])|_", " ", name).lower()
