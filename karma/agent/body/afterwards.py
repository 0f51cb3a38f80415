"""The intended effects of a program, and whether the agent observed them.

The last action on each object counts: an apple that was washed and then put away is to be clean,
and where it was put. "Seen" is what the last look with the object in view shows. What only the
action itself tells (a tap ran over it, its door is shut) is "done, not seen". Nothing asks the
world.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Literal, get_args

from karma.agent.planning.program import PUTS, SWITCH_AFTER
from karma.agent.seeing.perceive import place_of
from karma.household.ids import is_part, root_id, type_of
from karma.household.pieces import EGG, goes_by, piece_type
from karma.household.places import FLOOR, HAND
from karma.household.saying import name_of, preposition, told_place
from karma.household.skill_effects import BeliefState, changes
from karma.household.states import END_STATES, SAID_AS
from karma.household.uses import (
    BURNER,
    MICROWAVE,
    STOVE,
    SWITCHED_BY_A_PART,
    TAP_OF,
    TAPS,
    covers,
)
from karma.types.events import Check, Found, SkillResult
from karma.types.memory import Experience
from karma.types.observation import SeenObject
from karma.types.planning import SkillCall

Group = Literal["moved", "changed", "switched", "doors"]  # in the order of the report
_REPORTED = ("cleaned", "heated", "cooled", "sliced", "broken", "empty")
_AWAY = {HAND: HAND, FLOOR: "away"}


@dataclass(frozen=True, slots=True)
class IntendedState:
    """The state that the last action on an object is to leave it in."""

    group: Group
    name: str  # id, or type if the call failed
    word: str  # "hand", "in", "near", "away", or a state
    place: str = ""
    happened: bool = True

    def __str__(self) -> str:
        """Return the state in words."""
        text = f"the {name_of(self.name)} is "
        if self.word == HAND:
            return f"{text}in the hand"
        if self.word == "away":
            return f"{text}thrown away"
        if not self.place:
            return text + SAID_AS.get(self.word, self.word)
        link = self.word if self.word == "near" else preposition(self.place)
        return f"{text}{link} the {name_of(self.place)}"


def checked(
    calls: Sequence[SkillCall], results: Sequence[SkillResult], experience: Experience
) -> tuple[Check, ...]:
    """Return the intended effects of a program and their observed state, in order of its calls.

    `calls` have the ids of known objects; `results` are of the calls that were tried.
    """
    found, ends = [], ends_of(calls, results)
    groups = {end.group for end in ends}
    for end in ends:
        if not _is_a_means(end, groups):
            state, note = _judged(end, experience)
            found.append(Check(text=str(end), found=state, note=note))
    return tuple(found)


def ends_of(calls: Sequence[SkillCall], results: Sequence[SkillResult]) -> list[IntendedState]:
    """Return the last intended state of each object, by group; `results` are of the tried calls."""
    ends: dict[tuple[str, ...], IntendedState] = {}
    beliefs = BeliefState()
    for call, result in zip_longest(calls, results[: len(calls)]):
        ok = result is not None and result.ok
        made = changes(_with_ids(call, result.object_ids if result is not None else ()), beliefs)
        for item, word, place, deletes in made:
            name = item.name
            if place is not None:
                away = _AWAY.get(place.name)
                ends.pop(("moved", name), None)
                link, at = away or ("near" if place.beside else "in"), "" if away else place.name
                ends["moved", name] = IntendedState("moved", name, link, at, ok)
            elif word in END_STATES.values():
                group: Group = "switched" if word in ("on", "off") else "doors"
                ends[group, name] = IntendedState(group, name, word, happened=ok)
            elif word in _REPORTED and not (
                word == "heated" and MICROWAVE not in beliefs.within(item)
            ):
                ended = [ends.pop(("changed", name, other), None) for other in deletes if ok]
                if word != "cooled" or any(ended):  # else its place, the fridge, tells it
                    ends["changed", name, word] = IntendedState("changed", name, word, happened=ok)
        beliefs = beliefs.changed(made)
    return sorted(ends.values(), key=lambda end: get_args(Group).index(end.group))


def _is_a_means(end: IntendedState, groups: Collection[Group]) -> bool:
    """Return whether a switch or door was only used for an effect that is reported already."""
    kind = type_of(end.name)
    if end.word in ("on", "off") and (kind in (*TAPS, *TAP_OF, MICROWAVE)):
        return end.word == "off" and "changed" in groups
    return end.word == "closed" and ("moved" in groups or "changed" in groups)


def _with_ids(call: SkillCall, ids: Sequence[str]) -> SkillCall:
    """Return a call with the ids that it used in place of names.

    A receptacle that was named by its type stays a type: a full one gives way to another.
    """
    name, kind = call.objects[-1], type_of(call.objects[-1])
    if call.skill in SWITCH_AFTER:
        used = name if kind in (BURNER, STOVE) or not ids else ids[-1]
        return replace(call, objects=(used,), turn=0)
    objects = [_id_of(call.objects[0], ids)]
    if call.skill in PUTS:
        place = kind if name == kind or kind == BURNER else _id_of(name, ids[::-1])
        objects = [*(objects if call.objects[1:] else ()), place]
    return replace(call, objects=tuple(objects), turn=0)


def _judged(end: IntendedState, experience: Experience) -> tuple[Found, str]:
    """Return whether an intended state was observed, and a note."""
    name, word, held = end.name, end.word, experience.held
    if end.group == "changed":
        return _changed(end, experience)
    if word == "away":
        is_gone = end.happened and (held is None or held.object_id != name)
        return "done" if is_gone else "unseen", ""
    if word == HAND:
        is_held = held is not None and goes_by(name, held.object_id, held.object_type)
        return "seen" if is_held else "unseen", ""
    if end.group != "moved" and type_of(name) in (*SWITCHED_BY_A_PART, STOVE):
        return "done" if end.happened else "unseen", ""

    def is_met(sight: SeenObject) -> bool:
        if word == "near":
            return place_of(sight) != HAND
        return _lies_in(sight, end.place) if end.place else word in sight.states

    known, looked = experience.seen.get(_now(name, experience)), _in_view(name, experience)
    if not end.happened or known is None:
        return "unseen", ""
    if is_met(known):
        return "seen" if looked is not None and is_met(looked) else "done", ""
    return "otherwise", f"it is {told_place(place_of(known))}" if end.group == "moved" else ""


def _changed(end: IntendedState, experience: Experience) -> tuple[Found, str]:
    """Return whether a changed state was observed, and a note."""
    name, word = end.name, end.word
    if not end.happened:
        return "unseen", ""
    pieces = [one for one in experience.seen if is_part(one, name)]
    if word in ("sliced", "broken") and pieces:
        is_shown = any(_in_view(one, experience) is not None for one in pieces)
        return "seen" if is_shown else "done", ""
    sight = _in_view(name, experience)
    if sight is not None:
        if word == "cleaned" and "dirty" in sight.states:
            return "otherwise", "it looks dirty"
        if word == "empty":
            return "otherwise" if "filled" in sight.states else "seen", ""
        if word in sight.states:
            return "seen", ""
    is_done = word == "broken" or word in experience.effects.get(_now(name, experience), ())
    return "done" if is_done else "unseen", ""


def _now(name: str, experience: Experience) -> str:
    """Return the id of an object by now: that of its contents for an egg that was cracked."""
    left = f"{name}|{piece_type(EGG)}_0"
    return left if type_of(name) == EGG and left in experience.seen else name


def _in_view(name: str, experience: Experience) -> SeenObject | None:
    """Return the latest sight that had an object in view or in the hand."""
    now = _now(name, experience)
    if (view := experience.views.get(now)) is None:
        return None
    sights = (*view.seen, *((view.held,) if view.held else ()))
    return next((sight for sight in sights if sight.object_id == now), None)


def _lies_in(sight: SeenObject, place: str) -> bool:
    """Return whether a thing lies in or on a place: an id, a type, or a sink for its basin."""
    return any(
        parent == place
        or is_part(parent, place)
        or (place == type_of(place) and covers(place, type_of(parent)))
        or root_id(parent) == place
        for parent in sight.parent_ids
    )


def _id_of(name: str, ids: Iterable[str]) -> str:
    """Return the first of the ids that a call used which its name may mean; else the name."""
    for one in ids:
        if goes_by(name, one, type_of(one)) or covers(type_of(name), type_of(one)):
            return one
    return name
