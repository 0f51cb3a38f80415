"""What an errand changed besides is put back: doors are shut, what ran is off, tools lie again."""

from collections.abc import Iterator

from karma.agent.body.skills import Skills
from karma.agent.planning.guard import switch_of
from karma.agent.planning.reading import kind_of
from karma.contracts import Experience, Request, SkillCall, SkillResult
from karma.household.deeds import deed_kind
from karma.household.ids import type_of
from karma.household.places import HAND
from karma.household.uses import LAMPS


def put_back(asked: Request, skills: Skills) -> Iterator[SkillResult]:
    """Undo what nobody asked for, as far as the world lets it; what it refuses is left.

    Yields:
        What came of each skill.
    """
    for call in _tool_put_down(asked, skills.experience):
        yield skills.run(call)
    for name, skill in reversed(list(skills.experience.left.items())):
        if not _is_wanted(asked, name, skill):
            yield skills.run(SkillCall(skill=skill, objects=(name,)))


def _kinds(asked: Request, deeds: tuple[str, ...]) -> set[str]:
    """Return the kinds of things that some deeds of the sentence are about."""
    said = (deed for deed in (*asked.deeds, *asked.rest) if deed.deed in deeds)
    return {kind_of(kind) for deed in said for thing in deed.things for kind in thing.types}


def _tool_put_down(asked: Request, experience: Experience) -> Iterator[SkillCall]:
    """Yield what puts a tool that is still held back to where it was taken from."""
    held = experience.held
    place = experience.taken.get(held.object_id) if held is not None else None
    if held is None or place is None or place == HAND:
        return
    deeds = {deed.deed for deed in asked.deeds}
    kind, tools = (
        kind_of(held.object_type),
        {one for deed in deeds for one in deed_kind(deed).tools},
    )
    if kind not in tools or kind in {
        kind_of(one) for thing in asked.mentions for one in thing.types
    }:
        return
    sight = experience.seen.get(place)
    if sight is not None and "closed" in sight.states:
        yield SkillCall(skill="OpenObject", objects=(place,))
    yield SkillCall(skill="PutObject", objects=(held.object_id, place))


def _is_wanted(asked: Request, name: str, skill: str) -> bool:
    """Return whether a door was to be open, or something to run."""
    deeds = ("open",) if skill == "CloseObject" else ("on", "look")
    against = "close" if skill == "CloseObject" else "off"
    kept = [deed for deed in asked.forbidden if deed.deed == against]
    about = {kind_of(one) for deed in kept for thing in deed.things for one in thing.types}
    if kept and (kind_of(type_of(name)) in about or not about):
        return True  # "but don't close the door"
    said = [deed for deed in (*asked.deeds, *asked.rest) if deed.deed in deeds]
    kind = kind_of(type_of(name))
    if any(not deed.things or any(t.anything or t.told for t in deed.things) for deed in said):
        return True
    lit = kind in LAMPS and any(deed.deed == "look" for deed in said)
    return lit or switch_of(kind) in map(switch_of, _kinds(asked, deeds))
