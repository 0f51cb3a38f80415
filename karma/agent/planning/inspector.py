"""The inspector: mends a program's oversights, and objects to what cannot work.

Planners forget to search for what nobody has seen, to open what a thing is shut in, and what is in
the hand. Mending is by rule and shows in the record: the answer stays as written beside what was
done. It knows types and the agent's own memory, not the world, which may still refuse.

Source: ours; the idea of repairing preconditions is HELPER's (Sarch et al. 2023).
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from karma.agent.planning.program import PUTS, SKILL_OF, WAYS
from karma.household.containment import fits_whole_or_cut, goes_in, vessels
from karma.household.ids import short_type, type_of
from karma.household.places import FLOOR, LIKELY, SURFACES
from karma.household.skill_effects import BeliefState, Item, apply, outcome, unmet
from karma.household.types import WIDEST, object_types
from karma.household.uses import KNIVES, SWITCHED_BY_A_PART
from karma.types.memory import Area
from karma.types.planning import Skill, SkillCall

_FREES_HAND = {"empty hand", "not held"}
TOLD = 12  # receptacles in one sentence: as many types as a room has
_PLACES = tuple(dict.fromkeys((*SURFACES, *LIKELY, *sorted(object_types()))))


def mend(
    calls: Sequence[SkillCall],
    *,
    known: Collection[str],
    shut: Collection[str] = (),
    cut: Collection[str] = (),
    running: Collection[str] = (),
    held: str | None = None,
    areas: Sequence[Area] = (),
) -> tuple[SkillCall, ...]:
    """Return the program with searches added, the held thing named and the hand freed.

    * Before the first use of a thing whose place is not known, `Explore` it, the likeliest area
      first.
    * Instead of going to a thing that memory has in a closed container, `Explore` it: that opens.
    * What memory has as cut is not cut again, and no knife is fetched for it.
    * What is in the hand already is neither gone to nor picked up again.
    * What is put down before anything was picked up is what was in the hand.
    * Before something else is picked up, or the held thing is broken, what is in the hand goes to a
      known surface.
    * What runs is switched off before its door or lid is moved.

    All names are the prompt's short names: `known` are those and types whose place the agent knows,
    `shut` those that memory has in something closed, `cut` as sliced; `running` are types of things
    that were seen to run.
    """
    found, mended, beliefs = set(known), list[SkillCall](), BeliefState.holding(held)
    for call in _without_cuts(calls, cut):
        name, hand = call.objects[-1], beliefs.held.name if beliefs.held is not None else None
        if hand == name and call.skill in (*WAYS, "PickupObject"):
            continue
        if call.skill in PUTS:
            if len(call.objects) == 2 and hand is not None and hand == held:
                call = replace(call, objects=(hand, name))
            found.add(call.objects[0])
        elif not _FREES_HAND.isdisjoint(unmet(call, beliefs)):
            freed = put_down(hand, found)
            beliefs = outcome(freed, beliefs)
            mended += freed
        beliefs = apply(call, beliefs)
        if call.skill == "GoToObject" and name in shut:
            call = replace(call, skill="Explore")
        elif call.skill != "Explore" and not _placed(name, found, held):
            where = likely_areas(short_type(name), areas)
            mended.append(SkillCall(skill="Explore", objects=(name,), positions=where))
        found.add(name)
        mended.append(call)
    return tuple(_switched_off(mended, running))


def _switched_off(calls: Iterable[SkillCall], running: Collection[str]) -> Iterator[SkillCall]:
    """Yield a program in which what runs is switched off before its door or lid is moved."""
    beliefs = BeliefState(states={Item(kind): frozenset(("on",)) for kind in running})
    for call in calls:
        plain = replace(call, objects=tuple(map(short_type, call.objects)), turn=0)
        if "off" in unmet(plain, beliefs):
            off = SkillCall(skill="ToggleOff", objects=call.objects[-1:])
            beliefs = apply(replace(off, objects=plain.objects), beliefs)
            yield off
        beliefs = apply(plain, beliefs)
        yield call


def _without_cuts(calls: Sequence[SkillCall], cut: Collection[str]) -> Sequence[SkillCall]:
    """Return a program without the lines that would slice what is sliced."""
    again = {c.objects[0] for c in calls if c.skill == "SliceObject" and c.objects[0] in cut}
    if not again:
        return calls
    kept = [c for c in calls if not (c.skill == "SliceObject" and c.objects[0] in again)]
    if len(kept) == len(calls) or any(c.skill == "SliceObject" for c in kept):
        return kept
    put = {c.objects[0] for c in kept if c.skill in PUTS}
    idle = {name for name in KNIVES if name not in put}
    fetching = (*WAYS, "PickupObject")
    return [c for c in kept if c.skill not in fetching or short_type(c.objects[0]) not in idle]


def likely_areas(object_type: str, areas: Sequence[Area]) -> tuple[str, ...]:
    """Return the area node to search first: the first with the likeliest place for a type."""
    kind = object_types().get(object_type)
    fits = (kind.goes_in if kind is not None else None) or ()
    likely = (place for place in LIKELY if place in fits)
    found = (area.name for place in likely for area in areas if place in area.contains)
    return tuple(islice(found, 1))


def put_down(hand: str | None, known: Collection[str]) -> list[SkillCall]:
    """Return the lines that free the hand, on a known surface if there is one.

    `hand` is a short name, or an id.
    """
    kind = object_types().get(short_type(type_of(hand or "")))
    if hand is None or kind is None:
        return []
    fitting = [name for name in SURFACES if fits_whole_or_cut(kind.name, name)]
    there = [name for name in fitting if name in known]
    for surface in (there or fitting)[:1]:
        search = [] if there else [SkillCall.of("Explore", surface)]
        return [*search, SkillCall.of("PutObject", hand, surface)]
    return []


def _placed(name: str, found: Collection[str], held: str | None) -> bool:
    return name in found or short_type(name) in found or name == held or name.startswith("node_")


@dataclass(frozen=True, slots=True, kw_only=True)
class Objection:
    """What is wrong with the first line of a program that cannot work."""

    line: int  # from 0
    call: SkillCall
    reason: str
    help: str = ""  # what would work, where that is known
    lasting: bool = False  # the types of its things never allow it, whatever is done before

    def __str__(self) -> str:
        """Return it as small planners are told."""
        return f"{self.call}: {self.reason}"


def objection(
    calls: Sequence[SkillCall], *, held: str | None, known: Collection[str] = ()
) -> Objection | None:
    """Return what is wrong with the first line that cannot work, None if nothing is.

    What would help is `known`.
    """
    beliefs = BeliefState.holding(held)
    for number, call in enumerate(calls):
        if reason := _refused(call, beliefs):
            lasting, advice = _lasts(reason, call), _help(call, known)
            return Objection(line=number, call=call, reason=reason, help=advice, lasting=lasting)
        beliefs = apply(call, beliefs)
    return None


def _help(call: SkillCall, known: Collection[str]) -> str:
    """Return where a thing would go that cannot be put where it should."""
    thing = short_type(call.objects[0])
    asked = call.skill == "PutObject" and len(call.objects) == 2 and thing in object_types()
    there = {short_type(one) for one in known}
    places = [one for one in _PLACES if one in there]
    return goes_where(thing, call.objects[1], places) if asked and known else ""


def _refused(call: SkillCall, beliefs: BeliefState) -> str:
    """Return why a call cannot work, or "" where it can."""
    if call.skill == "ThrowObject":
        return ""
    if reason := _incapable(call):
        return reason
    held = beliefs.held.name if beliefs.held is not None else None
    if "empty hand" in unmet(call, beliefs):
        return f"the hand holds {held}; put it down first"
    return _put_refused(call, held) if call.skill in PUTS else ""


def _put_refused(call: SkillCall, held: str | None) -> str:
    name = call.objects[0] if len(call.objects) == 2 else (held or "")
    place = call.objects[-1]
    if held is None:
        return f"the hand is empty; PickupObject(robot, '{name}') first"
    if short_type(held) != short_type(name):
        return f"the hand holds {held}, not {name}"
    if reason := _misplaced(replace(call, objects=(name, place))):
        return reason
    return f"{name} cannot be placed in itself" if name == place else ""


def _incapable(call: SkillCall) -> str:
    """Return why no thing of this type takes part in such a deed."""
    name = call.objects[-1]
    skill = SKILL_OF.get(call.skill)
    return f"{name} {skill.cannot}" if skill is not None and not _may_take(skill, name) else ""


def _may_take(skill: Skill, name: str) -> bool:
    """Return whether a skill can be done with what goes by a name; what is unknown may be."""
    kind = object_types().get(short_type(name))
    if not skill.takes or kind is None or skill.takes in kind.capabilities:
        return True
    by_part = skill.takes == "toggleable" and kind.name in SWITCHED_BY_A_PART
    return by_part or (skill.takes == "sliceable" and bool(kind.slices_into))


def narrowed(
    skills: Iterable[Skill], names: Sequence[str]
) -> tuple[tuple[str, tuple[tuple[str, ...], ...]], ...]:
    """Return for each skill the names that may stand in it, argument by argument, by their types.

    Skills that take anything are left out.
    """
    kinds = {name: object_types().get(short_type(name)) for name in names}
    held, places = (
        tuple(one for one, kind in kinds.items() if kind is None or need in kind.capabilities)
        for need in ("pickupable", "receptacle")
    )
    found: list[tuple[str, tuple[tuple[str, ...], ...]]] = []
    for skill in skills:
        if skill.name == "PutNear":
            found.append((skill.name, (held, tuple(names))))
        elif skill.arguments == ("object", "object"):
            found.append((skill.name, (held, places)))
        elif skill.takes:
            found.append((skill.name, (tuple(one for one in names if _may_take(skill, one)),)))
    return tuple(found)


def _misplaced(call: SkillCall) -> str:
    """Return why no thing of this type is put into such a receptacle."""
    if call.skill != "PutObject" or len(call.objects) < 2:
        return ""
    kinds = [short_type(one) for one in call.objects]
    if not object_types().keys() >= {*kinds} or fits_whole_or_cut(kinds[0], kinds[1], WIDEST):
        return ""
    return f"{call.objects[0]} cannot be placed in {call.objects[1]}"


def _lasts(reason: str, call: SkillCall) -> bool:
    """Return whether a refusal holds for all things of these types, whatever is done before."""
    if reason != _misplaced(call):
        return reason == _incapable(call)
    thing, receptacle = map(short_type, call.objects)
    return not any(vessels(object_types(), thing, receptacle))


def takers(object_type: str, known: Iterable[str]) -> list[str]:
    """Return which known types of receptacles a thing goes in or on as it is, in the order given.

    >>> takers("Book", ["Fridge", "Sofa", "DiningTable_1", "DiningTable_2"])
    ['Sofa', 'DiningTable']
    """
    there = dict.fromkeys(short_type(one) for one in known)
    return [
        one for one in there if one in object_types() and one != FLOOR and goes_in(object_type, one)
    ]


def goes_where(object_type: str, receptacle: str, known: Sequence[str]) -> str:
    """Say where a thing goes that a receptacle does not take, and what would bring it there.

    `known` are names and types, the best first.

    >>> goes_where("Laptop", "Cabinet_2", ["Fridge", "Desk", "Box"])
    'of what is known here it goes in or on Desk, Box; in Box it can be carried to Cabinet_2'
    """
    places = takers(object_type, known)
    told = ", ".join(places[:TOLD]) or "nothing"
    text = f"of what is known here it goes in or on {told}"
    kind = short_type(type_of(receptacle))
    bring = next(vessels(places, object_type, kind), "") if kind in object_types() else ""
    return f"{text}; in {bring} it can be carried to {receptacle}" if bring else text
