"""HELPER's inspector: rules for what must be done before a sub-goal can work."""

from collections.abc import Sequence

from karma.agent.planning.program import DOOR_AFTER
from karma.bench.rows.helper.memory import ObjectMemory
from karma.contracts import SeenObject, SkillCall
from karma.household.pieces import base_type, goes_by, is_piece
from karma.household.places import surface_for
from karma.household.types import object_types
from karma.household.uses import KNIVES, MICROWAVE

_SHUT_TO_RUN = (MICROWAVE,)


def without_object(
    call: SkillCall, held: SeenObject | None, memory: ObjectMemory
) -> list[SkillCall]:
    """Return what to do before the sub-goal's own object is looked for.

    * Before something else is picked up, the held thing is put down.
    * Before a cut, a knife is fetched.

    The sub-goal has types for names.
    """
    name = call.objects[-1]
    means_held = held is not None and goes_by(name, held.object_id, held.object_type)
    if call.skill == "PickupObject" and held is not None and not means_held:
        return [_put_down(held, memory)]
    if call.skill == "SliceObject" and (held is None or held.object_type not in KNIVES):
        first = [_put_down(held, memory)] if held is not None else []
        knife = next((name for name in KNIVES if memory.best(name) is not None), KNIVES[0])
        return [*first, SkillCall.of("PickupObject", knife)]
    return []


def with_object(call: SkillCall, memory: ObjectMemory) -> list[SkillCall]:
    """Return what to do once the ids of a sub-goal are known: open what is shut, or shut it."""
    name = call.objects[-1]
    if call.skill in ("PickupObject", "SliceObject", "BreakObject"):
        holder = memory.shut_in(name)
        return [SkillCall.of("OpenObject", holder.object_id)] if holder is not None else []
    one = memory.objects.get(name)
    if one is None:
        return []
    states, kind = one.sight.states, object_types()[one.sight.object_type]
    if call.skill == "PutObject" and kind.must_be_open and "closed" in states:
        return [SkillCall.of("OpenObject", name)]
    if call.skill == "ToggleOn" and kind.name in _SHUT_TO_RUN and "opened" in states:
        return [SkillCall.of("CloseObject", name)]
    return []


def idle(call: SkillCall, memory: ObjectMemory) -> bool:
    """Return whether to drop an open or close of an id: it does not open, or is so already."""
    one = memory.objects.get(call.objects[-1])
    if call.skill not in DOOR_AFTER or one is None:
        return False
    return (
        not object_types()[one.sight.object_type].can("openable")
        or DOOR_AFTER[call.skill] in one.sight.states
    )


def whole_first(call: SkillCall, memory: ObjectMemory) -> SkillCall | None:
    """Return the cut that must come first where a sub-goal names a piece not cut yet."""
    for name in call.objects:
        if is_piece(name) and memory.best(name) is None and call.skill != "SliceObject":
            return SkillCall.of("SliceObject", base_type(name))
    return None


def ends_there(call: SkillCall, rest: Sequence[SkillCall]) -> bool:
    """Return whether a thing that is put down has reached its goal (HELPER's ObjectDone).

    So it is when the rest of the program does not use it, or puts another one to the same place.
    """
    thing, place = call.objects[0], call.objects[-1]
    for later in rest:
        if later.skill == "PutObject" and later.objects[0] == thing:
            return later.objects[-1] == place
    return not any(thing in later.objects for later in rest)


def _put_down(held: SeenObject, memory: ObjectMemory) -> SkillCall:
    surface = surface_for(held.object_type, lambda name: memory.best(name) is not None)
    return SkillCall.of("PutObject", held.object_id, surface)
