"""What the first program of a request was to bring about, and what is left of it.

The first program that is carried out says what the request asks for. What later programs, after a
failure, leave out was not done. Types count, not ids: any mug will do for a mug.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from karma.agent.planning.program import CHANGES, DEEDS, DOOR_AFTER, SWITCH_AFTER, WAYS
from karma.contracts import SkillCall
from karma.household.containment import fits_whole_or_cut
from karma.household.places import FLOOR, HAND
from karma.household.saying import spoken
from karma.household.skill_effects import BeliefState, apply, changes
from karma.household.types import WIDEST, object_types, types_with
from karma.household.uses import BIN, KNIVES, TAP_OF, TAPS, kind_of

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
    first: Sequence[SkillCall], later: Sequence[SkillCall], instruction: str
) -> bool:
    """Return whether a later program is about what the instruction names, unlike the first.

    Each of its new types is named. So the first program was wrong, or the instruction gives a
    choice: "the kettle, or a pan if there is none".
    """
    aims, asked = aims_of(later), aims_of(first).types
    now = aims.types - {kind for deed, kind in aims.deeds if deed == _FIND}
    was_wrong = not any(_is_said(kind, instruction) for kind in asked - now)
    free = was_wrong or bool(_CHOICE.search(instruction))
    return free and bool(now - asked) and all(_is_said(kind, instruction) for kind in now - asked)


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
