"""How a request was first read: which things its program is about, and what becomes of each.

The first program that is carried out is the reading of the request. A later one, after a failure,
may search elsewhere, clear the way, fetch a tool or do what is left. It may not do to another thing
what was asked of one, nor put that elsewhere; and what it leaves out was not done. Types count,
not ids: any mug will do for a mug.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from karma.agent.planning.program import CHANGES, DEEDS, DOOR_AFTER, PUTS, SWITCH_AFTER, WAYS
from karma.contracts import SkillCall
from karma.files import read_json
from karma.household.containment import fits_whole_or_cut
from karma.household.places import FLOOR, HAND
from karma.household.saying import spoken
from karma.household.skill_effects import Beliefs, apply, changes
from karma.household.types import WIDEST, object_types, types_with
from karma.household.uses import BIN, KNIVES, TAP_OF, TAPS, kind_of
from karma.language.hints import TYPE_WORDS, WordFile, bare_words, singular
from karma.language.phrases import phrases_of

_DEEDS = {name: DEEDS[name] for name in (*CHANGES, *SWITCH_AFTER)}
_FIND = "find"
_CHOICE = re.compile(r"\b(?:or|else|otherwise|instead|if)\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstReading:
    """What a program does, by types, tools and means left out."""

    moved: Mapping[str, tuple[str, ...]]  # thing -> where it is put, in order; HAND: it stays there
    deeds: frozenset[tuple[str, str]]  # ("slice", "Apple")

    @property
    def things(self) -> frozenset[str]:
        """The types that it is about."""
        return frozenset((*self.moved, *(thing for _, thing in self.deeds)))

    @property
    def handled(self) -> frozenset[str]:
        """The types that something is done to."""
        return self.things - {thing for deed, thing in self.deeds if deed == _FIND}

    def places(self, thing: str) -> frozenset[str]:
        """Return where a thing comes to be, also within what it was put into."""
        found, waiting = set[str](), [thing]
        while waiting:
            fresh = set(self.moved.get(waiting.pop(), ())) - found
            found |= fresh
            waiting += sorted(fresh)
        return frozenset(found)


def reading_of(calls: Iterable[SkillCall]) -> FirstReading:
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
    return FirstReading(moved=moved, deeds=frozenset(changed | alone))


def _sought(calls: Iterable[SkillCall]) -> set[tuple[str, str]]:
    """Return what a program only looks for or goes to last, if that can be carried."""
    names = [call.objects[-1] for call in calls if call.skill in WAYS]
    carried = {*map(kind_of, names[-1:])} & types_with("pickupable")
    return {(_FIND, thing) for thing in carried}


def _moved(calls: Iterable[SkillCall], *, changed: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return where objects are put; those only taken to be changed have no place."""
    moved: dict[str, tuple[str, ...]] = {}
    beliefs = Beliefs()
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


# ----------------------------------------------------------------- later programs


def put_right(first: Sequence[SkillCall], later: Sequence[SkillCall], instruction: str) -> bool:
    """Return whether a later program is about what the words mean as well, or better.

    So it is where a word may mean either thing ("the light"), or where the instruction names the
    new thing, and none that is left out, or gives a choice.
    """
    asked, now = reading_of(first).things, reading_of(later).handled
    left, new = asked - now, now - asked
    wrong = not any(_is_said(thing, instruction) for thing in left)
    free = wrong or bool(_CHOICE.search(instruction))
    return bool(new) and all(
        (free and _is_said(thing, instruction)) or _may_be_meant(thing, left, instruction)
        for thing in new
    )


def _may_be_meant(thing: str, left: Collection[str], instruction: str) -> bool:
    """Return whether a phrase of the instruction is what people call a thing and one left out."""
    for phrase in noun_phrases(instruction) if left else ():
        if _is_called(thing, phrase) and any(_is_called(kind, phrase) for kind in left):
            return True
    return False


def noun_phrases(text: str) -> list[str]:
    """Return what a text names, each without articles and the like."""
    return [" ".join(bare_words(noun.text.split())) for noun in phrases_of(text).nouns]


def _is_called(object_type: str, phrase: str) -> bool:
    """Return whether people call objects of a type by a phrase."""
    said = {phrase.lower(), singular(phrase.lower())}
    return not said.isdisjoint((*_type_words().get(object_type, ()), object_type.lower()))


@cache
def _type_words() -> Mapping[str, tuple[str, ...]]:
    return read_json(TYPE_WORDS, WordFile).types


def astray(
    first: Sequence[SkillCall],
    later: Sequence[SkillCall],
    instruction: str,
    done: Sequence[SkillCall] = (),
) -> tuple[int, str] | None:
    """Return the line of a later program that acts on another thing or place, and what is wrong.

    `first` is the program that was carried out first, () for none; `done` is what went well before:
    what holds a thing by now may go in its place.
    """
    asked, now = reading_of(first), reading_of(later)
    if not asked.things or not now.handled or put_right(first, later, instruction):
        return None
    mine = asked.things & now.handled
    held_in = frozenset[str]().union(*map(reading_of(done).places, asked.things))
    for thing in sorted(now.handled - asked.things - held_in):
        if not mine or _takes_its_turn(thing, asked, now):
            words = " and ".join(spoken(one) for one in sorted(asked.things))
            return _line(later, thing), f"that is another thing than asked for: the {words}"
    for thing in sorted(mine):
        allowed = {p for p in asked.places(thing) - {HAND} if _takes(p, thing)}
        if allowed and not _goes_to(thing, allowed, now):
            words = " or ".join(spoken(one) for one in sorted(allowed))
            return _line(later, thing), f"that is another place than asked for: the {words}"
    return None


def left_undone(
    first: Sequence[SkillCall], done: Sequence[SkillCall], instruction: str = ""
) -> tuple[str, ...]:
    """Return the things of a reading that what was done since has not brought to their ends.

    A place that the instruction names is meant, also where no such thing goes.
    """
    asked, now = reading_of(first), reading_of(done)
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


def _goes_to(thing: str, places: Collection[str], now: FirstReading) -> bool:
    """Return whether a thing ends in the hand, or in one of the places, if in another thing."""
    last = now.moved.get(thing, ())[-1:]
    return not last or last[0] == HAND or not {*last, *now.places(last[0])}.isdisjoint(places)


def _takes_its_turn(thing: str, asked: FirstReading, now: FirstReading) -> bool:
    """Return whether a thing that nobody asked for gets what was asked of another one.

    Not where it holds that one, as a box that is carried with it.
    """
    if any(thing in now.places(one) for one in asked.things):
        return False
    places = {place for one in asked.things for place in asked.moved.get(one, ())}
    deeds = {deed for deed, _ in asked.deeds}
    mine = {deed for deed, one in now.deeds if one == thing}
    return not places.isdisjoint(now.moved.get(thing, ())) or not deeds.isdisjoint(mine)


def _line(calls: Sequence[SkillCall], thing: str) -> int:
    """Return the line that is wrong: where a thing is put last, or else first spoken of."""
    lines = [n for n, call in enumerate(calls) if thing in map(kind_of, call.objects)]
    puts = [n for n in lines if calls[n].skill in (*PUTS, "ThrowObject")]
    return (puts[-1:] or lines)[0]


def _is_said(thing: str, instruction: str) -> bool:
    return f" {spoken(thing).lower()}" in f" {instruction.lower()}"
