"""What examples tell of the past: short-term memories, and what an earlier program failed on.

Memories are as they come about: a few requests done, and things seen on the way. No simulator runs:
what a request leaves behind is written down by rule. Failures are in the agent's words, those of
`karma.agent` (reach, search, handling, inspector) for small planners, with the program that goes on
from there.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

from karma.agent.planning.program import SKILL_OF
from karma.contracts import MemoryUnit, SkillCall
from karma.household import uses
from karma.household.ids import part_id, short_type
from karma.household.pieces import EGG, base_type, is_piece
from karma.household.places import HAND, SEVERAL, landmark_types, surface_for
from karma.household.states import OPPOSITES
from karma.household.types import ObjectType, object_types, types_with
from karma.language.lexemes import lexicon
from karma.plugins.training.drawing.memories import (
    CAPACITY,
    KnownRoom,
    Rng,
    pick,
    place_type,
    unit_of,
    weighted,
)
from karma.plugins.training.drawing.referring_expressions import Situation

Suits = Callable[[ObjectType], bool]
EVENTS = {
    "place": 30, "into": 10, "wash": 14, "slice": 10, "heat": 6, "cook": 4, "cool": 5, "fill": 5,
    "coffee": 3, "hold": 16, "switch": 5, "shut": 6, "trash": 3,
}  # fmt: skip
MANY = (*SEVERAL, "Sofa", "ArmChair")
DIRTY, SEEN_ONLY = 0.3, 0.55


class History:
    """A memory being lived: units by last use, and what is in the hand."""

    def __init__(self, rng: Rng, room: KnownRoom) -> None:
        self._rng, self._room = rng, room
        self._units: list[MemoryUnit] = []
        self._number = 0

    def units(self) -> tuple[MemoryUnit, ...]:
        """Return what is remembered, the last used last."""
        return tuple(self._units)

    def held(self) -> MemoryUnit | None:
        """Return what is in the hand."""
        return next((unit for unit in self._units if unit.place_id == HAND), None)

    def live(self) -> None:
        """Do one request more."""
        kind = weighted(self._rng, EVENTS)
        self._see()
        self._do(kind)
        while len(self._units) > CAPACITY:
            loose = [unit for unit in self._units if not unit.handled] or self._units
            self._units.remove(loose[0])

    # ------------------------------------------------------------- parts

    def _see(self) -> None:
        """Remember up to two things that were only seen."""
        for _ in range(2):
            if self._rng.random() < SEEN_ONLY and (kind := self._new_kind()) is not None:
                self._add(kind, self._landmark_for(kind), handled=False)

    def _new_kind(self) -> str | None:
        pool = [kind for kind in self._room.movables if kind in lexicon()]
        here = {base_type(unit.object_type) for unit in self._units}
        if self._rng.random() < 0.85:
            pool = [kind for kind in pool if kind not in here]
        return pick(self._rng, pool) if pool else None

    def _add(self, kind: str, place: str | None, *, handled: bool) -> MemoryUnit:
        self._number += 1
        states = self._first_states(object_types()[kind])
        name = f"{kind}|{self._number}"
        unit = unit_of(name, kind, states=states, place_id=place, handled=handled)
        self._units.append(unit)
        return unit

    def _first_states(self, info: ObjectType) -> tuple[str, ...]:
        can, rng = info.capabilities, self._rng
        states = []
        if "dirtyable" in can and rng.random() < DIRTY:
            states.append("dirty")
        if "canFillWithLiquid" in can and rng.random() < 0.07:
            states.append("filled")
        if "toggleable" in can:
            states.append("on" if rng.random() < 0.3 else "off")
        if "openable" in can:
            states.append("opened" if rng.random() < 0.5 else "closed")
        if "canBeUsedUp" in can and rng.random() < 0.08:
            states.append("used up")
        return tuple(states)

    def _landmark_for(self, kind: str) -> str | None:
        info = object_types()[kind]
        fitting = [name for name in self._room.landmarks if info.fits(object_types()[name])]
        return self._place(pick(self._rng, fitting)) if fitting else None

    def _place(self, name: str) -> str:
        number = int(self._rng.integers(1, 4)) if name in MANY else 1
        return part_id(uses.BASIN_OF.get(name, name), str(number))

    def _thing(self, suits: Suits) -> MemoryUnit | None:
        """Return something to do a request with: a known thing, more often a new one."""
        known = [unit for unit in self._units if suits(object_types()[unit.object_type])]
        if known and self._rng.random() < 0.45:
            return pick(self._rng, known)
        pool = [k for k in self._room.movables if k in lexicon() and suits(object_types()[k])]
        here = {base_type(unit.object_type) for unit in self._units}
        pool = [kind for kind in pool if kind not in here]
        return self._add(pick(self._rng, pool), None, handled=True) if pool else None

    def _use(self, unit: MemoryUnit, place: str | None, *add: str, drop: str = "") -> MemoryUnit:
        """Put a unit last, handled, somewhere, with states added and one dropped."""
        if place == HAND or unit.place_id != HAND:
            self._free_hand(unit)
        at = next(n for n, one in enumerate(self._units) if one.object_id == unit.object_id)
        states = [s for s in self._units.pop(at).states if s not in (drop, *add)]
        changed = replace(unit, states=(*states, *add), place_id=place, handled=True)
        self._units.append(changed)
        return changed

    def _free_hand(self, but: MemoryUnit) -> None:
        for number, unit in enumerate(self._units):
            if unit.place_id == HAND and unit.object_id != but.object_id:
                place = "CounterTop" if "CounterTop" in self._room.landmarks else "SideTable"
                self._units[number] = replace(unit, place_id=f"{place}|1")

    def _do(self, kind: str) -> None:
        place = {"cool": uses.FRIDGE, "trash": uses.BIN, "heat": uses.MICROWAVE}.get(kind)
        if kind in ("place", "into"):
            self._put(into=kind == "into")
        elif kind in ("wash", "fill"):
            self._wash(filled=kind == "fill")
        elif kind == "slice":
            self._slice()
        elif kind == "cook":
            self._at(uses.MICROWAVE, "cooked", lambda info: info.name in uses.COOKED)
        elif kind == "coffee":
            self._at(uses.COFFEE_MACHINE, "filled", lambda info: info.name == uses.COFFEE_CUP)
        elif kind == "hold":
            unit = self._thing(lambda info: "pickupable" in info.capabilities)
            if unit is not None:
                self._use(unit, HAND)
        elif kind in ("switch", "shut"):
            self._switch("toggleable" if kind == "switch" else "openable")
        elif place is not None:
            state = "heated" if kind == "heat" else ""
            self._at(place, state, lambda info: info.fits(object_types()[place]))

    def _put(self, *, into: bool) -> None:
        unit = self._thing(lambda info: "pickupable" in info.capabilities)
        if unit is None:
            return
        info = object_types()[unit.object_type]
        dish = None
        if into:
            dish = self._thing(
                lambda other: (
                    "pickupable" in other.capabilities
                    and other.name != unit.object_type
                    and info.fits(other)
                )
            )
        if dish is not None and dish.place_id != unit.object_id:
            self._use(unit, dish.object_id)
            place = dish.place_id or self._landmark_for(dish.object_type)
            if place == HAND or self._rng.random() < 0.4:
                place = self._landmark_for(dish.object_type)
            self._use(dish, place)
        elif (place := self._landmark_for(base_type(unit.object_type))) is not None:
            self._use(unit, place)

    def _at(self, place: str, state: str, suits: Suits) -> None:
        if place not in self._room.landmarks or (unit := self._thing(suits)) is None:
            return
        self._use(unit, f"{place}|1", *([state] if state else []))

    def _wash(self, *, filled: bool) -> None:
        kinds = object_types()

        def suits(info: ObjectType) -> bool:
            fits = any(info.fits(kinds[name]) for name in uses.with_basin(uses.SINK))
            return fits and (not filled or "canFillWithLiquid" in info.capabilities)

        unit = self._thing(suits)
        if unit is None or uses.SINK not in self._room.landmarks:
            return
        fills = "canFillWithLiquid" in kinds[unit.object_type].capabilities
        basin = f"{uses.BASIN_OF[uses.SINK]}|1"
        self._use(unit, basin, "cleaned", *(["filled"] if fills else []), drop="dirty")

    def _slice(self) -> None:
        unit = self._thing(lambda info: bool(info.slices_into) and info.name != EGG)
        if unit is None:
            return
        place = unit.place_id if unit.place_id not in (None, HAND) else "CounterTop|1"
        knife = next((u for u in self._units if u.object_type == uses.KNIFE), None)
        knife = knife or self._add(uses.KNIFE, None, handled=True)
        self._use(knife, HAND if self._rng.random() < 0.7 else "CounterTop|1")
        sliced = object_types()[unit.object_type].slices_into
        self._use(replace(unit, object_type=sliced or unit.object_type), place, "sliced")
        if sliced and self._rng.random() < 0.25:
            self._add(sliced, place, handled=False)

    def _switch(self, capability: str) -> None:
        unit = self._thing(
            lambda info: capability in info.capabilities and "pickupable" in info.capabilities
        )
        if unit is None:
            return
        pair = ("on", "off") if capability == "toggleable" else ("opened", "closed")
        state = pick(self._rng, pair)
        place = unit.place_id or self._landmark_for(unit.object_type)
        self._use(unit, place, state, drop=OPPOSITES[state])


def live_memory(rng: Rng, room: KnownRoom) -> tuple[tuple[MemoryUnit, ...], MemoryUnit | None]:
    """Draw a short-term memory, the last used last, and what is in the hand, if anything."""
    history = History(rng, room)
    for _ in range(int(rng.integers(0, 7))):
        history.live()
    return history.units(), history.held()


def with_twins(rng: Rng, room: KnownRoom, units: tuple[MemoryUnit, ...]) -> tuple[MemoryUnit, ...]:
    """Return a memory with one or two more of a thing in it, elsewhere and in other states."""
    loose = [unit for unit in units if not is_piece(unit.object_type)]
    if not loose or len(units) >= CAPACITY:
        return units
    found = list(units)
    first = pick(rng, loose)
    info = object_types()[first.object_type]
    places = [name for name in room.landmarks if info.fits(object_types()[name])]
    for number in range(min(int(rng.integers(1, 3)), CAPACITY - len(found))):
        twin = replace(
            first,
            object_id=f"{info.name}|{90 + number}",
            states=tuple(state for state in first.states if rng.random() < 0.3),
            place_id=f"{pick(rng, places)}|1" if places else None,
            handled=bool(rng.random() < 0.6),
        )
        found.insert(int(rng.integers(len(found) + 1)), twin)
    return tuple(found)


# ----------------------------------------------------------------- failures


FAILED = 0.08  # share of prompts that tell of a failure
SORTS = {"lost": 3, "missed": 2, "shut": 3, "full hand": 0.0, "empty hand": 0.5, "wrong": 4}
HELD = 12.0  # weight of a full hand where something is held
ALIKE = 8  # types that one may be taken for


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnFailure:
    """What the next prompt says, and the program to answer with."""

    error: str
    calls: tuple[SkillCall, ...]


def draw_failure(
    rng: Rng, scene: Situation, calls: tuple[SkillCall, ...], *, wanted: frozenset[str]
) -> DrawnFailure:
    """Draw what went wrong before a program; mostly nothing did.

    `calls`: the program of one to whom nothing has happened; `wanted`: types that the request
    is about, which were not the mistake.
    """
    if rng.random() > FAILED:
        return DrawnFailure(error="", calls=calls)
    sorts = {**SORTS, "full hand": HELD if scene.facts.held_type else 0.0}
    tell = {
        "lost": _lost, "missed": _missed, "shut": _shut_in, "full hand": _full_hand,
        "empty hand": _empty_hand,
    }.get(weighted(rng, sorts))  # fmt: skip
    found = tell(rng, scene, calls) if tell is not None else _mistaken(rng, scene, calls, wanted)
    return found or _lost(rng, scene, calls)


def _lost(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure:
    """Tell of a thing whose place was not known, or not that any more: it is searched for."""
    name = pick(rng, [call.objects[0] for call in calls])
    kind = short_type(name)
    words, skill = f"no {name} is known; Explore(robot, '{name}') first", "GoToObject"
    if kind not in landmark_types() and rng.random() < 0.6:
        words = f"{kind} is not at its remembered place; Explore(robot, '{kind}') to find it"
        skill = pick(rng, ("GoToObject", "PickupObject"))
    return DrawnFailure(error=f"{skill}(robot, '{name}'): {words}", calls=calls)


def _missed(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure:
    """Tell of something that may go well the next time."""
    call = pick(rng, calls)
    name, spent = call.objects[-1], int(rng.integers(40, 900))
    words = (
        f"could not get {short_type(name)} into view and reach",
        f"gave up after {spent} actions on {name}",
        "No valid positions to place object found",
    )
    return DrawnFailure(
        error=f"{call}: {words[int(rng.integers(2 + (len(call.objects) > 1)))]}", calls=calls
    )


def _shut_in(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure | None:
    """Tell of a thing that is shut in: what it is in is opened, and closed when it is out."""
    taken = [n for n, call in enumerate(calls) if call.skill == "PickupObject" and n]
    if not taken or calls[taken[0] - 1].skill != "GoToObject":
        return None
    at = taken[0]
    name = calls[at].objects[0]
    unit = next((one for one in scene.units if scene.names[one.object_id] == name), None)
    place = place_type(scene.units, unit.place_id) if unit and unit.place_id else ""
    kind = object_types()[short_type(name)]
    if place == HAND:
        return None
    if not place:
        places = [one for one in scene.room.landmarks if kind.fits(object_types()[one])]
        places = [one for one in places if object_types()[one].must_be_open]
        place = pick(rng, places) if places else ""
    if place not in landmark_types() or not object_types()[place].must_be_open:
        return None
    word = kind.name
    error = (
        f"PickupObject(robot, '{name}'): {word} is in the closed {place}; "
        f"OpenObject(robot, '{place}') first"
    )
    opened = (_call("GoToObject", place), _call("OpenObject", place))
    got = (calls[at], _call("CloseObject", place))
    return DrawnFailure(error=error, calls=(*calls[: at - 1], *opened, *got, *calls[at + 1 :]))


def _full_hand(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure | None:
    """Tell of what is in the hand: it is put down before another thing is taken."""
    held = base_type(scene.facts.held_type or "")
    first = next((call.objects[0] for call in calls if call.skill == "PickupObject"), "")
    if not held or not first or base_type(short_type(first)) == held:
        return None
    there = scene.room.landmarks if scene.mapped else ()
    surface = surface_for(held, frozenset(there).__contains__)
    if scene.mapped and surface not in there:
        return None
    error = (
        f"PickupObject(robot, '{first}'): the hand holds {held}; put it down first, "
        f"e.g. PutObject(robot, '{held}', '{surface}')"
    )
    put = (_call("GoToObject", surface), _call("PutObject", held, surface))
    return DrawnFailure(error=error, calls=(*put, *calls))


def _empty_hand(rng: Rng, scene: Situation, calls: tuple[SkillCall, ...]) -> DrawnFailure | None:
    """Tell of a thing that was to be put down and had not been picked up."""
    put = next((call for call in calls if call.skill == "PutObject"), None)
    if put is None:
        return None
    words = f"the hand is empty; PickupObject(robot, '{put.objects[0]}') first"
    return DrawnFailure(error=f"{put}: {words}", calls=calls)


def _mistaken(
    rng: Rng, scene: Situation, calls: tuple[SkillCall, ...], wanted: frozenset[str]
) -> DrawnFailure | None:
    """Tell of another type that the words were taken for, which it cannot have been."""
    call = pick(rng, calls)
    at = int(rng.integers(len(call.objects)))
    kind = short_type(call.objects[at])
    others = [one for one in _taken_for(kind) if one not in wanted]
    if not others:
        return None
    other = pick(rng, others)
    told = SkillCall(
        skill=call.skill,
        objects=tuple(other if n == at else name for n, name in enumerate(call.objects)),
    )
    missing = kind not in landmark_types() and rng.random() < 0.7
    if missing:
        places = int(rng.integers(2, 40))
        words = f"could not find {other}; searched {places} places"
        return DrawnFailure(error=f"Explore(robot, '{other}'): {words}", calls=calls)
    if call.skill == "PutObject":
        words = f"{told.objects[0]} cannot be placed in {told.objects[1]}"
    elif (skill := SKILL_OF[call.skill]).cannot and not skill.hand:
        words = f"{other} {skill.cannot}"
    else:
        words = f"no {other} is known; Explore(robot, '{other}') first"
    return DrawnFailure(error=f"{told}: {words}", calls=calls)


@cache
def _taken_for(kind: str) -> Sequence[str]:
    """Return the types that are most like one: they go to the same places, and can the same."""
    kinds = object_types()
    info = kinds[kind]
    able = frozenset(info.capabilities)
    movable = "pickupable" in able
    pool = types_with("pickupable") if movable else landmark_types()

    def unlike(other: str) -> tuple[int, str]:
        places = frozenset(info.goes_in or ()) ^ frozenset(kinds[other].goes_in or ())
        return len(places) + 3 * len(able ^ frozenset(kinds[other].capabilities)), other

    return sorted((one for one in pool if base_type(one) != base_type(kind)), key=unlike)[:ALIKE]


def _call(skill: str, *objects: str) -> SkillCall:
    return SkillCall(skill=skill, objects=objects)
