"""From what the skills saw and did to units of short-term memory."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from karma.agent.perceive import to_unit
from karma.agent.skills import Skills
from karma.contracts import MemoryUnit, VisionModel
from karma.household.ids import is_part
from karma.methods.picture_states import look_at


def fresh_units(
    skills: Skills,
    vision: VisionModel,
    instruction: str,
    *,
    witnesses: int,
    folder: Path | None = None,
    scene: str = "",
) -> list[MemoryUnit]:
    """Return the units of an instruction: things seen first, then things handled, in order of use.

    Only what can be carried; immovable things belong to long-term memory. A thing that was cut is
    represented by one slice, the one handled last.

    Args:
        skills: their log.
        vision: reads states of the things of interest.
        instruction: what was asked for.
        witnesses: how many things that were only seen to keep, the last seen ones.
        folder: the run folder, which takes the pictures that were looked at.
        scene: name of the room.
    """
    handled = _handled(skills)
    others = [
        sight
        for object_id, sight in skills.seen.items()
        if sight.pickupable and object_id not in handled and object_id not in skills.cut
        if not any(is_part(object_id, whole) for whole in skills.cut)
    ]
    kept = others[len(others) - witnesses :] if witnesses else []
    sights = [*((sight, False) for sight in kept), *((skills.seen[i], True) for i in handled)]
    looked = look_at(vision, instruction, [sight for sight, _ in sights], skills.views, folder)
    units = (
        to_unit(
            sight,
            (*skills.effects.get(sight.object_id, ()), *looked.states.get(sight.object_id, ())),
            handled=was_handled,
            image=looked.images.get(sight.object_id),
        )
        for sight, was_handled in sights
    )
    return [replace(unit, scene=scene) for unit in units]


def _handled(skills: Skills) -> list[str]:
    """Return the ids that stand for what was handled, by last use."""
    last: dict[str, None] = {}
    for object_id in skills.handled:
        name = _standing_for(object_id, skills, last)
        sight = skills.seen.get(name)
        if sight is not None and sight.pickupable:
            last.pop(name, None)
            last[name] = None
    return list(last)


def _standing_for(object_id: str, skills: Skills, before: Iterable[str]) -> str:
    """Return the id itself, or the slice that stands for a whole that was cut."""
    if object_id not in skills.cut:
        return object_id
    parts = [name for name in skills.seen if is_part(name, object_id)]
    used = [name for name in before if name in parts]
    return (used or sorted(parts) or [object_id])[-1]
