"""What the household does by itself: the rule table, and applying it until nothing changes."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import msgspec
from msgspec import UNSET, Struct, UnsetType

from karma.files import read_toml
from karma.household.types import Capability
from karma.world.core.scene import SceneObject, Temperature

if TYPE_CHECKING:
    from karma.world.core.objects import Objects
    from karma.world.core.state import WorldState

TABLE = Path(__file__).with_name("rules.toml")
_BASINS = (("SinkBasin", "BathtubBasin"), ("Sink", "Bathtub"))


class Condition(Struct, frozen=True, forbid_unknown_fields=True):
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
def _given(condition: Condition) -> tuple[tuple[str, bool | str], ...]:
    values = msgspec.structs.asdict(condition)
    return tuple((key, value) for key, value in values.items() if value is not UNSET)


STATES = Condition.__struct_fields__  # what effects ask for and change


class Effect(Struct, frozen=True, forbid_unknown_fields=True):
    """One contextual effect: what a source does to what is in its zone."""

    name: str
    source: tuple[str, ...]
    zone: Literal["inside", "basin"]
    set: Condition
    on: bool = True  # only while the source is switched on
    target: tuple[str, ...] | None = None  # types; None = all
    capability: Capability | None = None
    when: Condition = Condition()

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


class Flight(Struct, frozen=True, forbid_unknown_fields=True):
    """How far a thrown thing gets."""

    m_per_n: float
    longest_m: float


class Fragile(Struct, frozen=True, forbid_unknown_fields=True):
    """What breaks things."""

    impulse_ns: float
    soft_ns: float
    impulse_per_force_s: float
    fall_share: float
    stays_whole: tuple[str, ...]
    soft: tuple[str, ...]
    harmless: tuple[str, ...]


class Liquids(Struct, frozen=True, forbid_unknown_fields=True):
    """What a vessel may be filled with, and where water runs."""

    known: tuple[str, ...]
    basin_reach_m: float


class Hand(Struct, frozen=True, forbid_unknown_fields=True):
    """What comes along with what is picked up."""

    spills_deg: float


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


class View(Struct, frozen=True, forbid_unknown_fields=True):
    """What hides what."""

    hides_when_closed: tuple[str, ...]
    see_through: tuple[str, ...]
    never: tuple[str, ...]
    solid: dict[str, tuple[float, float]]


class Rules(Struct, frozen=True, forbid_unknown_fields=True):
    """The whole table."""

    time: Time
    toggle: Toggle
    flight: Flight
    fragile: Fragile
    liquids: Liquids
    hand: Hand
    put: Put
    doors: Doors
    view: View
    effect: tuple[Effect, ...]


@cache
def rules() -> Rules:
    """Return the rule table, read once."""
    return read_toml(TABLE, Rules)


class Effects(NamedTuple):
    """One round of the rule table over the objects of a moment."""

    changes: dict[str, SceneObject]  # what it makes of those that it changes
    kept: frozenset[str]  # whose temperature a zone keeps up
    fading: tuple[str, ...]  # hot or cold, and in no zone: furniture stays as it is


def settle(state: "WorldState") -> "WorldState":
    """Return the state after all effects, and after heat and cold that ran out.

    Effects are idempotent, so the loop ends; the bound only guards against a bad table.
    """
    for _ in range(len(rules().effect) + 1):
        changes = state.objects.effects.changes
        if not changes:
            break
        state = replace(state, objects=state.objects.changed(changes))
    fading = state.objects.effects.fading
    return _decay(state, fading) if fading or state.until_s else state


def effects(objects: "Objects") -> Effects:
    """Return what the household does to these objects by itself, in one round."""
    changes: dict[str, SceneObject] = {}
    kept: set[str] = set()
    for effect in rules().effect:
        for source in _sources(objects, effect):
            for target in _zone(objects, effect, source):
                thing = changes.get(target, objects[target])
                if not effect.fits(thing):
                    continue
                if effect.set.temperature is not UNSET:
                    kept.add(target)
                if not effect.set.holds(thing):
                    changes[target] = msgspec.structs.replace(thing, **dict(effect.set.items()))
    fading = (
        object_id
        for object_id, thing in objects.items()
        if thing.temperature != "RoomTemp"
        and object_id not in kept
        and "pickupable" in thing.capabilities
    )
    changes = {key: thing for key, thing in changes.items() if thing != objects[key]}
    return Effects(changes, frozenset(kept), tuple(fading))


def _sources(objects: "Objects", effect: Effect) -> Iterator[str]:
    for kind in effect.source:
        for object_id in objects.by_type.get(kind, ()):
            thing = objects[object_id]
            if (thing.is_toggled or not effect.on) and not thing.is_broken:
                yield object_id


def _zone(objects: "Objects", effect: Effect, source: str) -> tuple[str, ...]:
    if effect.zone == "inside":
        return objects.inside(source)
    basin = basin_under(objects, source)
    return () if basin is None else objects.inside(basin)


def basin_under(objects: "Objects", source: str) -> str | None:
    """Return the nearest basin a faucet or shower head pours into; basins before sinks."""
    x, y, z = objects[source].center
    for kinds in _BASINS:
        found: list[tuple[float, str]] = []
        for kind in kinds:
            for object_id in objects.by_type.get(kind, ()):
                thing = objects[object_id]
                across = max(abs(x - thing.center[0]) - thing.size[0] / 2, 0.0)
                along = max(abs(z - thing.center[2]) - thing.size[2] / 2, 0.0)
                far = math.hypot(across, along)
                if far <= rules().liquids.basin_reach_m and thing.center[1] <= y + 0.1:
                    found.append((far, object_id))
        if found:
            return min(found)[1]
    return None


def _decay(state: "WorldState", fading: tuple[str, ...]) -> "WorldState":
    """Let heat and cold outside any zone run out."""
    until: dict[str, float] = {}
    changes: dict[str, SceneObject] = {}
    for object_id in fading:
        end = state.until_s.get(object_id, state.time_s + state.decay_s)
        if end <= state.time_s:
            thing = state.objects[object_id]
            changes[object_id] = msgspec.structs.replace(thing, temperature="RoomTemp")
        else:
            until[object_id] = end
    if not changes and until == state.until_s:
        return state
    return replace(state, objects=state.objects.changed(changes), until_s=until)
