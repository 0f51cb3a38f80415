"""Undo the side effects of a request: shut doors, switch off devices, put tools back."""

from collections.abc import Iterable, Iterator

from karma.agent.session import InstructionSession
from karma.household.ids import type_of
from karma.household.places import HAND
from karma.household.uses import LAMPS, kind_of, switch_of
from karma.plugins.rules.deeds import deed_kind
from karma.plugins.rules.types import Request, SaidDeed
from karma.types.events import SkillResult
from karma.types.planning import SkillCall


def put_back(asked: Request, session: InstructionSession) -> Iterator[SkillResult]:
    """Undo all changes that the request does not ask for, as far as the world allows."""
    for call in _tool_put_down(asked, session):
        yield session.call(call)
    for name, skill in reversed(list(session.remembered().left.items())):
        if not _is_wanted(asked, name, skill):
            yield session.call(SkillCall.of(skill, name))


def _tool_put_down(asked: Request, session: InstructionSession) -> Iterator[SkillCall]:
    """Yield the calls that return a held tool to the receptacle it was taken from."""
    known = session.remembered()
    held = known.held
    place = known.taken.get(held.object_id) if held is not None else None
    if held is None or place is None or place == HAND:
        return
    deeds = {deed.deed for deed in asked.deeds}
    tools = {one for deed in deeds for one in deed_kind(deed).tools}
    named = {kind_of(one) for thing in asked.mentions for one in thing.types}
    if kind_of(held.object_type) not in tools - named:
        return
    sight = session.seen().get(place)
    if sight is not None and "closed" in sight.states:
        yield SkillCall.of("OpenObject", place)
    yield SkillCall.of("PutObject", held.object_id, place)


def _is_wanted(asked: Request, name: str, skill: str) -> bool:
    """Return whether the request wants a door open or a device running."""
    deeds = ("open",) if skill == "CloseObject" else ("on", "look")
    against = "close" if skill == "CloseObject" else "off"
    kept = [deed for deed in asked.forbidden if deed.deed == against]
    kind, about = kind_of(type_of(name)), _kinds(kept)
    if kept and (kind in about or not about):
        return True  # "but don't close the door"
    said = [deed for deed in (*asked.deeds, *asked.rest) if deed.deed in deeds]
    if any(not deed.things or any(t.anything or t.told for t in deed.things) for deed in said):
        return True
    lit = kind in LAMPS and any(deed.deed == "look" for deed in said)
    return lit or switch_of(kind) in map(switch_of, _kinds(said))


def _kinds(deeds: Iterable[SaidDeed]) -> set[str]:
    """Return the object types of some actions."""
    return {kind_of(kind) for deed in deeds for thing in deed.things for kind in thing.types}
