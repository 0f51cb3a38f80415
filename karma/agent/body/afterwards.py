"""What a program was to bring about, and whether it is so by the agent's own eyes.

Of each thing the last deed counts: an apple that was washed and then put away is to be clean, and
where it was put. "Seen" is what the last look that had the thing in view shows. What only the deed
itself tells (a tap ran over it, its door is shut) is "done, not seen". Nothing asks the world.
"""

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace

from karma.agent.planning.program import PUTS, SWITCH_AFTER
from karma.agent.seeing.perceive import place_of
from karma.household.ids import is_part, root_id, type_of
from karma.household.pieces import EGG, base_type, goes_by, piece_type
from karma.household.places import FLOOR, HAND
from karma.household.saying import name_of, preposition, told_place
from karma.household.skill_effects import BeliefChange, BeliefState, changes
from karma.household.states import END_STATES, SAID_AS
from karma.household.uses import (
    BURNER,
    MICROWAVE,
    STOVE,
    TAPS,
    covers,
)
from karma.types.events import Check, Found, SkillResult
from karma.types.memory import Experience
from karma.types.observation import SeenObject
from karma.types.planning import SkillCall


def checked(
    calls: Sequence[SkillCall], results: Sequence[SkillResult], experience: Experience
) -> tuple[Check, ...]:
    """Return what a program was to bring about, thing by thing in the order of its deeds.

    `calls` have ids where a thing was known; `results` are of those that were tried.
    """
    ends = _ends_of(calls, results)
    eyes = _Eyes(experience)
    judged = [(one, _moved(one, eyes)) for one in ends.moved.values()]
    judged += [(one, _changed(one, eyes)) for one in ends.changed.values()]
    left = (*ends.switched.values(), *ends.doors.values())
    judged += [(one, _left(one, eyes)) for one in left if not ends.is_a_means(one)]
    return tuple(Check(text=_text(one), found=found, note=note) for one, (found, note) in judged)


_REPORTED = ("cleaned", "heated", "cooled", "sliced", "broken", "empty")


@dataclass(frozen=True, slots=True)
class _End:
    """How one thing is to be at the end of a program."""

    thing: str  # id, or type where it came to nothing
    word: str  # "hand", "in", "near", "away", or a state
    place: str = ""
    happened: bool = True


@dataclass(slots=True)
class _Ends:
    """What the calls of a program add up to."""

    moved: dict[str, _End] = field(default_factory=dict)
    changed: dict[tuple[str, str], _End] = field(default_factory=dict)
    switched: dict[str, _End] = field(default_factory=dict)
    doors: dict[str, _End] = field(default_factory=dict)

    def note(self, change: BeliefChange, ok: bool, within: Collection[str]) -> None:
        """Take in one change; later ones undo earlier ones. `within`: where its object lies."""
        name, word = change.item.name, change.state
        if (place := change.place) is not None:
            self.moved.pop(name, None)
            words = {HAND: HAND, FLOOR: "away"}
            end = words.get(place.name) or ("near" if place.beside else "in")
            self.moved[name] = _End(name, end, "" if place.name in words else place.name, ok)
        elif word in END_STATES.values():
            kind = self.switched if word in ("on", "off") else self.doors
            kind[name] = _End(name, word, happened=ok)
        elif word in _REPORTED and not (word == "heated" and MICROWAVE not in within):
            ended = [self.changed.pop((name, other), None) for other in change.deletes if ok]
            if word != "cooled" or any(ended):  # what only lies in the fridge is told by its place
                self.changed[name, word] = _End(name, word, happened=ok)

    def is_a_means(self, end: _End) -> bool:
        """Return whether a switch or door was used for something else, which is told already."""
        kind = type_of(end.thing)
        if end.word in ("on", "off") and (kind in TAPS or kind == MICROWAVE):
            return end.word == "off" and bool(self.changed)
        places = {one.place for one in self.moved.values()}
        holds = end.thing in places or kind in map(type_of, places)
        return end.word == "closed" and (holds or bool(self.moved or self.changed))


def _ends_of(calls: Iterable[SkillCall], results: Sequence[SkillResult]) -> _Ends:
    """Return what calls add up to; `results` are of those that were tried."""
    ends, beliefs = _Ends(), BeliefState()
    for number, call in enumerate(calls):
        result = results[number] if number < len(results) else None
        call = _with_ids(call, result.object_ids if result is not None else ())
        made = changes(call, beliefs)
        for change in made:
            ends.note(change, result is not None and result.ok, beliefs.within(change.item))
        beliefs = beliefs.changed(made)
    return ends


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


@dataclass(frozen=True, slots=True)
class _Eyes:
    """What the agent can say of a thing by its log."""

    experience: Experience

    def sight(self, thing: str) -> SeenObject | None:
        """Return the latest knowledge of a thing: what was seen or touched of it."""
        return self.experience.seen.get(self.now(thing))

    def now(self, thing: str) -> str:
        """Return what a thing is by now: what is left of an egg that was cracked."""
        left = f"{thing}|{piece_type(EGG)}_0"
        return left if type_of(thing) == EGG and left in self.experience.seen else thing

    def in_view(self, thing: str) -> SeenObject | None:
        """Return the latest sight that had a thing in view or in the hand."""
        now = self.now(thing)
        view = self.experience.views.get(now)
        if view is None:
            return None
        sights = (*view.seen, *((view.held,) if view.held else ()))
        return next((one for one in sights if one.object_id == now), None)

    def judged(
        self, end: _End, holds: Callable[[SeenObject], bool]
    ) -> tuple[Found, SeenObject | None]:
        """Return how it stands with a thing of which the last deed went well."""
        known, looked = self.sight(end.thing), self.in_view(end.thing)
        if not end.happened or known is None:
            return "unseen", known
        if looked is not None and holds(looked):
            return ("seen", looked) if holds(known) else ("otherwise", known)
        return ("done", known) if holds(known) else ("otherwise", known)


def _moved(end: _End, eyes: _Eyes) -> tuple[Found, str]:
    """Return how it stands with a thing that was to be elsewhere, and a note."""
    held = eyes.experience.held
    if end.word == "away":
        gone = end.happened and (held is None or held.object_id != end.thing)
        return "done" if gone else "unseen", ""
    if end.word == HAND:
        has = held is not None and goes_by(end.thing, held.object_id, held.object_type)
        return "seen" if has else "unseen", ""
    if end.word == "near":
        found, sight = eyes.judged(end, lambda one: place_of(one) != HAND)
    else:
        found, sight = eyes.judged(end, lambda one: _lies_in(one, end.place))
    return found, f"it is {told_place(place_of(sight))}" if found == "otherwise" and sight else ""


def _changed(end: _End, eyes: _Eyes) -> tuple[Found, str]:
    """Return how it stands with a thing that was to be in another state, and a note."""
    thing, word = end.thing, end.word
    if not end.happened:
        return "unseen", ""
    gone = eyes.experience.effects.get(eyes.now(thing), ())
    pieces = [name for name in eyes.experience.seen if is_part(name, thing)]
    if word in ("sliced", "broken") and pieces:
        shown = any(eyes.in_view(name) is not None for name in pieces)
        return "seen" if shown else "done", ""
    sight = eyes.in_view(thing)
    if word == "cleaned" and sight is not None and "dirty" in sight.states:
        return "otherwise", "it looks dirty"
    if word == "empty" and sight is not None:
        return "otherwise" if "filled" in sight.states else "seen", ""
    if sight is not None and word in sight.states:
        return "seen", ""
    return "done" if word in gone or word == "broken" else "unseen", ""


def _left(end: _End, eyes: _Eyes) -> tuple[Found, str]:
    """Return how it stands with what was to be on, off, open or shut, and no note."""
    if type_of(end.thing) in (BURNER, STOVE):
        return "done" if end.happened else "unseen", ""
    return eyes.judged(end, lambda one: end.word in one.states)[0], ""


def taken_back(
    earlier: Sequence[SkillResult],
    later: Sequence[SkillResult],
    own: Collection[tuple[str, str]],
    asked: Collection[tuple[str, str]],
) -> tuple[Check, ...]:
    """Return what later calls undid of earlier ones.

    `own` and `asked` are deeds with kinds of things, of the first request and of the later ones:
    what was only on its way is no matter, and what a later request undoes so is meant.
    """
    before, after = (
        _ends_of([result.call for result in done], done)
        for done in ([one for one in earlier if one.ok], [one for one in later if one.ok])
    )
    found = []
    for old, new, deeds in (
        (before.moved, after.moved, ("put", "take", "throw")),
        (before.switched, after.switched, ("on", "off")),
        (before.doors, after.doors, ("open", "close")),
    ):
        for thing, end in old.items():
            now, kind = new.get(thing), base_type(type_of(thing))
            wanted, meant = (any((deed, kind) in some for deed in deeds) for some in (own, asked))
            if wanted and not meant and now and _text(now) != _text(end):
                text, note = _text(end), _text(now).partition(" is ")[2]
                found.append(Check(text=text, found="otherwise", note=f"now it is {note}"))
    return tuple(found)


def _text(end: _End) -> str:
    """Return how a thing is to be, in words."""
    text = f"the {name_of(end.thing)} is "
    if end.word == HAND:
        return f"{text}in the hand"
    if end.word == "away":
        return f"{text}thrown away"
    if not end.place:
        return text + SAID_AS.get(end.word, end.word)
    link = end.word if end.word == "near" else preposition(end.place)
    return f"{text}{link} the {name_of(end.place)}"


# ----------------------------------------------------------------- what a name means


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
