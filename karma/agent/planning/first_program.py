"""What the first program of a request was to bring about, and what is left of it.

The first program that is carried out says what the request asks for. What later programs, after a
failure, leave out was not done. Types count, not ids: any mug will do for a mug.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from karma.agent.planning.program import CHANGES, DEEDS, DOOR_AFTER, PUTS, SWITCH_AFTER, WAYS
from karma.household.containment import fits_whole_or_cut
from karma.household.places import FLOOR, HAND
from karma.household.saying import spoken
from karma.household.skill_effects import BeliefState, apply, changes
from karma.household.types import WIDEST, object_types, types_with
from karma.household.uses import BIN, KNIVES, TAP_OF, TAPS, kind_of
from karma.types.planning import PlanRequest, SkillCall

_DEEDS = {name: DEEDS[name] for name in (*CHANGES, *SWITCH_AFTER)}
_FIND = "find"
_CHOICE = re.compile(r"\b(?:or|else|otherwise|instead|if)\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramAims:
    """What a program does, by types, tools and means left out."""

    moved: Mapping[str, tuple[str, ...]]  # type -> where it is put, in order; HAND: it stays there
    deeds: frozenset[tuple[str, str]]  # ("slice", "Apple")

    @property
    def types(self) -> frozenset[str]:
        """The object types that it is about."""
        return frozenset((*self.moved, *(kind for _, kind in self.deeds)))

    def places(self, thing: str) -> frozenset[str]:
        """Return where a thing comes to be, also within what it was put into."""
        found, waiting = set[str](), [thing]
        while waiting:
            fresh = set(self.moved.get(waiting.pop(), ())) - found
            found |= fresh
            waiting += sorted(fresh)
        return frozenset(found)


def aims_of(calls: Iterable[SkillCall]) -> ProgramAims:
    """Return what a program does; where that is only to open or to find something, that counts."""
    calls = list(calls)
    deeds = {(_DEEDS[c.skill], kind_of(c.objects[-1])) for c in calls if c.skill in _DEEDS}
    changed = {one for one in deeds if not one[0].startswith("switch")}
    moved = _moved(calls, changed={thing for _, thing in changed})
    if any(deed == "slice" for deed, _ in deeds):
        moved = {thing: places for thing, places in moved.items() if thing not in KNIVES}
    alone = {one for one in deeds - changed if not _is_means(one[1], moved)}
    if not moved and not changed and not alone:
        doors = {(one.skill, kind_of(one.objects[-1])) for one in calls if one.skill in DOOR_AFTER}
        alone = deeds or doors or _sought(calls)
    return ProgramAims(moved=moved, deeds=frozenset(changed | alone))


def _sought(calls: Iterable[SkillCall]) -> set[tuple[str, str]]:
    """Return what a program only looks for or goes to last, if that can be carried."""
    names = [call.objects[-1] for call in calls if call.skill in WAYS]
    carried = {*map(kind_of, names[-1:])} & types_with("pickupable")
    return {(_FIND, thing) for thing in carried}


def _moved(calls: Iterable[SkillCall], *, changed: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return where objects are put; those only taken to be changed have no place."""
    moved: dict[str, tuple[str, ...]] = {}
    beliefs = BeliefState()
    for call in calls:
        call = replace(call, objects=tuple(map(kind_of, call.objects)), turn=0)
        for item, _, place, _ in changes(call, beliefs):
            if place is not None:
                there = {HAND: (), FLOOR: (BIN,)}.get(place.name, (place.name,))
                moved[item.name] = (*moved.get(item.name, ()), *there)
        beliefs = apply(call, beliefs)
    held = beliefs.held.name if beliefs.held is not None else ""
    if held and held not in changed:
        moved[held] = (*moved[held], HAND)
    return moved


def _is_means(switch: str, moved: Mapping[str, tuple[str, ...]]) -> bool:
    """Return whether a switch does something to what was put there."""
    places = {place for places in moved.values() for place in places}
    return switch in places or (switch in TAPS and not places.isdisjoint(TAP_OF))


def _takes(place: str, thing: str) -> bool:
    """Return whether the types allow a thing there; beside what holds nothing it always may be."""
    there, one = object_types().get(place), object_types().get(thing)
    if there is None or one is None or not there.can("receptacle"):
        return True
    return fits_whole_or_cut(thing, place, WIDEST)


def replaces_first(
    first: Sequence[SkillCall],
    later: Sequence[SkillCall],
    instruction: str,
    objects: Mapping[str, Collection[str]] = MappingProxyType({}),
) -> bool:
    """Return whether a later program is about what the instruction means, unlike the first.

    Each of its new types is named, and the first program was wrong or the instruction gives a
    choice ("the kettle, or a pan if there is none"); or an object of the instruction is called as
    the new type and as one left out ("the cleaning tool").
    """
    aims, asked = aims_of(later), aims_of(first).types
    now = aims.types - {kind for deed, kind in aims.deeds if deed == _FIND}
    left, new = asked - now, now - asked
    was_wrong = not any(_is_said(kind, instruction) for kind in left)
    free = was_wrong or bool(_CHOICE.search(instruction))
    alike = [{*types} for types in objects.values() if not left.isdisjoint(types)]
    return bool(new) and all(
        (free and _is_said(kind, instruction)) or any(kind in types for types in alike)
        for kind in new
    )


def substitution(later: Sequence[SkillCall], request: PlanRequest) -> tuple[int, str] | None:
    """Return the line of a later program that uses another object or place, and why it may not.

    What holds an object by now may be moved in its place.
    """
    first, instruction = request.first, request.instruction
    asked, now = aims_of(first), aims_of(later)
    handled = now.types - {kind for deed, kind in now.deeds if deed == _FIND}
    if not asked.types or not handled or replaces_first(first, later, instruction, request.objects):
        return None
    kept = asked.types & handled
    holders = frozenset[str]().union(*map(aims_of(request.done).places, asked.types))
    for kind in sorted(handled - asked.types - holders):
        if not kept or _takes_the_turn(kind, asked, now):
            words = " and ".join(map(spoken, sorted(asked.types)))
            return _line(later, kind), f"that is another thing than asked for: the {words}"
    for kind in sorted(kept):
        places = {place for place in asked.places(kind) - {HAND} if _takes(place, kind)}
        if places and not _goes_to(kind, places, now):
            words = " or ".join(map(spoken, sorted(places)))
            return _line(later, kind), f"that is another place than asked for: the {words}"
    return None


def _takes_the_turn(kind: str, asked: ProgramAims, now: ProgramAims) -> bool:
    """Return whether an object gets what was asked of another one, which it does not hold."""
    if any(kind in now.places(other) for other in asked.types):
        return False
    places = {place for other in asked.types for place in asked.moved.get(other, ())}
    deeds = {deed for deed, _ in asked.deeds}
    own = {deed for deed, other in now.deeds if other == kind}
    return not places.isdisjoint(now.moved.get(kind, ())) or not deeds.isdisjoint(own)


def _goes_to(kind: str, places: Collection[str], now: ProgramAims) -> bool:
    """Return whether an object ends in the hand or in one of the places, if in another object."""
    last = now.moved.get(kind, ())[-1:]
    return not last or last[0] == HAND or not {*last, *now.places(last[0])}.isdisjoint(places)


def _line(calls: Sequence[SkillCall], kind: str) -> int:
    """Return the line to object to: where an object is put last, or else first named."""
    lines = [number for number, call in enumerate(calls) if kind in map(kind_of, call.objects)]
    puts = [number for number in lines if calls[number].skill in (*PUTS, "ThrowObject")]
    return (puts[-1:] or lines)[0]


def left_undone(
    first: Sequence[SkillCall], done: Sequence[SkillCall], instruction: str = ""
) -> tuple[str, ...]:
    """Return the types of the first program that later calls have not brought to their ends.

    A place that the instruction names is meant, also where no such thing goes.
    """
    asked, now = aims_of(first), aims_of(done)
    did = {(_DEEDS.get(call.skill, call.skill), kind_of(call.objects[-1])) for call in done}
    did |= {(_FIND, kind_of(call.objects[-1])) for call in done}
    changed = {thing for _, thing in asked.deeds}
    open_ends = {thing for _, thing in asked.deeds - did}
    for thing, places in asked.moved.items():
        last = places[-1] if places else HAND
        last = last if _takes(last, thing) or _is_said(last, instruction) else HAND
        brought = last in {HAND, *now.places(thing)}
        if not brought or not (thing in now.moved or thing in changed):
            open_ends.add(thing)
    return tuple(sorted(open_ends))


def _is_said(thing: str, instruction: str) -> bool:
    return f" {spoken(thing).lower()}" in f" {instruction.lower()}"
