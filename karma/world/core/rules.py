"""Read the rule table: what the household does by itself, and the measures it goes by."""

from functools import cache
from pathlib import Path
from typing import Literal

import msgspec
from msgspec import UNSET, Struct, UnsetType

from karma.files import read_toml
from karma.household.types import Capability
from karma.world.core.scene import SceneObject, Temperature

TABLE = Path(__file__).with_name("rules.toml")


class StateValues(Struct, frozen=True, forbid_unknown_fields=True):
    """Some states of an object: those to have, or those to get."""

    is_toggled: bool | UnsetType = UNSET
    is_broken: bool | UnsetType = UNSET
    is_filled: bool | UnsetType = UNSET
    liquid: str | UnsetType = UNSET
    is_dirty: bool | UnsetType = UNSET
    is_cooked: bool | UnsetType = UNSET
    temperature: Temperature | UnsetType = UNSET

    def items(self) -> tuple[tuple[str, bool | str], ...]:
        """Return the states that are given, as (field of SceneObject, value)."""
        return _given(self)

    def holds(self, thing: SceneObject) -> bool:
        """Return whether the object has all of them."""
        return all(getattr(thing, key) == value for key, value in self.items())


@cache
def _given(condition: StateValues) -> tuple[tuple[str, bool | str], ...]:
    values = msgspec.structs.asdict(condition)
    return tuple((key, value) for key, value in values.items() if value is not UNSET)


STATES = StateValues.__struct_fields__  # what effects ask for and change


class Effect(Struct, frozen=True, forbid_unknown_fields=True):
    """One contextual effect: what a source does to what is in its zone."""

    name: str
    source: tuple[str, ...]
    zone: Literal["inside", "basin"]
    set: StateValues
    on: bool = True  # only while the source is switched on
    target: tuple[str, ...] | None = None  # types; None = all
    capability: Capability | None = None
    when: StateValues = StateValues()

    def fits(self, thing: SceneObject) -> bool:
        """Return whether the effect acts on an object in its zone."""
        return (
            (self.target is None or thing.type in self.target)
            and (self.capability is None or self.capability in thing.capabilities)
            and self.when.holds(thing)
        )


class Time(Struct, frozen=True, forbid_unknown_fields=True):
    """Seconds of world time."""

    action_s: float
    fall_s: float
    decay_s: float


class Toggle(Struct, frozen=True, forbid_unknown_fields=True):
    """Types whose switch and door depend on each other."""

    must_be_closed_to_turn_on: tuple[str, ...]
    must_be_off_to_open: tuple[str, ...]
    controlled_only: tuple[str, ...]


class HandlingRules(Struct, frozen=True, forbid_unknown_fields=True):
    """How far a thrown thing gets, what spills, and what vessels may be filled with."""

    m_per_n: float
    longest_m: float
    spills_deg: float
    liquids: tuple[str, ...]


class Fragile(Struct, frozen=True, forbid_unknown_fields=True):
    """What breaks things."""

    impulse_ns: float
    soft_ns: float
    impulse_per_force_s: float
    fall_share: float
    stays_whole: tuple[str, ...]
    soft: tuple[str, ...]
    harmless: tuple[str, ...]


class Put(Struct, frozen=True, forbid_unknown_fields=True):
    """Where things come to lie."""

    floor_reach_m: float
    surface_reach_m: float
    anywhere: tuple[str, ...]
    inside: tuple[str, ...]
    open_top: tuple[str, ...]


class Doors(Struct, frozen=True, forbid_unknown_fields=True):
    """What an open door adds to the box that metadata gives."""

    swing: tuple[str, ...]
    reach_share: float


class HidingRules(Struct, frozen=True, forbid_unknown_fields=True):
    """What hides what."""

    hides_when_closed: tuple[str, ...]
    see_through: tuple[str, ...]
    never: tuple[str, ...]
    solid: dict[str, tuple[float, float]]
    filled: dict[str, tuple[tuple[float, ...], ...]]


class Rules(Struct, frozen=True, forbid_unknown_fields=True):
    """The whole table."""

    time: Time
    toggle: Toggle
    handling: HandlingRules
    fragile: Fragile
    put: Put
    doors: Doors
    view: HidingRules
    effect: tuple[Effect, ...]


@cache
def rules() -> Rules:
    """Return the rule table, read once."""
    return read_toml(TABLE, Rules)
