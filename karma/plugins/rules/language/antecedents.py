"""What "it", "them", "both" and "the dirty one" stand for in deeds: what was named before."""

from collections.abc import Sequence
from dataclasses import replace

from karma.household.types import Capability, types_with
from karma.plugins.rules.deeds import able_to, deed_kind
from karma.plugins.rules.language.pairs import DONE_AT_PLACES
from karma.plugins.rules.language.request_words import request_words
from karma.plugins.rules.types import Mention, SaidDeed


def sharing(deeds: Sequence[SaidDeed]) -> list[SaidDeed]:
    """Return deeds of which one without a thing shares that of the next: "slice and heat it"."""
    found = list(deeds)
    for number in range(1, len(found)):  # "cook the potato and put on the plate"
        if found[number].deed == "put" and found[number].place and not found[number].things:
            found[number] = replace(found[number], things=found[number - 1].things)
    for number in range(1, len(found)):  # "get the cup, chill in the fridge"
        one = found[number]
        if one.deed in DONE_AT_PLACES and not one.things and found[number - 1].deed == "take":
            found[number] = replace(one, things=found[number - 1].things)
    for number in range(len(found) - 2, -1, -1):
        one = found[number]
        if not one.things and one.deed not in ("", "go", "coffee", "wait"):
            found[number] = replace(one, things=found[number + 1].things)
    return found


def of_what(forbidden: SaidDeed, deeds: Sequence[SaidDeed]) -> SaidDeed:
    """Return a forbidden deed whose "it" stands for all that the others are about."""
    things = forbidden.things
    if any(one.text in ("anything", "nothing") or not (one.types or one.vague) for one in things):
        return replace(forbidden, things=())  # "the door": any
    if all(one.vague for one in things):
        named = (one for deed in deeds for one in (*deed.things, deed.place))
        return replace(forbidden, things=tuple(filter(None, named)))
    return forbidden


def left_out_of(one: Mention, deeds: Sequence[SaidDeed]) -> Mention:
    """Return what is left out as one of the things it is left out of: "but not the one on it"."""
    things = [thing for deed in deeds for thing in deed.things if thing.types]
    if one.types or not (one.at or one.states) or not things:
        return one
    return replace(one, text=things[-1].text, types=things[-1].types, vague=False)


def with_antecedents(
    deeds: Sequence[SaidDeed],
    before: Sequence[Mention],
    earlier: SaidDeed | None = None,
    older: Sequence[Mention] = (),
) -> list[SaidDeed]:
    """Return deeds whose "it" and "them" stand for what was named before.

    Args:
        deeds: in their order.
        before: what was named ahead of them.
        earlier: the deed that was asked for last ahead of them.
        older: what was named before that, which only "both" may stand for.
    """
    found: list[SaidDeed] = []
    ahead = sorted((one for one in before if one.types), key=lambda one: one.start)
    named: list[Mention] = []
    last: tuple[Mention, ...] = ()
    for deed in deeds:
        loose = not named and any(one.vague for one in deed.things)
        fresh = [one for one in ahead if one.start < deed.start] or (ahead if loose else [])
        named, ahead = [*named, *fresh], [one for one in ahead if one not in fresh]
        last = _together(fresh, earlier) or last
        if found and _is_cleared(found[-1], deed):
            found[-1] = replace(found[-1], deed="put", place=deed.place)
            continue
        things = tuple(
            thing for one in deed.things
            for thing in _both(one, (*older, *named), last) or _meant_by(one, deed, named, last)
        )  # fmt: skip
        place = deed.place
        if place is not None and place.vague and place.text in ("it", "that", "there") and named:
            place = _place_meant(found, named, things) or place
        found.append(replace(deed, things=things, place=place))
        last = tuple(one for one in things if not one.vague) or last
        last = _with_its_vessel(deed, last)
        named += [one for one in (*((place,) if place else ()), *things) if not one.vague]
    return found


def _together(fresh: Sequence[Mention], earlier: SaidDeed | None) -> tuple[Mention, ...]:
    """Return what "them" stands for: what was named last, or all that the last deed was about."""
    if any(one.start >= 0 and one.every for one in fresh[-1:]):  # "if the mugs are clean, ..."
        return tuple(fresh[-1:])
    last = {one.types for one in fresh[-1:]}
    about = tuple(one for one in earlier.things if one.types) if earlier else ()
    place = (earlier.place,) if earlier and earlier.place else ()
    if earlier is None or not about or not last & {one.types for one in (*about, *place)}:
        return tuple(fresh[-1:])
    return _with_its_vessel(earlier, about)


def _with_its_vessel(deed: SaidDeed, things: tuple[Mention, ...]) -> tuple[Mention, ...]:
    """Return what "them" stands for behind "put the pen in the mug": one thing, and the mug."""
    place, single = deed.place, len(things) == 1 and not (things[0].every or things[0].number)
    if place is None or not place.types or deed.near or not single:
        return things
    return (*things, place) if types_with("pickupable").issuperset(place.types) else things


def _is_cleared(before: SaidDeed, deed: SaidDeed) -> bool:
    """Return whether a deed only says where what was cleared goes."""
    loose = all(one.vague or one.anything for one in deed.things)
    emptied = before.deed == "take" and any(one.anything for one in before.things)
    cleared = (before.verb.startswith("clear") or emptied) and before.place is None
    return cleared and deed.deed == "put" and loose and deed.place is not None


def _meant_by(
    one: Mention, deed: SaidDeed, named: Sequence[Mention], last: Sequence[Mention]
) -> Sequence[Mention]:
    """Return what a pronoun stands for; anything else is itself."""
    if one.vague and one.text in ("them", "both", "these", "they") and last:
        need = deed_kind(deed.deed).takes
        able = [thing for thing in named if need and any(able_to(k, need) for k in thing.types)]
        served = not need or any(thing in able for thing in last) or not able
        return _so_many(last if served else able[-1:], one.number)
    if one.vague and one.text in ("former", "latter"):
        kinds = [thing for thing in named if _can(thing, "pickupable")]
        return [kinds[-2 if one.text == "former" and len(kinds) > 1 else -1]] if kinds else [one]
    if one.types and one.text.split()[-1] in request_words().pieces:  # "the slices": of what?
        whole = [thing.types for thing in named if set(thing.types) < set(one.types)]
        return [replace(one, types=whole[-1])] if whole else [one]
    pronoun = one.vague and (one.text in ("it", "this", "that", "one") or one.other)
    if not (pronoun and named):
        return [one]
    wanted = deed_kind(deed.deed).takes
    able = [thing for thing in named if wanted and any(able_to(one, wanted) for one in thing.types)]
    meant = (able or named)[-1]
    if deed.verb.endswith(" out") and len(able) > 1 and _can(meant, "receptacle"):
        meant = able[-2]  # "put it in the box", "take it out": not the box
    held = [thing for thing in named if _can(thing, "receptacle") and thing not in last]
    if one.text == "one" and deed.verb.endswith(" out") and held:  # of "how many are in it?"
        return [replace(meant, at=held[-1].types, number=1, every=False)]
    if one.text == "one" and last and not one.other:  # "put one on the desk": of those
        some = _so_many([thing for thing in last if thing in able] or [meant], 1)
        # "light the one on the shelf"
        return [replace(two, at=one.at, states=one.states, marks=one.marks) for two in some]
    if one.text in ("it", "this", "that"):
        return [replace(meant, at=())]
    return [replace(one, text=meant.text, types=meant.types, vague=False)]  # "the other one"


def _can(one: Mention, capability: Capability) -> bool:
    """Return whether any of what a mention may mean has a capability."""
    return not types_with(capability).isdisjoint(one.types)


def _both(one: Mention, named: Sequence[Mention], last: Sequence[Mention]) -> list[Mention]:
    """Return the things that were named one by one for "both"; [] of what stands for no more."""
    number = one.number or 1
    if not (one.vague and one.text in ("them", "both", "these", "they")):
        return []
    plural = [thing for thing in named if thing.every or (thing.number or 1) > 1]
    if one.every and one.number is None and len(last) == 1 and plural and last[0] not in plural:
        return [replace(plural[-1], at=())]  # "them all", not the one that was named last
    if number <= len(last) or plural:
        return []
    able = (thing for thing in named if _can(thing, "pickupable"))
    carried = {thing.types: replace(thing, at=()) for thing in able}
    return [*carried.values()][-number:] if len(carried) >= number else []


def _so_many(things: Sequence[Mention], number: int | None) -> list[Mention]:
    """Return things that were named before, of which so many are meant: "one of them"."""
    found = [replace(thing, at=()) for thing in things]
    if number is None and len(found) == 1 and _is_one_of_many(found[0]):
        return [replace(found[0], every=True)]  # "is any drawer open?", "close them"
    if number is None:
        return found
    if len(found) == 1:
        alone = number > 1 and not (found[0].every or (found[0].number or 1) > 1)
        return [replace(found[0], number=number, every=False, vague=alone)]  # "both" of one
    return found[-number:]


def _is_one_of_many(one: Mention) -> bool:
    """Return whether a single word was said of what there may be more of, by any article."""
    plural = one.text.split()[-1] in request_words().own_plurals  # "the keys" are one thing
    return not (plural or one.every or one.other or one.marks or one.number or one.states)


def _place_meant(
    found: Sequence[SaidDeed], named: Sequence[Mention], things: Sequence[Mention]
) -> Mention | None:
    """Return the place that "there" stands for: the last one, or what was named and can hold."""
    place = next((one.place for one in reversed(found) if one.place), None)
    own = {kind for thing in things for kind in thing.types}
    able = (one for one in reversed(named) if _can(one, "receptacle") and not own & {*one.types})
    return place or next(able, None)
