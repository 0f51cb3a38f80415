"""What an agent may remember: rooms to be in, and short-term memories drawn for them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from karma.contracts import Area, MemoryUnit
from karma.household.ids import type_of
from karma.household.pieces import EGG, base_type
from karma.household.places import HAND, SEVERAL, landmark_types
from karma.household.states import OPPOSITES
from karma.household.types import ObjectType, object_types
from karma.household.uses import COOKED, TOASTED
from karma.language.lexemes import lexicon

Rng = np.random.Generator
T = TypeVar("T")
CAPACITY = 10
STATES_BY_CAPABILITY = {
    "dirtyable": (("dirty", 0.15), ("cleaned", 0.3)),
    "canFillWithLiquid": (("filled", 0.15),),
    "openable": (("opened", 0.2), ("closed", 0.2)),
    "toggleable": (("on", 0.15), ("off", 0.15)),
    "canBeUsedUp": (("used up", 0.1),),
}
FOOD_STATES = (("cleaned", 0.35), ("sliced", 0.35), ("heated", 0.08), ("cooked", 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownRoom:
    """What a request can be about: area nodes and the types of the movable things around."""

    name: str
    areas: tuple[Area, ...]
    movables: tuple[str, ...]
    several: tuple[str, ...] = ()  # those of which there are two or more

    @property
    def landmarks(self) -> tuple[str, ...]:
        """Return the immovable types worth a word, sorted."""
        return tuple(sorted({k for a in self.areas for k in a.contains} & landmark_types()))


def pick(rng: Rng, items: Sequence[T]) -> T:
    """Draw one item; `rng.choice` would copy the sequence into an array each time."""
    return items[int(rng.integers(len(items)))]


def weighted(rng: Rng, odds: Mapping[str, float]) -> str:
    """Draw a key by its weight."""
    roll = rng.random() * sum(odds.values())
    for name, weight in odds.items():
        roll -= weight
        if roll < 0:
            return name
    return list(odds)[-1]


def draw_units(rng: Rng, room: KnownRoom) -> tuple[tuple[MemoryUnit, ...], MemoryUnit | None]:
    """Draw a short-term memory, the last used last, and what is in the hand, if anything."""
    count = 0 if rng.random() < 0.15 else int(1 + CAPACITY * rng.random() ** 1.5)
    pool = [kind for kind in room.movables if kind in lexicon()]
    if not pool:
        return (), None
    units: list[MemoryUnit] = []
    for number in range(count):
        kind = pick(rng, pool)
        if any(base_type(u.object_type) == kind for u in units) and rng.random() < 0.6:
            continue
        late = number / max(count, 1)
        handled = bool(rng.random() < 0.25 + 0.6 * late)
        units.append(draw_unit(rng, room, kind, number, units, handled=handled))
    held = None
    if units and rng.random() < 0.17:
        held = replace(units[-1], place_id=HAND, handled=True)
        units[-1] = held
    return tuple(units), held


def draw_unit(
    rng: Rng,
    room: KnownRoom,
    kind: str,
    number: int,
    others: Sequence[MemoryUnit],
    *,
    handled: bool,
) -> MemoryUnit:
    """Draw the state and the place of a remembered thing.

    Args:
        rng: of the draw.
        room: where.
        kind: its type, whole.
        number: tells its id from those of the others.
        others: remembered before it; they may carry it.
        handled: what was handled has more states.
    """
    info = object_types()[kind]
    odds = FOOD_STATES if info.slices_into or kind == EGG else ()
    for capability, more in STATES_BY_CAPABILITY.items():
        if capability in info.capabilities:
            odds = (*odds, *more)
    states: list[str] = []
    for state, chance in odds:
        chance = 0.2 if state == "cooked" and kind in (*COOKED, TOASTED) else chance
        if rng.random() < chance * (1.0 if handled else 0.4) and OPPOSITES.get(state) not in states:
            states.append(state)
    if "sliced" in states and not info.slices_into:
        states.remove("sliced")
    rng.shuffle(states)
    sliced = info.slices_into if "sliced" in states and info.slices_into else kind
    return MemoryUnit(
        object_id=f"{kind}|{number}",
        object_type=sliced,
        position_m=(0.0, 0.0, 0.0),
        states=tuple(states),
        place_id=_draw_place(rng, room, object_types()[sliced], others),
        handled=handled,
    )


def _draw_place(
    rng: Rng, room: KnownRoom, info: ObjectType, others: Sequence[MemoryUnit]
) -> str | None:
    fitting = [name for name in room.landmarks if info.fits(object_types()[name])]
    carriers = [
        unit.object_id
        for unit in others
        if unit.place_id != HAND and info.fits(object_types()[unit.object_type])
    ]
    if carriers and rng.random() < 0.15:
        return pick(rng, carriers)
    if not fitting or rng.random() < 0.04:
        return None
    name = pick(rng, fitting)
    return f"{name}|{int(rng.integers(1, 4)) if name in SEVERAL else 1}"


def place_type(units: Sequence[MemoryUnit], place: str) -> str:
    """Return the type of a place: a remembered unit's, or the one its id speaks of."""
    return next((u.object_type for u in units if u.object_id == place), type_of(place))
