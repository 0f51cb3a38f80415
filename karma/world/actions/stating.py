"""Give many objects a state at once: as asked for, or by lot."""

from collections.abc import Callable
from typing import NamedTuple

from karma.household.types import Capability
from karma.world.actions import handling
from karma.world.actions.spawning import lot
from karma.world.core.arguments import ObjectStates
from karma.world.core.scene import SceneObject
from karma.world.core.state import Performed, Refusal, Result, WorldState

_Handler = Callable[..., Result]


class _State(NamedTuple):
    """One state: what it takes, how AI2-THOR names it, and the actions that set and end it."""

    name: str
    can: Capability
    field: str
    flag: str
    do: _Handler
    undo: _Handler | None


def _change(can: Capability, field: str, value: bool) -> _Handler:
    return handling.state_changer("SetObjectStates", can, field, value, "so")


# AI2-THOR's words for StateChange of RandomToggleSpecificState, and those of SetObjectStates
_STATES = (
    _State("CanOpen", "openable", "openness", "isOpen",
           handling.open_object, handling.close_object),
    _State("CanToggleOnOff", "toggleable", "is_toggled", "isToggled",
           handling.toggler(True), handling.toggler(False)),
    _State("CanBeDirty", "dirtyable", "is_dirty", "isDirty",
           _change("dirtyable", "is_dirty", True), _change("dirtyable", "is_dirty", False)),
    _State("CanBeFilled", "canFillWithLiquid", "is_filled", "isFilledWithLiquid",
           handling.fill, _change("canFillWithLiquid", "is_filled", False)),
    _State("CanBeCooked", "cookable", "is_cooked", "isCooked",
           _change("cookable", "is_cooked", True), None),
    _State("CanBeUsedUp", "canBeUsedUp", "is_used_up", "isUsedUp",
           _change("canBeUsedUp", "is_used_up", True), None),
    _State("CanBeSliced", "sliceable", "is_sliced", "isSliced", handling.slice_object, None),
    _State("CanBreak", "breakable", "is_broken", "isBroken", handling.break_object, None),
)  # fmt: skip


def set_object_states(state: WorldState, *, SetObjectStates: ObjectStates) -> Result:
    """Give a state to all objects that can have it, or to those of one type."""
    asked = dict(SetObjectStates)
    found = [one for one in _STATES if one.can == asked.get("stateChange")]
    if not found:
        known = ", ".join(one.can for one in _STATES)
        return Refusal(f"stateChange must be one of: {known}")
    one, kind = found[0], asked.get("objectType")
    if one.flag not in asked:
        return Refusal(f"stateChange {one.can} needs {one.flag}")
    if kind and kind not in state.objects.by_type:
        return Refusal(f"No object of type {str(kind)[:80]} found in scene.")
    things = [t for t in state.objects.values() if one.can in t.capabilities]
    things = [t for t in things if not kind or t.type == kind]
    value = bool(asked[one.flag])
    if not value and one.undo is None and any(getattr(t, one.field) for t in things):
        return Refusal(f"{one.flag} cannot be undone.")
    for thing in things:
        state = _given(state, thing, one, value)
    return Performed(state)


def _given(state: WorldState, thing: SceneObject, one: _State, value: bool) -> WorldState:
    """Return the state with one object in a state, as far as the household allows it."""
    action = one.do if value else one.undo
    if action is None or bool(getattr(state.objects[thing.id], one.field)) == value:
        return state
    result = action(state, objectId=thing.id, forceAction=True)
    return result.state if isinstance(result, Performed) else state


def random_states(state: WorldState, *, randomSeed: int | None = None) -> Result:
    """Open, switch, dirty and fill by lot, or the reverse; nothing that cannot be undone."""
    for one in _STATES:
        if one.undo is not None:
            state = _shaken(state, one, randomSeed)
    return Performed(state)


def random_state(state: WorldState, *, StateChange: str, randomSeed: int | None = None) -> Result:
    """Change one state of all objects that can have it by lot, also one that cannot be undone."""
    found = [one for one in _STATES if one.name == StateChange]
    if not found:
        known = ", ".join(one.name for one in _STATES)
        return Refusal(f"StateChange must be one of: {known}")
    return Performed(_shaken(state, found[0], randomSeed))


def _shaken(state: WorldState, one: _State, seed: int | None) -> WorldState:
    rng = lot(state, seed, one.name)
    things = [thing for thing in state.objects.values() if one.can in thing.capabilities]
    for thing, value in zip(things, rng.random(len(things)) < 0.5, strict=True):
        state = _given(state, thing, one, bool(value))
    return state
