"""State words: how goals write them, what they ask of a type, which end one another.

Deeds and states are two things. "cleaned", "heated" and "cooled" say what was done to a thing, for
ever, as ALFRED judges it; "clean", "hot" and "cold" how it is now.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

import msgspec

from karma.files import read_toml
from karma.household.types import Capability

GOAL_STATES = frozenset(
    (
        "dirty", "cooked", "broken", "filled", "used up", "on", "off", "opened", "closed",
        "cleaned", "sliced", "heated", "cooled", "empty", "clean", "hot", "cold", "shining",
    )
)  # fmt: skip
DONE_BY: Mapping[str, str] = MappingProxyType(
    {"clean": "cleaned", "hot": "heated", "cold": "cooled", "shining": "on"}
)  # what is to be done to a thing for it to be so; "shining" is on and in view
SAID_AS: Mapping[str, str] = MappingProxyType(
    {"cleaned": "clean", "heated": "hot", "cooled": "cold", "opened": "open"}
)  # as people are told
NEEDS: Mapping[str, Capability] = MappingProxyType(
    {
        "sliced": "sliceable", "cooked": "cookable", "filled": "canFillWithLiquid",
        "broken": "breakable", "opened": "openable", "closed": "openable", "on": "toggleable",
        "off": "toggleable", "dirty": "dirtyable", "used up": "canBeUsedUp",
    }
)  # what a type must be capable of to be in a state  # fmt: skip
ALIKE: Mapping[str, str] = MappingProxyType({"heated": "cooked", "cooked": "heated"})
# what people may call by the other's words: a potato from the microwave is hot
_SYNONYMS = {
    "washed": "cleaned", "rinsed": "cleaned", "chopped": "sliced", "cut": "sliced", "warm": "hot",
    "warmed": "heated", "chilled": "cooled", "open": "opened", "close": "closed",
    "usedup": "used up",
}  # fmt: skip


class StateWords(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """State -> words for things that are in it, and for things that are not."""

    has: Mapping[str, tuple[str, ...]]
    lacks: Mapping[str, tuple[str, ...]]


@cache
def state_words() -> StateWords:
    """Return what people say of states, read once from `states.toml`."""
    return read_toml(Path(__file__).with_name("states.toml"), StateWords)


def canonical_state(word: str) -> str | None:
    """Return the state that a goal's word means, None if it means none.

    >>> canonical_state("washed"), canonical_state("Used  Up"), canonical_state("sofa")
    ('cleaned', 'used up', None)
    """
    word = " ".join(word.lower().split())
    word = _SYNONYMS.get(word, word)
    return word if word in GOAL_STATES else None


def deed_for(word: str) -> str | None:
    """Return what is to be done for a goal's word to hold; None if it means no state.

    >>> deed_for("hot"), deed_for("warmed"), deed_for("open"), deed_for("sofa")
    ('heated', 'heated', 'opened', None)
    """
    state = canonical_state(word)
    return DONE_BY.get(state, state) if state else None


def lacking(state: str) -> str:
    """Return the state of a thing that is not in one; "" where nothing is called so.

    >>> lacking("dirty"), lacking("clean"), lacking("off"), lacking("hot")
    ('clean', 'dirty', 'on', '')
    """
    return NOT_SO.get(state) or _LACKS.get(state, "")


_PAIRS = (("opened", "closed"), ("on", "off"), ("dirty", "cleaned"))
OPPOSITES: Mapping[str, str] = MappingProxyType(
    {one: other for a, b in _PAIRS for one, other in ((a, b), (b, a))}
)  # one is so where the other is not
NOT_SO: Mapping[str, str] = MappingProxyType(
    {
        "clean": "dirty", "empty": "filled", "unbroken": "broken", "unsliced": "sliced",
        "off": "on", "closed": "opened",
    }
)  # states that are so where the other, which a look shows, is not  # fmt: skip
_LACKS = {other: one for one, other in NOT_SO.items()}
ENDS: Mapping[str, str] = MappingProxyType(
    {**OPPOSITES, "heated": "cooled", "cooled": "heated"}
)  # a state ends the other when it comes; a thing may be neither
END_STATES: Mapping[str, str] = MappingProxyType(
    {"TOGGLEON": "on", "TOGGLEOFF": "off", "OPEN": "opened", "CLOSED": "closed"}
)  # what a predicate of a goal asks for
