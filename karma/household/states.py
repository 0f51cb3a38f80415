"""State words: how goals write them, what they ask of a type, which end one another."""

from collections.abc import Mapping
from types import MappingProxyType

from karma.household.types import Capability

GOAL_STATES = frozenset(
    (
        "dirty", "cooked", "broken", "filled", "used up", "on", "off", "opened", "closed",
        "cleaned", "sliced", "heated", "cooled", "empty",
    )
)  # fmt: skip
NEEDS: Mapping[str, Capability] = MappingProxyType(
    {
        "sliced": "sliceable", "cooked": "cookable", "filled": "canFillWithLiquid",
        "broken": "breakable", "opened": "openable", "closed": "openable", "on": "toggleable",
        "off": "toggleable", "dirty": "dirtyable", "used up": "canBeUsedUp",
    }
)  # what a type must be capable of to be in a state  # fmt: skip
STATE_WORDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "cleaned": ("clean", "cleaned", "washed", "rinsed", "wet"),
        "sliced": ("sliced", "cut", "chopped"),
        "cooked": ("cooked", "done"),
        "heated": ("hot", "heated", "warm", "warmed"),
        "dirty": ("dirty", "unwashed"),
        "filled": ("filled", "full"),
        "opened": ("open", "opened"),
        "closed": ("closed", "shut"),
        "off": ("off",),
        "on": ("lit", "running"),
        "used up": ("empty",),
    }
)  # what people say when they mean a thing by its state; wider than what goals may say
_SYNONYMS = {
    "clean": "cleaned", "washed": "cleaned", "rinsed": "cleaned", "chopped": "sliced",
    "cut": "sliced", "hot": "heated", "warm": "heated", "cold": "cooled", "chilled": "cooled",
    "open": "opened", "close": "closed", "usedup": "used up",
}  # fmt: skip


def canonical_state(word: str) -> str | None:
    """Return the state that a goal's word means, None if it means none.

    >>> canonical_state("washed"), canonical_state("Used  Up"), canonical_state("sofa")
    ('cleaned', 'used up', None)
    """
    word = " ".join(word.lower().split())
    word = _SYNONYMS.get(word, word)
    return word if word in GOAL_STATES else None


_PAIRS = (("opened", "closed"), ("on", "off"), ("dirty", "cleaned"))
OPPOSITES: Mapping[str, str] = MappingProxyType(
    {one: other for a, b in _PAIRS for one, other in ((a, b), (b, a))}
)  # a state ends when its opposite comes
DOOR_AFTER: Mapping[str, str] = MappingProxyType({"OpenObject": "opened", "CloseObject": "closed"})
END_STATES: Mapping[str, str] = MappingProxyType(
    {"TOGGLEON": "on", "TOGGLEOFF": "off", "OPEN": "opened", "CLOSED": "closed"}
)  # what a predicate of a goal asks for
