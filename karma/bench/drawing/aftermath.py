"""What a request leaves behind in memory, written down by rule."""

from dataclasses import replace

from karma.contracts import Goal, MemoryUnit
from karma.household.pieces import base_type
from karma.household.places import HAND
from karma.household.states import END_STATES, OPPOSITES
from karma.household.types import object_types
from karma.household.uses import CHANGED_IN, FRIDGE


def subject(goal: Goal) -> str:
    """Return the type of what a goal is about."""
    return base_type(goal.arguments[1] if goal.predicate == "HOLDON" else goal.arguments[0])


def after(unit: MemoryUnit, goal: Goal) -> MemoryUnit:
    """Return a thing once a goal about it is met."""
    word = goal.arguments[-1]
    if goal.predicate in ("ON", "INSIDE"):
        return replace(unit, place_id=word)
    if goal.predicate == "HOLDON":
        return replace(unit, place_id=HAND)
    if goal.predicate != "STATE":
        word = END_STATES[goal.predicate]
    state = {"clean": "cleaned", "cold": ""}.get(word, word)
    states = [s for s in unit.states if s not in (state, OPPOSITES.get(state))]
    kind = object_types()[unit.object_type]
    if state == "cleaned" and "canFillWithLiquid" in kind.capabilities:
        states.append("filled")
    return replace(
        unit,
        object_type=(kind.slices_into or unit.object_type) if state == "sliced" else kind.name,
        states=(*states, *([state] if state else [])),
        place_id=FRIDGE if word == "cold" else CHANGED_IN.get(state, unit.place_id),
        handled=True,
    )
