"""Pick up, put, open and switch objects, and change their states."""

from collections.abc import Callable
from dataclasses import replace
from math import acos, cos, degrees, radians
from typing import Any

import msgspec

from karma.household.types import Capability, object_types
from karma.types.space import Vec3
from karma.world.actions.aiming import on_object, target
from karma.world.actions.moving import hang
from karma.world.core.effects import broken, in_pieces, left_behind
from karma.world.core.placement import find_place, flight, land
from karma.world.core.posing import emptied, released
from karma.world.core.rules import rules
from karma.world.core.scene import SceneObject
from karma.world.core.state import Performed, Refusal, Result, WorldState, refuse
from karma.world.core.thing import GRAVITY_MS2, bottom, heading


def tilt_deg(rotation: Vec3) -> float:
    """Return by how much Unity's angles tilt a thing away from upright.

    >>> tilt_deg((0.0, 90.0, 0.0)), round(tilt_deg((90.0, 0.0, 0.0)))
    (0.0, 90)
    """
    up = cos(radians(rotation[0])) * cos(radians(rotation[2]))
    return degrees(acos(max(-1.0, min(1.0, up))))


def changed(state: WorldState, object_id: str, **fields: Any) -> WorldState:
    """Return the state with some fields of one object replaced."""
    thing = msgspec.structs.replace(state.objects[object_id], **fields)
    return replace(state, objects=state.objects.changed({object_id: thing}))


@on_object("PickupObject")
def pick_up(state: WorldState, thing: SceneObject, *, manualInteract: bool = False) -> Result:
    """Take an object, with what lies in it."""
    if "pickupable" not in thing.capabilities:
        return refuse(
            "InvalidOperationException", f"{thing.name} must have the property pickupable"
        )
    if state.held is not None:
        message = "Agent hand has something in it already! Can't pick up anything else"
        return refuse("InvalidOperationException", message)
    return Performed(_grasped(state, thing), thing.id)


def _grasped(state: WorldState, thing: SceneObject) -> WorldState:
    upright = tilt_deg(thing.rotation) <= rules().handling.spills_deg
    carried = state.objects.carried(thing.id)
    mine = {thing.id, *carried}
    changes = {thing.id: msgspec.structs.replace(thing, parents=(), is_picked_up=True)}
    if not upright:
        changes |= left_behind(state.objects, thing)
        carried = ()
    for child in carried:
        inner = state.objects[child]
        parents = tuple(parent for parent in inner.parents if parent in mine)
        changes[child] = msgspec.structs.replace(inner, parents=parents)
    after = replace(emptied(state), objects=state.objects.changed(changes), held=thing.id)
    turn = state.pose.yaw_deg - thing.rotation[1]
    return replace(after, objects=hang(after, thing.id, turn))


def put(
    state: WorldState,
    *,
    objectId: str | None = None,
    x: float | None = None,
    y: float | None = None,
    forceAction: bool = False,
    placeStationary: bool = True,
    randomSeed: int = 0,
    putNearXY: bool = False,
) -> Result:
    """Put the held object into or onto a receptacle."""
    if state.held is None:
        return Refusal("Can't place an object if Agent isn't holding anything.")
    receptacle = target(state, "PutObject", objectId, x, y, forceAction)
    if isinstance(receptacle, Refusal):
        return receptacle
    thing = state.objects[state.held]
    refusal = _does_not_take(state, thing, receptacle, forceAction)
    if refusal is not None:
        return refusal
    place = find_place(state, thing, receptacle)
    if place is None:
        return Refusal("No valid positions to place object found")
    return Performed(released(state, place, receptacle.id))


def _does_not_take(
    state: WorldState, thing: SceneObject, receptacle: SceneObject, force: bool
) -> Refusal | None:
    """Return why a receptacle does not take a thing, whatever room there is."""
    if "receptacle" not in receptacle.capabilities or receptacle.id in state.in_hand:
        return Refusal("This target object is NOT a receptacle!")
    kind, place = object_types()[thing.type], object_types()[receptacle.type]
    if place.must_be_open and "openable" in receptacle.capabilities and receptacle.openness <= 0:
        return Refusal("Target openable Receptacle is CLOSED, can't place if target is not open!")
    fits = kind.fits(place, state.room.rules) or (
        not place.accepts_only and (force or thing.type in rules().put.anywhere)
    )
    return None if fits else Refusal(f"{thing.name} cannot be placed in {receptacle.name}")


def drop(state: WorldState, *, forceAction: bool = False, autoSimulation: bool = True) -> Result:
    """Let the held object fall."""
    return _let_go(state, 0.0)


def throw(
    state: WorldState,
    *,
    moveMagnitude: float,
    forceAction: bool = False,
    autoSimulation: bool = True,
) -> Result:
    """Throw the held object forward; moveMagnitude is a force."""
    if moveMagnitude < 0:
        return Refusal("moveMagnitude must not be negative")
    return _let_go(state, float(moveMagnitude))


def _let_go(state: WorldState, force: float) -> Result:
    if state.held is None:
        return Refusal("Nothing held in hand to drop!")
    thing, fragile = state.objects[state.held], rules().fragile
    far = min(force * rules().handling.m_per_n, rules().handling.longest_m)
    x, z = flight(state.room, thing.position, heading(state.pose.yaw_deg), far)
    middle, holder = land(state, thing, x, z)
    height = max(bottom(thing) - (middle[1] - thing.size[1] / 2), 0.0)
    impulse = force * fragile.impulse_per_force_s
    impulse += fragile.fall_share * thing.mass_kg * (2 * GRAVITY_MS2 * height) ** 0.5
    after = _struck(released(state, middle, holder), thing.id, holder, impulse)
    px, py, pz = after.objects[thing.id].position
    return Performed(after, {"x": px, "y": py, "z": pz}, rules().time.fall_s)


def _struck(state: WorldState, fallen: str, under: str | None, impulse: float) -> WorldState:
    """Return the state with what breaks when a thing comes down: itself, and what it falls on."""
    fragile, thing = rules().fragile, state.objects[fallen]
    below = None if under is None else state.objects[under]
    soft = below is not None and below.type in fragile.soft
    if _breaks(thing, impulse - (fragile.soft_ns if soft else 0.0)):
        state = broken(state, thing)
    if below is not None and thing.type not in fragile.harmless and _breaks(below, impulse):
        state = broken(state, state.objects[below.id])
    return state


def _breaks(thing: SceneObject, impulse: float) -> bool:
    fragile = "breakable" in thing.capabilities and not thing.is_broken
    return fragile and impulse >= rules().fragile.impulse_ns


@on_object("OpenObject")
def open_object(state: WorldState, thing: SceneObject, *, openness: float = 1.0) -> Result:
    """Open to a degree; opening what is open succeeds."""
    return _opened(state, thing, openness)


@on_object("OpenObject")
def close_object(state: WorldState, thing: SceneObject) -> Result:
    """Close; closing what is closed succeeds."""
    return _opened(state, thing, 0.0)


def _opened(state: WorldState, thing: SceneObject, openness: float) -> Result:
    if not 0.0 <= openness <= 1.0:
        return refuse("ArgumentOutOfRangeException", "openness must be in [0:1]")
    if "openable" not in thing.capabilities:
        return Refusal(f"{thing.id} is not an Openable object")
    if thing.type in rules().toggle.must_be_off_to_open and thing.is_toggled:
        return Refusal("Target must be OFF to open!")
    return Performed(changed(state, thing.id, openness=float(openness)))


def toggler(on: bool) -> Callable[..., Result]:
    """Return the action that switches something on or off, with what it controls."""
    word = "on" if on else "off"

    @on_object(f"ToggleObject{word.title()}")
    def toggle(state: WorldState, thing: SceneObject) -> Result:
        refusal = _cannot_switch(thing, on, word)
        if refusal is not None:
            return refusal
        for object_id in (thing.id, *(c for c in thing.controls if c in state.objects)):
            state = changed(state, object_id, is_toggled=on)
        return Performed(state)

    return toggle


def _cannot_switch(thing: SceneObject, on: bool, word: str) -> Refusal | None:
    toggle = rules().toggle
    if thing.type in toggle.controlled_only:
        return Refusal("Target object is controlled by something else; toggle its knob instead.")
    if "toggleable" not in thing.capabilities:
        return Refusal(f"{thing.id} is not a toggleable object")
    if thing.is_toggled == on:
        return Refusal(f"can't toggle object {word} if it's already {word}!")
    if on and thing.is_broken:
        return Refusal(f"{thing.name} is broken and cannot be switched on.")
    if on and thing.type in toggle.must_be_closed_to_turn_on and thing.openness > 0:
        return Refusal("Target must be closed to Toggle On!")
    return None


# ----------------------------------------------------------------- changing what a thing is


def state_changer(
    action: str, capability: Capability, field: str, value: bool, already: str
) -> Callable[..., Result]:
    """Return the action that gives an object a state, refused when it has it already."""

    @on_object(action, capability)
    def change(state: WorldState, thing: SceneObject) -> Result:
        if getattr(thing, field) == value:
            return Refusal(f"{thing.name} is already {already}!")
        fields: dict[str, Any] = {field: value}
        if field == "is_filled":
            fields["liquid"] = None
        return Performed(changed(state, thing.id, **fields))

    return change


_CHANGES: dict[str, tuple[Capability, str, bool, str]] = {
    "DirtyObject": ("dirtyable", "is_dirty", True, "dirty"),
    "CleanObject": ("dirtyable", "is_dirty", False, "clean"),
    "EmptyLiquidFromObject": ("canFillWithLiquid", "is_filled", False, "empty"),
    "UseUpObject": ("canBeUsedUp", "is_used_up", True, "used up"),
    "CookObject": ("cookable", "is_cooked", True, "cooked"),
}
STATE_CHANGES = {name: state_changer(name, *row) for name, row in _CHANGES.items()}


@on_object("FillObjectWithLiquid", "canFillWithLiquid")
def fill(state: WorldState, thing: SceneObject, *, fillLiquid: str = "water") -> Result:
    """Fill a vessel; coffee makes it hot."""
    if fillLiquid not in rules().handling.liquids:
        known = ", ".join(rules().handling.liquids)
        return Refusal(f"{fillLiquid} is not a valid Liquid Type; valid are: {known}")
    if thing.is_filled:
        return Refusal(f"{thing.name} is already filled!")
    after = changed(state, thing.id, is_filled=True, liquid=fillLiquid)
    return Performed(
        changed(after, thing.id, temperature="Hot") if fillLiquid == "coffee" else after
    )


@on_object("SliceObject", "sliceable", done="is_sliced")
def slice_object(state: WorldState, thing: SceneObject) -> Result:
    """Cut into pieces, which stay where the whole was; no knife is needed."""
    if thing.id in state.in_hand:
        return Refusal("target object cannot be sliced if it is in the agent's hand")
    return Performed(in_pieces(state, msgspec.structs.replace(thing, is_sliced=True)))


@on_object("BreakObject", "breakable")
def break_object(state: WorldState, thing: SceneObject) -> Result:
    """Break for good; what lies in it and what holds it lose it."""
    if thing.is_broken:
        return Refusal(f"{thing.name} is already broken!")
    if state.held == thing.id:
        middle, holder = land(state, thing, thing.center[0], thing.center[2])
        state = released(state, middle, holder)
    return Performed(broken(state, state.objects[thing.id]))
