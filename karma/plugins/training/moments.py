"""Views of rooms with random states from random viewpoints.

States of objects (open, on, dirty, filled, used up, cooked, heated, sliced, broken) are random; the
agent stands near an object and looks at it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from karma.agent.seeing.perceive import camera_of, truth_of
from karma.agent.seeing.projection import placed
from karma.household.pieces import EGG
from karma.household.places import FLOOR
from karma.household.uses import BURNER, KNOB, MICROWAVE
from karma.plugins.rooms.generate import build_scene
from karma.seeds import stream
from karma.types.observation import SeenObject, TrueObject
from karma.world.core.scene import Scene, SceneObject
from karma.world.event import WorldEvent
from karma.world.sim import EmbeddedWorld

KINDS = ("kitchen", "kitchen", "kitchen", "living", "bedroom", "bathroom")  # kitchens have most
HORIZONS_DEG = (-30.0, 0.0, 30.0, 60.0)
LEAST_PIXELS = 64  # of an object in a picture, to be asked about
HELD = 0.25  # share of views with something in the hand
SPAWNED = 0.4  # share of moments in which things lie elsewhere than at the room's start
FREE = 0.15  # share of views that are turned to nothing in particular

_NOWHERE = (0.0, 0.0, 0.0)
_Lot = np.random.Generator
_ODDS = {"openable": 0.5, "toggleable": 0.5, "dirtyable": 0.45, "canFillWithLiquid": 0.45,
         "canBeUsedUp": 0.45, "cookable": 0.35, "breakable": 0.04}  # fmt: skip
_LIQUIDS = ("water", "water", "coffee", "wine")
_BARE = 0.3  # share kept of objects whose type knows no state at all


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """An object in a frame and its visible states."""

    seen: SeenObject  # what a model may know of it: neither states nor places
    pixels: int  # of the picture that show it
    states: tuple[str, ...]  # sorted words; ("none",) when there is nothing to say


def room(seed: int, number: int) -> Scene:
    """Return the room of that number, drawn from a seed."""
    return build_scene(KINDS[number % len(KINDS)], number + 1, seed)


def moments(scene: Scene, rng: _Lot, *, states: int, views: int) -> Iterator[WorldEvent]:
    """Yield events of a room for questions about their frames.

    `states` random states of the room, each seen from `views` viewpoints.
    """
    for _ in range(states):
        world = EmbeddedWorld(_dealt(scene, rng))
        held = round(views * HELD)
        for number in range(views):
            if number == views - held:
                _pick_up(world, rng)
            yield _look(world, np.array(scene.reachable), rng)


def samples(event: WorldEvent) -> list[Sample]:
    """Return the objects in view or in the hand that show enough pixels."""
    rows = event.picture.rows
    counts = np.bincount(rows[rows >= 0], minlength=len(event.state.objects))
    shown = dict(zip(event.state.objects, counts.tolist(), strict=True))
    truth, camera = truth_of(event), camera_of(event)
    found = []
    for thing in truth.objects:
        pixels = shown[thing.object_id]
        if not (thing.visible or thing.object_id in truth.held_ids) or pixels < LEAST_PIXELS:
            continue
        shown_at = placed(thing, camera)
        if shown_at.region is not None:
            seen = SeenObject(
                object_id=shown_at.object_id, object_type=shown_at.object_type,
                region=shown_at.region,
                silhouette=shown_at.silhouette, pickupable=False, position_m=_NOWHERE,
                box_center_m=_NOWHERE, box_size_m=_NOWHERE,
            )  # fmt: skip
            found.append(Sample(seen=seen, pixels=pixels, states=shown_states(thing)))
    return found


def thinned(found: Sequence[Sample], rng: _Lot) -> list[Sample]:
    """Leave out most objects whose types never show a state."""
    return [sample for sample in found if sample.states != ("none",) or rng.random() < _BARE]


# ------------------------------------------------------------------ states by lot


def _dealt(scene: Scene, rng: _Lot) -> Scene:
    world = EmbeddedWorld(scene)
    if rng.random() < SPAWNED:
        world.step("InitialRandomSpawn", randomSeed=int(rng.integers(1 << 30)), forceVisible=False)
    for thing in list(world.state.objects.values()):
        if "sliceable" in thing.capabilities and rng.random() < 0.4:
            world.step("SliceObject", objectId=thing.id, forceAction=True)
        elif thing.type == EGG and rng.random() < 0.4:
            world.step("BreakObject", objectId=thing.id, forceAction=True)
    things = {thing.id: _changed(thing, rng) for thing in world.state.objects.values()}
    for thing in list(things.values()):
        for name in thing.controls:
            if thing.type == KNOB and name in things:
                on = thing.is_toggled
                things[name] = msgspec.structs.replace(things[name], is_toggled=on)
    return msgspec.structs.replace(scene, objects=tuple(things.values()))


def _changed(thing: SceneObject, rng: _Lot) -> SceneObject:
    """Return an object in a random state."""
    happens = {name: bool(rng.random() < odds) for name, odds in _ODDS.items()}
    has = {name for name, does in happens.items() if does and name in thing.capabilities}
    level, heat, liquid = rng.random(), rng.random(), str(rng.choice(_LIQUIDS))
    new: dict[str, Any] = {}
    if "openable" in thing.capabilities:
        new["openness"] = 0.0 if "openable" not in has else 1.0 if level < 0.9 else 4 * level - 3
    if "toggleable" in thing.capabilities:
        new["is_toggled"] = "toggleable" in has and not _unseen_if_on(thing.type, new)
        if thing.type == "LightSwitch":
            new["is_toggled"] = bool(level < 0.75)
    if "canFillWithLiquid" in thing.capabilities:
        filled = "canFillWithLiquid" in has
        new |= {"is_filled": filled, "liquid": liquid if filled else None}
    for name, field in (("dirtyable", "is_dirty"), ("canBeUsedUp", "is_used_up"),
                        ("cookable", "is_cooked")):  # fmt: skip
        if name in thing.capabilities:
            new[field] = name in has
    if "breakable" in has and thing.type != EGG:
        new["is_broken"] = True
    if "pickupable" in thing.capabilities and thing.temperature == "RoomTemp" and heat < 0.25:
        new |= {"temperature": "Hot" if heat < 0.18 else "Cold", "heat_left_s": 1000.0}
    return msgspec.structs.replace(thing, **new)


def _unseen_if_on(kind: str, new: dict[str, Any]) -> bool:
    """Return whether switching on makes no sense: an open microwave, a laptop that is shut."""
    is_open = new.get("openness", 0.0) > 0
    return (kind == MICROWAVE and is_open) or (kind == "Laptop" and not is_open)


# ------------------------------------------------------------------ viewpoints


def _pick_up(world: EmbeddedWorld, rng: _Lot) -> None:
    ids = [t.object_id for t in truth_of(world.last_event).objects if t.pickupable]
    if ids:
        chosen = ids[int(rng.integers(len(ids)))]
        world.step("PickupObject", objectId=chosen, forceAction=True)


def _look(world: EmbeddedWorld, cells: np.ndarray, rng: _Lot) -> WorldEvent:
    """Stand near something, mostly turned to it as the agent would be, and look."""
    state = world.state
    things = [t for t in state.objects.values() if t.type != FLOOR]
    weights = np.array([1.0 if _tells(t) else 0.15 for t in things])
    thing = things[int(rng.choice(len(things), p=weights / weights.sum()))]
    x, y, z = thing.center
    gaps = np.hypot(cells[:, 0] - x, cells[:, 1] - z)
    near = np.flatnonzero(gaps < max(1.45, gaps.min() + 0.01))
    cell = cells[int(rng.choice(near))]
    bearing = math.degrees(math.atan2(x - cell[0], z - cell[1]))
    dip = math.degrees(math.atan2(1.575 - y, math.hypot(x - cell[0], z - cell[1])))
    yaw = round(bearing / 90) * 90.0
    horizon = min(HORIZONS_DEG, key=lambda h: abs(h - dip))
    lot = rng.random()
    if lot < FREE:
        yaw, horizon = float(rng.integers(4) * 90), float(rng.choice(HORIZONS_DEG))
    elif lot < 2 * FREE:
        yaw = bearing + float(rng.normal(0, 20))
        horizon = float(np.clip(dip + rng.normal(0, 10), -30, 60))
    world.step(
        "TeleportFull",
        position={"x": float(cell[0]), "y": state.pose.position_m[1], "z": float(cell[1])},
        rotation={"x": 0.0, "y": yaw % 360, "z": 0.0},
        horizon=horizon,
        standing=True,
        forceAction=True,
    )
    return world.last_event


def _tells(thing: SceneObject) -> bool:
    """Return whether an object can be in any state that has a word."""
    telling = (set(_ODDS) - {"breakable"}) & set(thing.capabilities)
    return bool(telling) or thing.type == BURNER


def generator(seed: int, *use: str) -> _Lot:
    """Return the random stream of a use."""
    return stream(seed, "vision", *use)


def shown_states(thing: TrueObject) -> tuple[str, ...]:
    """Return the words that a picture of an object can tell, sorted; ("none",) for none.

    Those of its sight, and "cleaned" for what can be dirty and is not.
    """
    words = set(thing.states)
    if thing.dirtyable and "dirty" not in words:
        words.add("cleaned")
    return tuple(sorted(words or {"none"}))
